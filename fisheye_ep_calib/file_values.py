"""Numbers and keys out of what a file of somebody else says; what is something else is refused by its key."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import one_line, shown

_LONGEST_KEY = 60


def mapping(value: Any, key: str) -> dict[Any, Any]:
    """Keys and values. Raises InputError."""
    if not isinstance(value, dict):
        raise InputError(f"{_named(key)} must have keys and values, not {shown(value)}")
    return value


def needed(block: dict[Any, Any], key: str) -> Any:
    """What is under the key, which must be there. Raises InputError."""
    if key not in block:
        raise InputError(f"{_named(key)} is missing")
    return block[key]


def number(value: Any, key: str) -> float:
    """A number, also one in quotes; NaN and infinities are some. Raises InputError."""
    found = _number(value)
    if found is None:
        raise InputError(f"{_named(key)} must be a number, not {shown(value)}")
    return found


def numbers(value: Any, key: str, count: int | None = None) -> list[float]:
    """A list of numbers, of ``count`` if that is given. Raises InputError."""
    found = [_number(element) for element in value] if isinstance(value, list | tuple) else [None]
    if None in found or count not in (None, len(found)):
        wanted = "a list of numbers" if count is None else f"a list of {count} numbers"
        raise InputError(f"{_named(key)} must be {wanted}, not {shown(value)}")
    return [element for element in found if element is not None]


def matrix(value: Any, key: str, rows: int, columns: int) -> np.ndarray:
    """(rows, columns), from a list of rows or one of all numbers, row by row. Raises InputError."""
    flat = value
    if isinstance(value, list) and len(value) == rows and all(isinstance(row, list) for row in value):
        flat = [element for row in value for element in row] if all(len(row) == columns for row in value) else None
    found = [_number(element) for element in flat] if isinstance(flat, list) else []
    if None in found or len(found) != rows * columns:
        raise InputError(f"{_named(key)} must be {rows} rows of {columns} numbers, not {shown(value)}")
    return np.array(found, dtype=float).reshape(rows, columns)


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        return float(value)
    except ValueError:
        return None
    except OverflowError:  # a whole number beyond all floating ones
        return math.inf if isinstance(value, int) and value > 0 else -math.inf


def _named(key: str) -> str:
    return one_line(key, _LONGEST_KEY)
