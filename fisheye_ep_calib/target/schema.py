"""Reading a target's keys with one clear line for whatever is wrong."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import one_line, shown

LARGEST_COUNT = 500
LEAST_LENGTH = 1e-6  # metres
MOST_POINTS = 10_000
LONGEST_TEXT = 200
MILLIMETRES = 1.0  # a length of so many metres and more was meant in millimetres


class Keys:
    """The keys of one target file; every getter raises InputError naming the file and the key."""

    def __init__(self, values: dict[str, Any], source: str) -> None:
        self._values = values
        self.source = source

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def fail(self, key: str, problem: str) -> InputError:
        return InputError(f"{self.source}: {key} {problem}")

    def get(self, key: str) -> Any:
        return self._values.get(key)

    def _need(self, key: str) -> Any:
        if self._values.get(key) is None:
            raise self.fail(key, "is missing")
        return self._values[key]

    def count(self, key: str, least: int, most: int = LARGEST_COUNT) -> int:
        """A whole number from ``least`` to ``most``."""
        value = self._need(key)
        whole = isinstance(value, (int, float)) and not isinstance(value, bool) and float(value).is_integer()
        if not whole or not least <= value <= most:
            raise self.fail(key, f"must be a whole number from {least} to {most}, not {shown(value)}")
        return int(value)

    def positive(self, key: str) -> float:
        """A finite number above zero."""
        value = self._need(key)
        try:
            number = float(value) if not isinstance(value, bool) else math.nan
        except (TypeError, ValueError):
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            raise self.fail(key, f"must be a positive number, not {shown(value)}")
        return number

    def metres(self, key: str) -> float:
        """A length above zero; one of 1 m or more is taken for millimetres."""
        value = self.positive(key)
        if value < LEAST_LENGTH:
            raise self.fail(key, f"is in metres, and {value:g} is less than anything that can be seen")
        if value >= MILLIMETRES:
            raise self.fail(key, f"is in metres, and {value:g} looks like millimetres: write {value / 1000:g}")
        return value

    def flag(self, key: str) -> bool:
        """False where it is not given."""
        value = self._values.get(key, False)
        if value not in (True, False):
            raise self.fail(key, f"must be true or false, not {shown(value)}")
        return bool(value)

    def text(self, key: str, default: str) -> str:
        value = self._values.get(key, default)
        if not isinstance(value, str) or not 0 < len(value) <= LONGEST_TEXT or not value.isprintable():
            raise self.fail(key, f"must be a line of text, not {shown(value)}")
        return value

    def only(self, allowed: Iterable[str]) -> None:
        """Refuse a key that nothing reads: it is usually a misspelt one."""
        allowed = sorted(allowed)
        for key in self._values:
            if key in allowed:
                continue
            near = difflib.get_close_matches(str(key), allowed, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(allowed)}"
            raise InputError(f"{self.source}: unknown key {one_line(key, 60)}; {hint}")
