"""ROS's CameraInfo as YAML, as camera_info_manager writes it: equidistant, plumb_bob, rational_polynomial.

Of camera_matrix, distortion_model and distortion_coefficients alone; rectification and projection say what a rectified
image is to be, not what the camera is. (sensor_msgs/CameraInfo; image_geometry.)
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import yaml

from fisheye_ep_calib.camera.camera_info import PlainCameraInfo, camera_info_content, plain_camera_info
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import mapping, needed, numbers
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera, fisheye_camera, pinhole_camera
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.opencv_text import matrix_of, plain_data
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, floats, statement
from fisheye_ep_calib.formats.stereo import rectified_pair
from fisheye_ep_calib.plain_text import shown

_PINHOLES = ("plumb_bob", "rational_polynomial", "none", "")


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """A camera's CameraInfo, as in the camera file; of a stereo pair two, with R and P of the rectified images."""
    central = [placed.central().camera for placed in cameras]
    words = statement(cameras, central)
    infos = [plain_camera_info(camera) for camera in central]
    if len(cameras) == 1:
        return Written({"": _text(infos[0], cameras[0].name, words)}, words)
    pair = rectified_pair(cameras[0], cameras[1])
    files = {}
    for number, placed in enumerate(cameras):
        r, p = pair.rectified_from_camera[number], pair.projection[number]
        rectified = replace(infos[number], r=tuple(floats(r.ravel())), p=tuple(floats(p.ravel())))
        files[f"_{placed.name}"] = _text(rectified, placed.name, words)
    return Written(files, (*words, "R and P are of rectified images: the same row in both, disparity f B / Z"))


def _text(info: PlainCameraInfo, name: str, words: tuple[str, ...]) -> str:
    content = camera_info_content(info, name)
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=1 << 16)
    return "".join(f"# {line}\n" for line in words) + text


def recognises(text: str) -> bool:
    """Without the block of this package's own files."""
    keys = ("image_width", "camera_matrix", "distortion_model", "distortion_coefficients")
    whole = all(re.search(rf"^{key}:", text, re.MULTILINE) for key in keys)
    return whole and not re.search(r"^entrance_pupil:|opencv-matrix", text, re.MULTILINE)


def read(text: str) -> list[ForeignCamera]:
    return [camera_of(plain_data(text))]


def camera_of(content: dict[str, Any]) -> ForeignCamera:
    """The camera of a CameraInfo's keys. Raises InputError."""
    name = content.get("camera_name", "camera")
    if not isinstance(name, str | int | float):
        raise InputError("camera_name must be text")
    model = needed(content, "distortion_model")
    size = needed(content, "image_width"), needed(content, "image_height")
    grid, bends = (mapping(needed(content, key), key) for key in ("camera_matrix", "distortion_coefficients"))
    matrix = matrix_of({"rows": 3, "cols": 3, "data": needed(grid, "data")})
    distortion = numbers(needed(bends, "data"), "distortion_coefficients: data")
    if model == "equidistant":
        return ForeignCamera(str(name), fisheye_camera(size, matrix, distortion), model)
    if model not in _PINHOLES:
        raise InputError(
            f"distortion_model {shown(model)} is not known here; known: equidistant, {', '.join(_PINHOLES[:3])}"
        )
    return ForeignCamera(str(name), pinhole_camera(size, np.array(matrix), distortion), str(model))


CAMERA_INFO = Format(
    "camera_info", "ROS's CameraInfo as YAML; of a stereo pair two, rectified", write, recognises, read, most_cameras=2
)
