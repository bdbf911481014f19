"""Numbers that Python calls are given; what is something else is refused by the parameter's name."""

from __future__ import annotations

from numbers import Real

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown


def real_argument(value: object, name: str) -> float:
    """A number; NaN and infinities are some. Raises InputError."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise InputError(f"`{name}` must be a number, not {shown(value)}")
    return float(value)


def positive_length(value: object, name: str) -> float:
    """Metres, inf too. Raises InputError."""
    length = real_argument(value, name)
    if not length > 0:
        raise InputError(f"`{name}` must be positive, not {length:g} m")
    return length
