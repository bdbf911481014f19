"""Tries an installed package as a new user would: python try_installed.py COMMAND, in an empty folder."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2

from fisheye_ep_calib import calibrate_recording
from fisheye_ep_calib.simulation import Imaging, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.rendering import render

COMMAND = sys.argv[1]


def run(*words: str) -> str:
    ended = subprocess.run([COMMAND, *words], capture_output=True, text=True)
    if ended.returncode:
        raise SystemExit(f"{' '.join(words)}: exit code {ended.returncode}\n{ended.stdout}{ended.stderr}")
    if "Traceback" in ended.stderr or "Warning" in ended.stderr:
        raise SystemExit(f"{' '.join(words)}\n{ended.stderr}")
    return ended.stdout


def main() -> None:
    print(run("--version").strip())
    camera, target = paper_camera(), paper_target()
    folder = Path("front")
    folder.mkdir()
    for number, pose in enumerate(paper_poses(target)[:12]):
        cv2.imwrite(str(folder / f"{number:02d}.png"), render(camera, target, pose, Imaging(blur=0.7, noise=2.0)))
    run("detect", "front", "--target", "circle_grid_11x7", "--output", "found")
    told = json.loads(run("calibrate", "front", "--target", "circle_grid_11x7", "--output", "out", "--json"))
    (calibrated,) = told["cameras"].values()
    if calibrated["rms_px"] > 0.2:
        raise SystemExit(f"RMS {calibrated['rms_px']} px")
    json.loads(run("show", calibrated["yaml"], "--json"))
    run("export", calibrated["yaml"], "--to", "kalibr", "--output", "kalibr.yaml")
    (again,) = calibrate_recording("front", "circle_grid_11x7", model="ep_odd").values()
    print(f"calibrated: {calibrated['rms_px']:.3f} px, by Python {again.rms_px:.3f} px")
    run("demo")
    print("demo done")


if __name__ == "__main__":
    main()
