"""Nerfstudio's transforms.json: OPENCV_FISHEYE cameras; of a rig a frame a camera.

Its (0, 0) is the corner of the top-left pixel, as COLMAP's. transform_matrix is the world from the camera, whose frame
is OpenGL's: y up, z backward. It describes images; file_path of a rig's frames is to be replaced.
(nerfstudio, docs/quickstart/data_conventions.md.)
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats.colmap import CORNER
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, statement

_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # the camera's frame here from OpenGL's


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """Kannala–Brandt cameras with one viewpoint."""
    central = [placed.central().camera for placed in cameras]
    words = statement(cameras, central)
    content: dict[str, Any] = {"camera_model": "OPENCV_FISHEYE", "fisheye_ep_calib": list(words)}
    frames = []
    if len(cameras) == 1:
        content |= _intrinsics(central[0])
    else:
        words = (*words, "a frame a camera, with its pose in the rig: file_path is to be replaced by an image's")
        for placed, camera in zip(cameras, central, strict=True):
            pose = (placed.reference_from_camera @ _OPENGL).tolist()
            frames.append({"file_path": f"{placed.name}.png", "transform_matrix": pose, **_intrinsics(camera)})
    return Written({"": json.dumps({**content, "frames": frames}, indent=2) + "\n"}, words)


def _intrinsics(camera: FisheyeCamera) -> dict[str, Any]:
    width, height = camera.image_size
    grid = {"fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx + CORNER, "cy": camera.cy + CORNER}
    radial = dict(zip(("k1", "k2", "k3", "k4"), camera.radial, strict=True))
    return {"w": width, "h": height, **grid, **radial}


NERFSTUDIO = Format("nerfstudio", "Nerfstudio's transforms.json", write)
