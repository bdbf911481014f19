"""OpenCV's FileStorage, YAML or XML: as its samples write a calibration, cv::fisheye or pinhole, one camera or several.

Read under the names that are in use for a camera matrix, its distortion and the image's size. Four coefficients may be
k1..k4 of a fisheye or k1, k2, p1, p2 of a pinhole: the key ``fisheye_model`` (1 or 0) says which.
R and T of a rig are a camera from the first one, as cv::fisheye::stereoCalibrate gives them.
(OpenCV, samples/cpp/tutorial_code/calib3d/camera_calibration, samples/cpp/stereo_calib.cpp.)
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import matrix as matrix_in_list
from fisheye_ep_calib.file_values import numbers
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera, fisheye_camera, pinhole_camera, size_of
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.opencv_text import matrix_of, plain_data, xml_data
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, statement

_MATRIX = ("cameramatrix", "k", "m", "intrinsics", "intrinsicmatrix", "mtx")
_DISTORTION = ("distortioncoefficients", "distcoeffs", "distortion", "d", "dist")
_WIDTH, _HEIGHT, _SIZE = ("imagewidth", "width"), ("imageheight", "height"), ("imagesize", "imgsize", "size")


def write(cameras: Sequence[PlacedCamera], named: Named) -> Written:
    """cv::fisheye cameras; XML where the output is called so. Of several, K1, D1, K2, D2, …, R12, T12, …"""
    import cv2

    central = [placed.central().camera for placed in cameras]
    words = statement(cameras, central)
    ending = ".xml" if named("").lower().endswith(".xml") else ".yaml"
    storage = cv2.FileStorage(ending, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in words:
        storage.writeComment(line.replace("--", "- -"))
    storage.write("fisheye_model", 1)
    if len(cameras) == 1:
        _write_size(storage, central[0], "")
        storage.write("camera_matrix", _matrix(central[0]))
        storage.write("distortion_coefficients", np.array([central[0].radial]).T)
    else:
        _write_rig(storage, cameras, central)
    return Written({"": str(storage.releaseAndGetString())}, words)


def _write_size(storage: Any, camera: FisheyeCamera, number: str) -> None:
    width, height = camera.image_size
    storage.write(f"image_width{number}", width)
    storage.write(f"image_height{number}", height)


def _write_rig(storage: Any, cameras: Sequence[PlacedCamera], central: Sequence[FisheyeCamera]) -> None:
    for number, (placed, camera) in enumerate(zip(cameras, central, strict=True), start=1):
        storage.write(f"name{number}", placed.name)
        _write_size(storage, camera, str(number))
        storage.write(f"K{number}", _matrix(camera))
        storage.write(f"D{number}", np.array([camera.radial]).T)
        if number > 1:
            pose = placed.camera_from_reference @ cameras[0].reference_from_camera
            storage.write(f"R1{number}", pose[:3, :3])
            storage.write(f"T1{number}", pose[:3, 3:])


def _matrix(camera: FisheyeCamera) -> np.ndarray:
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def recognises(text: str) -> bool:
    return "opencv-matrix" in text or "<opencv_storage>" in text


def read(text: str) -> list[ForeignCamera]:
    """One camera, or those whose names end in 1, 2, …"""
    content = xml_data(text) if text.lstrip().startswith("<") else plain_data(text)
    keys = {re.sub(r"[_\s]", "", str(name)).lower(): value for name, value in content.items()}
    numbers = [""] if _found(keys, _MATRIX, "") is not None else [str(number) for number in range(1, 10)]
    cameras = []
    for number in numbers:
        matrix, distortion = _found(keys, _MATRIX, number), _found(keys, _DISTORTION, number)
        if matrix is None or distortion is None:
            continue
        name = str(keys.get(f"name{number}", f"camera{number}" if number else "camera"))
        cameras.append(_camera(name, _grid(matrix), _values(distortion, "distortion coefficients"), keys, number))
    if not cameras:
        raise InputError("no camera matrix with distortion coefficients is in it, under names known here")
    return cameras


def _grid(value: Any) -> np.ndarray:
    """A camera matrix as OpenCV writes it, or as a list."""
    return matrix_of(value) if isinstance(value, dict) else matrix_in_list(value, "the camera matrix", 3, 3)


def _values(value: Any, key: str) -> list[float]:
    """The numbers of a matrix as OpenCV writes it, of a list, or of a list of lists."""
    if isinstance(value, dict):
        return [float(element) for element in matrix_of(value).ravel()]
    rows = value if isinstance(value, list) else [value]
    return numbers([element for row in rows for element in (row if isinstance(row, list) else [row])], key)


def _camera(name: str, matrix: np.ndarray, values: list[float], keys: dict[str, Any], number: str) -> ForeignCamera:
    size = _image_size(keys, number)
    fisheye = keys.get("fisheyemodel", keys.get("fisheye"))
    if fisheye is None and len(values) == 4:
        raise InputError(
            "four distortion coefficients are a fisheye's or a pinhole's: add the key fisheye_model, 1 for a camera of "
            "cv::fisheye, 0 for one of cv::calibrateCamera"
        )
    if fisheye in (1, True, "1", "true"):
        return ForeignCamera(name, fisheye_camera(size, matrix, values), "fisheye")
    return ForeignCamera(name, pinhole_camera(size, matrix, values), "pinhole")


def _image_size(keys: dict[str, Any], number: str) -> tuple[int, int]:
    for end in dict.fromkeys((number, "")):
        size = _found(keys, _SIZE, end)
        if size is not None:
            return size_of(_values(size, "the image's size"), "the image's size")
        sizes = [_found(keys, names, end) for names in (_WIDTH, _HEIGHT)]
        if None not in sizes:
            return size_of(sizes, "the image's size")
    raise InputError("it does not say the size of the images: add the keys image_width and image_height")


def _found(keys: dict[str, Any], names: Sequence[str], number: str) -> Any:
    return next((keys[name + number] for name in names if name + number in keys), None)


OPENCV = Format("opencv", "OpenCV's FileStorage (cv::fisheye), YAML or XML", write, recognises, read)
