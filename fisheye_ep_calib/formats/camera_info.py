"""ROS's CameraInfo as YAML, as camera_info_manager writes it: equidistant, plumb_bob, rational_polynomial.

Of camera_matrix, distortion_model and distortion_coefficients alone; rectification and projection say what a rectified
image is to be, not what the camera is. (sensor_msgs/CameraInfo; image_geometry.)
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera, fisheye_camera, pinhole_camera
from fisheye_ep_calib.formats.format import Format
from fisheye_ep_calib.formats.opencv_text import matrix_of, plain_data

_PINHOLES = ("plumb_bob", "rational_polynomial", "none", "")


def recognises(text: str) -> bool:
    """Without the block of this package's own files."""
    keys = ("image_width", "camera_matrix", "distortion_model", "distortion_coefficients")
    whole = all(re.search(rf"^{key}:", text, re.MULTILINE) for key in keys)
    return whole and not re.search(r"^entrance_pupil:|opencv-matrix", text, re.MULTILINE)


def read(text: str) -> list[ForeignCamera]:
    return [camera_of(plain_data(text))]


def camera_of(content: dict[str, Any]) -> ForeignCamera:
    """The camera of a CameraInfo's keys. Raises InputError, KeyError, TypeError or ValueError."""
    name = content.get("camera_name", "camera")
    if not isinstance(name, str | int | float):
        raise InputError("camera_name must be text")
    model = content["distortion_model"]
    size = content["image_width"], content["image_height"]
    matrix = matrix_of({"rows": 3, "cols": 3, "data": content["camera_matrix"]["data"]})
    distortion = [float(value) for value in content["distortion_coefficients"]["data"]]
    if model == "equidistant":
        return ForeignCamera(str(name), fisheye_camera(size, matrix, distortion), model)
    if model not in _PINHOLES:
        raise InputError(
            f"distortion_model {model!r} is not known here; known: equidistant, {', '.join(_PINHOLES[:3])}"
        )
    return ForeignCamera(str(name), pinhole_camera(size, np.array(matrix), distortion), str(model))


CAMERA_INFO = Format("camera_info", "ROS's CameraInfo as YAML", recognises=recognises, read=read)
