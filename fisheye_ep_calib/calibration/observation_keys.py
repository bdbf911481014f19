"""The keys of an observation file, and what each may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import FREE

METRES_PER_UNIT = {"mm": 1e-3, "m": 1.0}
REQUIRED = ("object_points", "unit", "image_index", "point_index", "pixels", "image_size")
OPTIONAL = ("weights", "image_names", "split", "disc_radius", "board_deviation", "mistakable")
_MOST_IMAGES = 10**6
_LONGEST_SIDE = 65535


def checked_keys(arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """The arguments of ``Observations.create``, from the file's arrays; lengths become metres. Raises InputError."""
    metres = METRES_PER_UNIT.get(_text(arrays["unit"]))
    if metres is None:
        raise InputError(f'unit must be "mm" or "m", not {shown(_text(arrays["unit"]))}')
    image_index = whole_numbers("image_index", _real_numbers("image_index", arrays["image_index"]))
    if image_index.size and image_index.max() >= _MOST_IMAGES:
        raise InputError(f"image_index reaches {image_index.max()}; at most {_MOST_IMAGES} images are read")
    image_size = whole_numbers("image_size", _real_numbers("image_size", arrays["image_size"]))
    if image_size.shape != (2,) or (image_size < 1).any() or (image_size > _LONGEST_SIDE).any():
        raise InputError(f"image_size must be (width, height) within 1..{_LONGEST_SIDE}")
    disc_radius = None
    if "disc_radius" in arrays:
        radius = _real_numbers("disc_radius", arrays["disc_radius"])
        if radius.size != 1:
            raise InputError("disc_radius must be one number")
        disc_radius = float(radius.reshape(())) * metres
    weights = arrays.get("weights")
    object_points = _real_numbers("object_points", arrays["object_points"]) * metres
    return {
        "object_points": object_points,
        "image_index": image_index,
        "point_index": whole_numbers("point_index", _real_numbers("point_index", arrays["point_index"])),
        "pixels": _real_numbers("pixels", arrays["pixels"]),
        "image_size": tuple(int(value) for value in image_size),
        "weights": None if weights is None else _real_numbers("weights", weights),
        "image_names": _texts("image_names", arrays.get("image_names")),
        "split": _texts("split", arrays.get("split")),
        "disc_radius": disc_radius,
        "board": _board(arrays.get("board_deviation"), object_points, metres),
        "mistakable": _truth("mistakable", arrays.get("mistakable")),
    }


def _board(deviation: np.ndarray | None, object_points: np.ndarray, metres: float) -> BoardShape | None:
    """The target's shape as it was measured before: what is to be added to its points."""
    if deviation is None:
        return None
    rows = _real_numbers("board_deviation", deviation) * metres
    if rows.shape != object_points.shape or not np.isfinite(rows).all():
        raise InputError("board_deviation must be finite and have a row a point, as object_points")
    return BoardShape(FREE, object_points, rows)


def whole_numbers(name: str, values: npt.ArrayLike) -> np.ndarray:
    """Whole numbers, int64, of the shape of the values. Raises InputError."""
    try:
        numbers = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must hold whole numbers") from None
    if not (np.isfinite(numbers).all() and (numbers == np.rint(numbers)).all()):
        raise InputError(f"{name} must hold whole numbers")
    if numbers.size and np.abs(numbers).max() > 2**53:
        raise InputError(f"{name} holds numbers that are too large")
    return numbers.astype(np.int64)


def _real_numbers(name: str, array: np.ndarray) -> np.ndarray:
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} must hold numbers, not {array.dtype}")
    return array.astype(float)


def _truth(name: str, array: np.ndarray | None) -> bool:
    if array is None:
        return False
    if array.size != 1 or array.dtype.kind != "b":
        raise InputError(f"{name} must be true or false")
    return bool(array.reshape(()))


def _text(array: np.ndarray) -> str:
    """A string stored as an array of any shape with one entry; bytes are taken as UTF-8."""
    if array.size != 1 or array.dtype.kind not in "US":
        return f"an array of shape {array.shape} and type {array.dtype}"
    value = array.reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _texts(name: str, array: np.ndarray | None) -> tuple[str, ...] | None:
    if array is None:
        return None
    if array.ndim != 1 or array.dtype.kind not in "USiu":
        raise InputError(f"{name} must be a list of names, one an image")
    names = array.astype(np.str_) if array.dtype.kind in "iu" else array
    return tuple(_text(entry) for entry in names)
