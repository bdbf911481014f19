"""fisheye_ep_calib show: what a camera file says."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fisheye_ep_calib.storage.camera_content import camera_content, fact_in_words
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.storage.json_text import json_text

DESCRIPTION = "Print a camera file: intrinsics, entrance pupil E(θ) and image radius r(θ) with their 1σ bands."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("camera", type=Path, metavar="CAMERA.yaml")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    file = read_camera_file(arguments.camera)
    content = camera_content(file)
    print(json_text(content) if arguments.json else _text(file, content))
    return 0


def _text(file: CameraFile, content: dict[str, Any]) -> str:
    camera = file.camera
    width, height = camera.image_size
    lines = [f"{file.name}: {width}×{height} px, model {camera.model}, lens {camera.lens}"]
    if file.origin:
        lines.append(f"  read as {file.origin}")
    values = zip(camera.layout.names, camera.layout.units, camera.parameters, content["sigma"].values(), strict=True)
    for name, unit, value, sigma in values:
        scale, unit = (1e3, "mm") if unit == "m" else (1, unit)
        lines.append(f"  {name:<6}{scale * value:>13.5f} ± {scale * sigma:.5f} {unit}".rstrip())
    lines.append(f"  {'θ':>5} {'E mm':>10} {'± mm':>9} {'r px':>11} {'± px':>8}")
    rows = zip(
        content["theta_deg"], content["E_m"], content["E_sigma_m"], content["r_px"], content["r_sigma_px"], strict=True
    )
    for degrees, shift, shift_sigma, radius, radius_sigma_px in rows:
        if degrees % 5 == 0:
            lines.append(
                f"  {degrees:>4}° {1e3 * shift:>10.4f} {1e3 * shift_sigma:>9.4f}"
                f" {radius:>11.3f} {radius_sigma_px:>8.3f}"
            )
    lines += _uncertainty_lines(content["projection_uncertainty"])
    losses = ", ".join(f"{value:.2f} px at {key} m" for key, value in content["svp"]["loss_px"].items())
    if losses:
        lines.append(f"  a single-viewpoint consumer of CameraInfo loses {losses}")
    if file.board is not None:
        lines.append(f"  the board: {file.board.sentence}")
    for key, value in file.calibration.items():
        lines.append(f"  {key}: {fact_in_words(value)}")
    return "\n".join(lines)


def _uncertainty_lines(table: dict[str, Any]) -> list[str]:
    """Projection uncertainty, px, as a table of angle by distance."""
    if not table:
        return []
    lines = ["  projection uncertainty, px, by angle and distance:"]
    lines.append(f"  {'θ':>5} " + "".join(f"{str(distance) + ' m':>9}" for distance in table["distance_m"]))
    for degrees, row in zip(table["theta_deg"], table["sigma_px"], strict=True):
        lines.append(f"  {degrees:>4.0f}° " + "".join(f"{value:>9.3f}" for value in row))
    return lines
