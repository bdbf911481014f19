"""How commands end, and what counts as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

from known_scenes import CAMERA


def strict_json(text: str) -> dict:
    """One JSON object and nothing else, with numbers that every reader takes."""

    def refuse(word: str):
        raise AssertionError(f"{word} is no JSON")

    value = json.loads(text, parse_constant=refuse)
    assert isinstance(value, dict)
    return value


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict:
        return strict_json(self.out)

    def refused(self, code: int, *words: str) -> None:
        """In one line that holds all the words, with nothing on stdout."""
        assert self.code == code, self.err
        assert self.out == "" and self.err.count("\n") == 1 and self.err.endswith("\n"), self.err
        assert ": error: " in self.err and "Traceback" not in self.err
        for word in words:
            assert word in self.err, self.err


def close_to_truth(values: dict) -> bool:
    return math.isclose(values["fx"], CAMERA.fx, rel_tol=5e-3) and math.isclose(values["cy"], CAMERA.cy, abs_tol=2)
