"""Progress on stderr, by tqdm where it is installed; without it there is none."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import Any


class _Silent:
    """What is used of a tqdm bar, without a word."""

    def __init__(self, iterable: Iterable = (), total: int | None = None) -> None:
        self._iterable = iterable
        self.n = 0
        self.total = total

    def __iter__(self) -> Iterator:
        return iter(self._iterable)

    def __enter__(self) -> _Silent:
        return self

    def __exit__(self, *_) -> None:
        pass

    def update(self, count: int = 1) -> None:
        self.n += count

    def set_postfix(self, **_) -> None:
        pass


def progress_bar(iterable: Iterable | None = None, what: str = "", *, total=None) -> Any:
    """A tqdm bar with rate and time left, shown where stderr is a terminal."""
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        return _Silent(() if iterable is None else iterable, total)
    # disable=None: shown where stderr is a terminal.
    return tqdm(iterable, what, total=total, unit="image", file=sys.stderr, disable=None)
