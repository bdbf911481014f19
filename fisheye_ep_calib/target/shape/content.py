"""A measured shape as plain data: what a target file says under ``shape`` and, with the points, a camera file under
``calibration: board``.

    kind: free                      flat, bow or free
    bent: true
    scatter: [2.0e-05, …]           metres, along the board's x, y and normal
    deviation: [[dx, dy, dz], …]    metres, a row a point in the order of the target's points
    sigma: [[sx, sy, sz], …]        metres; where it is known
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.target.schema import MOST_POINTS
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import BOW, FLAT, FREE

_DIGITS = 9  # of metres: a nanometre
_LARGEST = 0.2  # of the board's size, that a point may be off
_LARGEST_LENGTH = 1e4  # metres
KEYS = ("kind", "bent", "scatter", "deviation", "sigma")


def shape_content(shape: BoardShape) -> dict[str, Any]:
    """The shape in numbers, texts and lists of them."""
    content: dict[str, Any] = {"kind": shape.kind, "bent": shape.bent, "scatter": _rounded(np.array(shape.scatter))}
    content["deviation"] = _rounded(shape.deviation)
    if shape.sigma is not None:
        content["sigma"] = _rounded(shape.sigma)
    return content


def parse_shape(content: object, object_points: np.ndarray) -> BoardShape:
    """The shape of a target with these points (n, 3), metres. Raises InputError naming the key."""
    if not isinstance(content, dict):
        raise InputError(f"shape must have the keys {', '.join(KEYS)}")
    kind = content.get("kind", FREE)
    if kind not in (FLAT, BOW, FREE):
        raise InputError(f"shape: kind must be {FLAT}, {BOW} or {FREE}, not {shown(kind)}")
    if not isinstance(content.get("bent", False), bool):
        raise InputError("shape: bent must be true or false")
    deviation = _numbers(content.get("deviation"), "deviation", object_points.shape)
    size = float(np.ptp(object_points, axis=0).max())
    largest = float(np.abs(deviation).max())
    if largest > _LARGEST * size:
        raise InputError(f"shape: deviation is in metres; a point {largest:.3g} m off its place is not of this target")
    sigma = None
    if content.get("sigma") is not None:
        sigma = np.abs(_numbers(content["sigma"], "sigma", object_points.shape))
    scatter = _numbers(content.get("scatter", [0.0, 0.0, 0.0]), "scatter", (3,))
    x, y, z = scatter.tolist()
    return BoardShape(kind, object_points, deviation, sigma, content.get("bent", False), (x, y, z))


def board_content(shape: BoardShape) -> dict[str, Any]:
    """The target's points and its shape."""
    return {"object_points": _rounded(shape.object_points), **shape_content(shape)}


def parse_board(content: object) -> BoardShape:
    """The shape with its target's points. Raises InputError."""
    points = content.get("object_points") if isinstance(content, dict) else None
    if not isinstance(points, list) or not 0 < len(points) <= MOST_POINTS:
        raise InputError(f"board must have object_points, {MOST_POINTS} at most")
    shape = parse_shape(content, _numbers(points, "object_points", (len(points), 3)))
    return replace(shape, discs=isinstance(content, dict) and content.get("disc_radius") is not None)


def _numbers(values: object, key: str, shape: tuple[int, ...]) -> np.ndarray:
    if not isinstance(values, list) or len(values) != shape[0]:
        raise InputError(f"shape: {key} must have {shape[0]} rows")
    try:
        numbers = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"shape: {key} must hold numbers") from None
    if numbers.size and np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0) > _LARGEST_LENGTH:
        raise InputError(f"shape: {key} holds {np.nanmax(np.abs(numbers)):.3g} m: no target is that large")
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise InputError(f"shape: {key} must be {' × '.join(map(str, shape))} finite numbers")
    return numbers


def _rounded(values: np.ndarray) -> list[Any]:
    rounded: list[Any] = np.round(values, _DIGITS).tolist()
    return rounded
