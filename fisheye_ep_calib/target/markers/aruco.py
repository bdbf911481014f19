"""The door to cv2.aruco, which not every OpenCV has: its dictionaries, under their names before 4.7 and since."""

from __future__ import annotations

from typing import Any  # of cv2.aruco, which may be absent

import numpy as np

from fisheye_ep_calib.errors import InputError

MARKERS = {f"DICT_{n}X{n}_{count}": count for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)} | {
    "DICT_ARUCO_ORIGINAL": 1024,
    "DICT_APRILTAG_16h5": 30,
    "DICT_APRILTAG_25h9": 35,
    "DICT_APRILTAG_36h10": 2320,
    "DICT_APRILTAG_36h11": 587,
    "DICT_ARUCO_MIP_36h12": 250,
}  # how many each of OpenCV's dictionaries has
APRILGRID_DICTIONARY = "DICT_APRILTAG_36h11"
APRILGRID_BORDER = 2  # black cells around a tag of an AprilGrid


def require_aruco(what: str) -> Any:
    """The module cv2.aruco, or one line that says how to get it."""
    import cv2  # not before it is needed: a target's geometry needs no OpenCV

    module = getattr(cv2, "aruco", None)
    if module is None or not hasattr(module, "getPredefinedDictionary"):
        raise InputError(
            f"{what} needs cv2.aruco, which OpenCV {cv2.__version__} here lacks:"
            " pip install 'opencv-python-headless>=4.7' (with Ubuntu 24.04's ROS also 'numpy<2')"
        )
    return module


def dictionary_name(given: str) -> str | None:
    """The key of MARKERS that is meant: as in OpenCV, in any capitals, with its namespace or without ``DICT_``."""
    last = given.replace("::", ".").rsplit(".", 1)[-1].upper().removeprefix("DICT_")
    return next((name for name in MARKERS if name.upper() == f"DICT_{last}"), None)


def aruco_dictionary(name: str, what: str) -> Any:
    """One of OpenCV's predefined dictionaries by its name."""
    module = require_aruco(what)
    number = getattr(module, name, None)
    if number is None:
        raise InputError(f"the OpenCV here does not know {name} yet")
    return module.getPredefinedDictionary(number)


def marker_side(name: str) -> int | None:
    """Cells along a marker of one of OpenCV's dictionaries without its border; None where this OpenCV lacks it."""
    number = getattr(require_aruco("a marker"), name, None)
    return None if number is None else int(require_aruco("a marker").getPredefinedDictionary(number).markerSize)


def marker_bits(dictionary: Any, identities: np.ndarray, border: int) -> np.ndarray:
    """The cells (n, m, m) of markers as printed, 1 white and 0 black, row by row, with ``border`` black cells
    around.
    """
    module = require_aruco("a marker's picture")
    side = dictionary.markerSize + 2 * border
    drawn = module.generateImageMarker if hasattr(module, "generateImageMarker") else module.drawMarker  # before 4.7
    pictures = [drawn(dictionary, int(i), side, borderBits=border) for i in identities]
    return (np.array(pictures).reshape(len(identities), side, side) > 127).astype(np.uint8)


def bits_as_quads(bits: np.ndarray, corners: np.ndarray, right: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Black runs of cells as quadrilaterals (q, 4, 2), metres.

    bits (n, m, m); corners (n, 2): where each marker's first cell begins; right, down (2,): one cell's steps
    along a row of cells and from row to row. Runs along a row become one quadrilateral, so that a print shows
    no seams in them.
    """
    quads = []
    for picture, corner in zip(bits, corners, strict=True):
        padded = np.pad(picture == 0, ((0, 0), (1, 1))).astype(np.int8)
        change = np.diff(padded, axis=1)
        row, start = np.nonzero(change == 1)
        stop = np.nonzero(change == -1)[1]
        first = corner + row[:, None] * down + start[:, None] * right
        last = corner + row[:, None] * down + stop[:, None] * right
        quads.append(np.stack([first, last, last + down, first + down], axis=1))
    return np.concatenate(quads) if quads else np.empty((0, 4, 2))
