"""Results as JSON."""

from __future__ import annotations

import json
import math
from os import PathLike
from typing import Any

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.outside import read_outside
from fisheye_ep_calib.plain_text import one_line

_MOST_BYTES = 1 << 26


def json_text(content: dict[str, Any]) -> str:
    """One line that every JSON reader takes: ASCII, NaN as null, infinities as the words inf and -inf."""
    return _escaped(json.dumps(plain(content), allow_nan=False))


def readable_json(content: dict[str, Any]) -> str:
    """As ``json_text``, for a person too: indented, with letters of every script, and what cannot be seen escaped."""
    return _escaped(json.dumps(plain(content), ensure_ascii=False, indent=1, allow_nan=False))


def read_json(path: str | PathLike[str]) -> Any:
    """What a JSON file says. Raises InputError."""
    try:
        return json.loads(read_outside(path, _MOST_BYTES, "JSON"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{one_line(path)} is not valid JSON: {one_line(first_line(error), 200)}") from None


def _escaped(text: str) -> str:
    """JSON with its escapes for what drives a terminal or turns the direction of writing: DEL even in ASCII."""
    if text.isascii() and "\x7f" not in text:
        return text
    return "".join(c if c.isprintable() or c == "\n" else json.dumps(c)[1:-1].replace("\x7f", "\\u007f") for c in text)


def plain(value: Any) -> Any:
    """Numbers that JSON cannot say become null (NaN) or the words inf and -inf."""
    if isinstance(value, dict):
        return {str(key): plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [plain(element) for element in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value
