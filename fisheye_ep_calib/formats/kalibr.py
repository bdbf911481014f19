"""Kalibr's camchain.yaml: cam0, cam1, …, each placed by the one before it.

T_cn_cnm1 is camera n from camera n − 1. Models read: pinhole with equidistant, radtan or none, ds, and omni with radtan
or none, the unified model, which is a double sphere with α = 0.
(Kalibr wiki, "Yaml formats" and "Supported models".)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import needed, numbers
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera, fisheye_camera, pinhole_camera, size_of
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.opencv_text import plain_data
from fisheye_ep_calib.formats.placed_camera import KANNALA_BRANDT, PlacedCamera, floats, statement
from fisheye_ep_calib.plain_text import one_line

LENSES = (KANNALA_BRANDT, "double_sphere")


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """Intrinsics are those of a camera with one viewpoint: Kalibr knows no other."""
    central = [placed.central(LENSES).camera for placed in cameras]
    words = statement(cameras, central)
    return Written({"": "".join(f"# {line}\n" for line in words) + camchain(cameras, central)}, words)


def camchain(cameras: Sequence[PlacedCamera], central: Sequence[FisheyeCamera]) -> str:
    """The file's text. central: of each camera, the one with a single viewpoint that is written."""
    content = {}
    for number, (placed, camera) in enumerate(zip(cameras, central, strict=True)):
        step = {}
        if number > 0:
            pose = placed.camera_from_reference @ cameras[number - 1].reference_from_camera
            step = {"T_cn_cnm1": [floats(row) for row in pose]}
        content[f"cam{number}"] = {**step, "cam_overlaps": sorted(placed.overlaps), **camera_keys(placed, camera)}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1 << 16)


def camera_keys(placed: PlacedCamera, camera: FisheyeCamera) -> dict[str, Any]:
    """What Kalibr says of one camera."""
    grid = [camera.fx, camera.fy, camera.cx, camera.cy]
    shared = {"resolution": list(camera.image_size), "rostopic": placed.image_topic}
    if camera.lens == "double_sphere":
        model = {"camera_model": "ds", "distortion_coeffs": [], "distortion_model": "none"}
        return {**model, "intrinsics": floats([*camera.radial, *grid]), **shared}
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": floats(camera.radial),
        "distortion_model": "equidistant",
        "intrinsics": floats(grid),
        **shared,
    }


def recognises(text: str) -> bool:
    return "cam0:" in text and "camera_model:" in text and "distortion_coeffs:" in text


def read(text: str) -> list[ForeignCamera]:
    """OpenVINS's file of the same layout too."""
    content = plain_data(text)
    blocks = {name: block for name, block in content.items() if isinstance(block, dict) and "camera_model" in block}
    return [_camera(str(name), block) for name, block in blocks.items()]


def _camera(name: str, block: dict[str, Any]) -> ForeignCamera:
    kind, bends = one_line(block["camera_model"], 60), one_line(needed(block, "distortion_model"), 60)
    values = numbers(needed(block, "intrinsics"), f"{name}: intrinsics")
    distortion = numbers(needed(block, "distortion_coeffs"), f"{name}: distortion_coeffs")
    size = size_of(needed(block, "resolution"), f"{name}: resolution")
    model = f"{kind}-{bends}"
    lengths = {"pinhole": 4, "ds": 6, "omni": 5}
    if kind not in lengths or len(values) != lengths[kind]:
        raise InputError(f"{name}: {kind!r} with {len(values)} intrinsics is not known here")
    matrix = np.array([[values[-4], 0, values[-2]], [0, values[-3], values[-1]], [0, 0, 1]])
    if model == "pinhole-equidistant":
        camera = fisheye_camera(size, matrix, distortion)
    elif kind == "pinhole" and bends in ("radtan", "none"):
        camera = pinhole_camera(size, matrix, distortion)
    elif kind == "ds" and bends == "none":
        camera = _double_sphere(size, values[0], values[1], values[2:])
    elif kind == "omni" and bends in ("radtan", "none"):
        bent = pinhole_camera(size, matrix, distortion)
        camera = _double_sphere(size, values[0], 0.0, values[1:], dict(bent.extras))
    else:
        raise InputError(f"{name}: the model {model} is not known here")
    return ForeignCamera(name, camera, model)


def _double_sphere(
    size: tuple[int, int],
    xi: float,
    alpha: float,
    grid: list[float],
    extras: dict[str, tuple[float, ...]] | None = None,
) -> FisheyeCamera:
    fx, fy, cx, cy = grid
    return FisheyeCamera(size, fx, fy, cx, cy, radial=(xi, alpha), lens="double_sphere", extras=extras or {})


KALIBR = Format("kalibr", "Kalibr's camchain.yaml", write, recognises, read)
