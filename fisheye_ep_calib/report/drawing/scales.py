"""From data to the unit interval of an axis, where its ticks are, and how numbers are written beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from fisheye_ep_calib.arrays import FloatArray

MARGIN = 0.05  # of what the data span, where no limit is given
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass
class Scale:
    """One axis. low, high: its ends, where they were given. logarithmic: as log₁₀. ticks: where they were given.

    seen: least and largest value of the data, as far as they were drawn. reversed: from high to low.
    """

    label: str = ""
    low: float | None = None
    high: float | None = None
    logarithmic: bool = False
    margin: float = MARGIN
    reversed: bool = False
    ticks: Sequence[float] | None = None
    texts: Sequence[str] | None = None
    text_of: Callable[[float], str] | None = None
    seen: list[float] = field(default_factory=lambda: [np.inf, -np.inf])

    def see(self, values: np.ndarray) -> None:
        """Widen the axis to finite values."""
        finite = values[np.isfinite(values)]
        if finite.size:
            self.seen = [min(self.seen[0], float(finite.min())), max(self.seen[1], float(finite.max()))]

    def limits(self) -> tuple[float, float]:
        """Its ends in the order in which they are drawn; data without a limit keep a margin."""
        low, high = self.seen if self.seen[0] <= self.seen[1] else (0.1, 1.0)
        if self.logarithmic:
            low, high = np.log10(low), np.log10(high)
        room = self.margin * (high - low) if high > low else max(self.margin * abs(high), 0.5 * (high == 0))
        low, high = (10.0 ** (low - room), 10.0 ** (high + room)) if self.logarithmic else (low - room, high + room)
        ends = (low if self.low is None else self.low, high if self.high is None else self.high)
        return (ends[1], ends[0]) if self.reversed else ends

    def place(self, values: np.ndarray) -> FloatArray:
        """0 at the first end, 1 at the last."""
        first, last = self.limits()
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.logarithmic:
                return np.asarray(np.log10(np.asarray(values) / first) / np.log10(last / first))
            return np.asarray((np.asarray(values, float) - first) / (last - first))

    def marked(self, most: int) -> tuple[FloatArray, list[str]]:
        """Ticks within the limits, at most so many where they were not given, and their texts."""
        low, high = sorted(self.limits())
        if self.ticks is not None:
            ticks = np.asarray(self.ticks, float)
        elif self.logarithmic:
            ticks = log_ticks(low, high)
        else:
            ticks = linear_ticks(low, high, most)
        inside = (ticks >= low - 1e-9 * (high - low)) & (ticks <= high + 1e-9 * (high - low))
        if self.texts is not None:
            texts = list(self.texts)
        elif self.text_of is not None:
            texts = [self.text_of(float(tick)) for tick in ticks]
        else:
            texts = plain_numbers(ticks, self.logarithmic)
        return ticks[inside], [text for text, kept in zip(texts, inside, strict=True) if kept]


def linear_ticks(low: float, high: float, most: int) -> FloatArray:
    """Multiples of 1, 2, 2.5 or 5 times a power of ten from low to high, at most so many and one more."""
    wanted = max((high - low) / max(most, 1), 1e-300)
    decade = 10.0 ** np.floor(np.log10(wanted))
    step = decade * next(each for each in _STEPS if each * decade >= wanted * (1 - 1e-9))
    return np.asarray(step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) + 0.0)


def log_ticks(low: float, high: float) -> FloatArray:
    """Powers of ten, where there are few with 2 and 5 between them."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    inside = decades[(decades >= low) & (decades <= high)]
    return inside if len(inside) > 2 else np.outer(decades, (1, 2, 5)).ravel()


def plain_numbers(ticks: np.ndarray, each_by_itself: bool = False) -> list[str]:
    """With as many decimals as the ticks need, and a minus of its own length."""
    if each_by_itself:
        return [f"{tick:g}".replace("-", "−") for tick in ticks]
    for decimals in range(13):
        if np.allclose(np.round(ticks, decimals), ticks, rtol=0, atol=1e-6 * max(np.ptp(ticks), 1e-300)):
            break
    return [f"{tick + 0.0:.{decimals}f}".replace("-", "−") for tick in np.round(ticks, decimals)]
