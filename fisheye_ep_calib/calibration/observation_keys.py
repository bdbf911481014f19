"""The keys of an observation file, and what each may hold."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.target.schema import LEAST_LENGTH, MOST_POINTS
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import FREE

METRES_PER_UNIT = {"mm": 1e-3, "m": 1.0}
REQUIRED = ("object_points", "unit", "image_index", "point_index", "pixels", "image_size")
OPTIONAL = ("weights", "image_names", "split", "disc_radius", "board_deviation", "mistakable")
_MOST_IMAGES = 10**6
_LONGEST_SIDE = 65535
_LONGEST_NAME = 1000
_LARGEST_LENGTH = 1e4  # metres: no target is that large
_LARGEST_DEVIATION = 0.2  # of the target's size, that a point may be off its place
_MANY_PLACES, _LEAST_SEEN = 10**6, 0.25  # images × points; the share of so many that must be sightings
_LEAST_WEIGHT, _LARGEST_WEIGHT = 1e-6, 1e6  # squares of weights are summed


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
        _check_lengths("disc_radius", radius * metres)
    weights = None if "weights" not in arrays else _real_numbers("weights", arrays["weights"])
    object_points = _real_numbers("object_points", arrays["object_points"]) * metres
    check_points(object_points)
    return {
        "object_points": object_points,
        "image_index": image_index,
        "point_index": whole_numbers("point_index", _real_numbers("point_index", arrays["point_index"])),
        "pixels": _real_numbers("pixels", arrays["pixels"]),
        "image_size": tuple(int(value) for value in image_size),
        "weights": weights,
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
    if np.abs(rows).max(initial=0.0) > _LARGEST_DEVIATION * np.ptp(object_points, axis=0).max(initial=0.0):
        raise InputError("board_deviation moves a point by more than a fifth of the target's size")
    return BoardShape(FREE, object_points, rows)


def check_points(object_points: np.ndarray) -> None:
    """Raises InputError where there are too many points, or they span more or less than any target does."""
    if object_points.size > 3 * MOST_POINTS:
        raise InputError(f"object_points are {len(object_points)}; at most {MOST_POINTS} are read")
    _check_lengths("object_points", object_points)
    span = np.ptp(object_points, axis=0).max(initial=0.0) if object_points.ndim == 2 and object_points.size else 0.0
    if 0 < span < LEAST_LENGTH:
        raise InputError(f"object_points span {span:.3g} m, less than anything that can be seen: is unit right?")


def check_density(images: int, points: int, sightings: int) -> None:
    """Raises InputError where most points are in no image: memory and time go with images × points."""
    places = images * points
    if places > _MANY_PLACES and sightings < _LEAST_SEEN * places:
        raise InputError(
            f"{images} images show {sightings / images:.3g} of {points} points each: leave out points that none shows"
        )


def _check_lengths(name: str, values: np.ndarray) -> None:
    """Of what is not finite something else is said."""
    largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    if largest > _LARGEST_LENGTH:
        raise InputError(f"{name} reaches {largest:.3g} m; at most {_LARGEST_LENGTH:g} m are read: is unit right?")


def check_weights(values: np.ndarray) -> None:
    """Raises InputError where a weight is so large or small that the sum of their squares says nothing."""
    beyond = values[(values > _LARGEST_WEIGHT) | ((values > 0) & (values < _LEAST_WEIGHT))]
    if len(beyond.reshape(-1)) and np.isfinite(beyond).all():
        raise InputError(
            f"weights has {beyond.reshape(-1)[0]:.3g}: give 0, or from {_LEAST_WEIGHT:g} to {_LARGEST_WEIGHT:g}"
        )


def real_numbers(name: str, values: npt.ArrayLike) -> np.ndarray:
    """A copy of the values, float, of their shape. Raises InputError."""
    try:
        numbers = np.array(values)
        if numbers.dtype.kind not in "c":
            return numbers.astype(float)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{name} must hold real numbers")


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
    if len(array) > _MOST_IMAGES:
        raise InputError(f"{name} has {len(array)} names; at most {_MOST_IMAGES} images are read")
    names = array.astype(np.str_) if array.dtype.kind in "iu" else array
    return tuple(one_line(_text(entry), _LONGEST_NAME) for entry in names)
