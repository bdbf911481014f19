"""How far a work of some length is, told to whoever asked: in a line each, or as a bar on stderr."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

_LINE_EACH = 10.0  # seconds between two lines where stderr is no terminal
_SELDOM = 1.0  # seconds between two lines of the same step


@dataclass(frozen=True)
class Progress:
    """step: what is being done. done of total images, views of them with the target; total 0 where it has no parts."""

    step: str
    done: int = 0
    total: int = 0
    views: int | None = None

    def __str__(self) -> str:
        if not self.total:
            return self.step
        with_target = "" if self.views is None else f", the target in {self.views}"
        return f"{self.step}: {self.done} of {self.total} images{with_target}"


OnProgress = Callable[[Progress], object]  # an exception from it ends the work and reaches the caller


def unheard(_: Progress) -> None:
    """For whoever does not want to know."""


def seldom(on_progress: OnProgress) -> OnProgress:
    """The begin and end of each step, and in between at most a call a second: fit to be printed."""
    last = Progress("")
    told = -_SELDOM

    def tell(now: Progress) -> None:
        nonlocal last, told
        news = now.step != last.step or now.done == now.total
        if now == last or not (news or time.monotonic() - told >= _SELDOM):
            return
        last, told = now, time.monotonic()
        on_progress(now)

    return tell


class ProgressBars:
    """Draws what it is called with as a bar a step where stderr is a terminal; elsewhere it prints a line each 10 s.

    Left, it ends the last bar.
    """

    def __init__(self) -> None:
        self._step = ""
        self._bar: Any = None
        self._last = Progress("working")
        self._left = threading.Event()

    def __enter__(self) -> ProgressBars:
        if not sys.stderr.isatty():
            threading.Thread(target=self._print_lines, args=(time.monotonic(),), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._left.set()
        self._end_bar()

    def _print_lines(self, began: float) -> None:
        while not self._left.wait(_LINE_EACH):
            print(f"{self._last}; {time.monotonic() - began:.0f} s so far", file=sys.stderr, flush=True)

    def _end_bar(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __call__(self, now: Progress) -> None:
        self._last = now
        if not now.total:
            self._end_bar()
            if sys.stderr.isatty():
                print(now, file=sys.stderr, flush=True)
            return
        if self._bar is None or now.step != self._step:
            self._end_bar()
            self._step, self._bar = now.step, progress_bar(what=now.step, total=now.total)
        self._bar.total = now.total
        if now.views is not None:
            self._bar.set_postfix(found=now.views, refresh=False)
        self._bar.update(now.done - self._bar.n)
        if now.done >= now.total:
            self._end_bar()


class _Silent:
    """What is used of a tqdm bar, without a word."""

    def __init__(self, iterable: Iterable[Any] = (), total: int | None = None) -> None:
        self._iterable = iterable
        self.n = 0
        self.total = total

    def __iter__(self) -> Iterator[Any]:
        return iter(self._iterable)

    def __enter__(self) -> _Silent:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, count: int = 1) -> None:
        self.n += count

    def set_postfix(self, **_: object) -> None:
        pass

    def close(self) -> None:
        pass


def progress_bar(iterable: Iterable[Any] | None = None, what: str = "", *, total: int | None = None) -> Any:
    """A tqdm bar with rate and time left, shown where stderr is a terminal; without tqdm there is none."""
    try:
        from tqdm import tqdm
    except ModuleNotFoundError:
        return _Silent(() if iterable is None else iterable, total)
    # disable=None: shown where stderr is a terminal.
    return tqdm(iterable, what, total=total, unit="image", file=sys.stderr, disable=None)
