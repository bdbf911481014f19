"""Axes of a page: what is drawn on them is kept until their limits are known.

Methods are matplotlib's, with its names and defaults, as far as the figures use them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fisheye_ep_calib.report.drawing import raster
from fisheye_ep_calib.report.drawing.colours import Colouring
from fisheye_ep_calib.report.drawing.frame import FONT, INK, Frame, area, line, markers, text, width_of
from fisheye_ep_calib.report.drawing.scales import Scale

Style = Any  # a dash pattern of matplotlib: "-", "--" or (offset, lengths)
_HEAD, _HEAD_WIDTH, _NECK = 5.0, 3.0, 4.5  # of an arrow, in widths of its shaft


@dataclass(frozen=True)
class Entry:
    """A line of the legend."""

    label: str
    colour: str
    width: float
    dash: Sequence[float]
    marker: str
    size: float


class PageAxes:
    """polar: x is an azimuth, clockwise from the right, y a radius from 0."""

    on_page = True

    def __init__(self, polar: bool = False) -> None:
        self.polar = polar
        self.x, self.y = Scale(), Scale()
        self.aspect_equal = self.framed = self.has_legend = False
        self.has_grid = not polar
        self.entries: list[Entry] = []
        self.legend_place: tuple[str, int] = ("best", 1)
        self.bar: tuple[Colouring, str, Callable[[float], str]] | None = None
        self.points: list[tuple[np.ndarray, np.ndarray]] = []  # what the legend keeps off
        self._marks: list[tuple[float, Callable[[Frame], str]]] = []
        self._words: list[Callable[[Frame], str]] = []  # on top, and not cut off by the box

    def marks(self, frame: Frame) -> str:
        """The SVG of all that was drawn, what lies on top last."""
        return "".join(mark(frame) for _, mark in sorted(self._marks, key=lambda each: each[0]))

    def words(self, frame: Frame) -> str:
        return "".join(word(frame) for word in self._words)

    def _draw(self, level: float, mark: Callable[[Frame], str]) -> None:
        self._marks.append((level, mark))

    def _seen(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        x, y = np.asarray(x, float), np.asarray(y, float)
        self.x.see(x)
        self.y.see(y)
        self.points.append((x, y))
        return x, y

    def set(self, **given: Any) -> None:
        """xlabel, ylabel, xlim, ylim (with None for an end that follows the data) and aspect="equal"."""
        self.aspect_equal |= given.get("aspect") == "equal"
        for scale, name in ((self.x, "x"), (self.y, "y")):
            scale.label = given.get(f"{name}label", scale.label)
            if f"{name}lim" in given:
                low, high = (None if end is None else float(end) for end in given[f"{name}lim"])
                scale.reversed = low is not None and high is not None and low > high
                scale.low, scale.high = (high, low) if scale.reversed else (low, high)

    def over_image(self, size: tuple[int, int]) -> None:
        """Axes over an image: pixels, y down, the frame drawn."""
        width, height = size
        self.framed, self.has_grid = True, False
        self.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u, px", ylabel="v, px")

    def log_ticks(self, axis: str, ticks: ArrayLike) -> None:
        """A logarithmic axis "x" or "y" with ticks as plain numbers."""
        scale = self.x if axis == "x" else self.y
        scale.logarithmic, scale.ticks = True, np.asarray(ticks, float).tolist()

    def margins(self, x: float, y: float) -> None:
        """Room beside the data, as shares of what they span."""
        self.x.margin, self.y.margin = x, y

    def plot(self, x: ArrayLike, y: ArrayLike, kind: str = "-", **look: Any) -> None:
        """Lines "-", "--", "o-", or markers "o", "x", "."; thousands of dots become pixels."""
        x, y = self._seen(x, y)
        colour, width, size = look["color"], look.get("lw", 1.6), look.get("ms", 6.0)
        alpha, dash, level = look.get("alpha", 1.0), dash_of(look.get("ls", kind)), look.get("zorder", 2)
        if kind == ".":
            reach = size / 4 * 200 / 72  # matplotlib's "." is half as large as its size says
            self._draw(
                level,
                lambda frame: frame.image(raster.dots(frame.in_picture(x, y), frame.pixels, reach, colour, alpha)),
            )
            return
        if "-" in kind:
            self._draw(level, lambda frame: line(frame.places(x, y), colour, width, alpha, dash))
        if kind[0] in "ox":
            mark = kind[0]
            self._draw(level, lambda frame: markers(frame.places(x, y), mark, size, colour, look.get("mew", 1.0)))
        if "label" in look:
            shown = kind[0] if kind[0] in "ox" else ""
            self.entries.append(Entry(look["label"], colour, width if "-" in kind else 0.0, dash, shown, size))

    def segments(self, starts: np.ndarray, ends: np.ndarray, color: str, lw: float, alpha: float) -> None:
        """Thousands of lines from places (n, 2) to places (n, 2), as pixels."""
        self._seen(*starts.T)

        def mark(frame: Frame) -> str:
            picture = raster.segments(
                frame.in_picture(*starts.T), frame.in_picture(*ends.T), frame.pixels, lw * 200 / 72, color
            )
            picture[..., 3] = np.round(alpha * picture[..., 3])
            return frame.image(picture)

        self._draw(2, mark)

    def loglog(self, x: ArrayLike, y: ArrayLike, kind: str, **look: Any) -> None:
        """Both logarithmic, with ticks at the points along x."""
        self.x.logarithmic = self.y.logarithmic = True
        self.x.ticks = [float(each) for each in np.asarray(x) if np.isfinite(each)]
        self.plot(x, y, kind, **look)

    def axhline(self, y: float, color: str, lw: float) -> None:
        self.y.see(np.array([y]))

        def mark(frame: Frame) -> str:
            ends = frame.places(np.array(frame.x.limits()), np.full(2, y))
            return line(ends, color, lw)

        self._draw(2, mark)

    def fill_between(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, color: str, alpha: float, lw: float) -> None:
        """A band without an outline; lw must be 0."""
        x = np.asarray(x, float)
        low, high = (np.broadcast_to(np.asarray(side, float), x.shape) for side in (low, high))
        for side in (low, high):
            self._seen(x, side)
        around, sides = np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]])
        self._draw(1, lambda frame: area(frame.places(around, sides), color, alpha))

    def errorbar(self, x: ArrayLike, y: ArrayLike, error: ArrayLike, fmt: str, **look: Any) -> None:
        x, y, error = (np.asarray(each, float) for each in (x, y, error))
        bars = np.stack([y - error, y + error, np.full_like(y, np.nan)], axis=1).reshape(-1)
        across = np.repeat(x, 3)
        self.y.see(bars)
        width = look.pop("elinewidth")
        self._draw(2, lambda frame: line(frame.places(across, bars), look["color"], width))
        self.plot(x, y, fmt, **look)

    def quiver(self, x: ArrayLike, y: ArrayLike, u: ArrayLike, v: ArrayLike, **look: Any) -> None:
        """Arrows of (u, v) in data units; width: of the shaft, as a share of the axes' width."""
        x, y = self._seen(x, y)
        ends = x + np.asarray(u, float), y + np.asarray(v, float)

        def mark(frame: Frame) -> str:
            return area(_arrows(frame.places(x, y), frame.places(*ends), look["width"] * frame.width), look["color"])

        self._draw(look.get("zorder", 3), mark)

    def scatter(self, x: ArrayLike, y: ArrayLike, c: np.ndarray, size: float, edge: str, colouring: Colouring) -> None:
        """Discs of an area, pt², with an outline."""
        x, y = self._seen(x, y)
        across = float(np.sqrt(size))

        def mark(frame: Frame) -> str:
            discs = [
                f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{across / 2:.2f}" style="fill:rgb({r},{g},{b})"/>'
                for (u, v), (r, g, b) in zip(frame.places(x, y), colouring.rgb(c), strict=True)
            ]
            return f'<g style="stroke:{edge};stroke-width:0.4">{"".join(discs)}</g>'

        self._draw(2, mark)

    def pcolormesh(self, columns: np.ndarray, rows: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        """Cells by their edges in ascending order; none where values (rows, columns) are NaN."""
        if not self.polar:
            self._seen(columns, np.full_like(columns, rows[0]))
        self._seen(np.full_like(rows, columns[0]), rows)

        def mark(frame: Frame) -> str:
            x, y = frame.data_of_pixels()
            if frame.polar:
                x = (x - columns[0]) % (2 * np.pi) + columns[0]
            return frame.image(raster.coloured(raster.cells(x, y, columns, rows, values), colouring))

        self._draw(1, mark)

    def contourf(self, x: np.ndarray, y: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        """A field between the nodes (r, c) of a grid."""
        self._field(x, y, values, colouring, raster.grid_field)

    def tripcolor(self, x: np.ndarray, y: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        """A field between points (n,)."""
        self._field(x, y, values, colouring, raster.triangle_field)

    def _field(
        self, x: np.ndarray, y: np.ndarray, values: np.ndarray, colouring: Colouring, between: Callable[..., np.ndarray]
    ) -> None:
        self._seen(x, y)

        def mark(frame: Frame) -> str:
            return frame.image(raster.coloured(between(frame.in_picture(x, y), values, frame.pixels), colouring))

        self._draw(1, mark)

    def barh(self, names: Sequence[str], lengths: Sequence[float], color: str, texts: Sequence[str]) -> None:
        """Bars from above with their names on the left and texts at their ends."""
        rows = np.arange(len(names))
        self._seen([0, *lengths], [0.0] * (len(lengths) + 1))
        self.y.see(np.array([-0.4, len(names) - 0.6]))
        self.y.ticks, self.y.texts, self.y.reversed = rows.tolist(), list(names), True

        def mark(frame: Frame) -> str:
            bars = [
                frame.places(np.array([0, length, length, 0]), row + np.array([-0.4, -0.4, 0.4, 0.4]))
                for row, length in zip(rows, lengths, strict=True)
            ]
            return area(np.array(bars), color)

        self._draw(1, mark)
        for words, length, row in zip(texts, lengths, rows, strict=True):
            self.annotate(words, length, float(row), (3, -0.35 * FONT))

    def text(self, x: float, y: float, words: str, size: float = FONT, box: str = "") -> None:
        """Words about a place; box: the colour behind them."""

        def mark(frame: Frame) -> str:
            u, v = frame.places(np.array([x]), np.array([y]))[0]
            half, behind = width_of(words, size) / 2 + 1, ""
            if box:
                behind = (
                    f'<rect x="{u - half:.2f}" y="{v - 0.62 * size:.2f}" width="{2 * half:.2f}" '
                    f'height="{1.24 * size:.2f}" rx="2" style="fill:{box};fill-opacity:0.75"/>'
                )
            return behind + text(words, u, v + 0.35 * size, size, "middle")

        self._words.append(mark)

    def annotate(self, words: str, x: float, y: float, offset: tuple[float, float]) -> None:
        """Words beside a place, an offset in points to the right and up."""

        def mark(frame: Frame) -> str:
            u, v = frame.places(np.array([x]), np.array([y]))[0]
            return text(words, u + offset[0], v - offset[1])

        self._words.append(mark)

    def color_bar(self, colouring: Colouring, label: str, text_of: Callable[[float], str]) -> None:
        self.bar = (colouring, label, text_of)

    def legend(self, loc: str = "best", ncols: int = 1) -> None:
        self.has_legend, self.legend_place = bool(self.entries), (loc, ncols)

    def frame_line(self, frame: Frame) -> str:
        """The box, or its left and lower side; of polar axes the outermost circle."""
        left, top, right, bottom = frame.left, frame.top, frame.left + frame.width, frame.top + frame.height
        if self.polar:
            return ""
        corners = [[left, top], [left, bottom], [right, bottom]] + [[right, top]] * self.framed
        return line(np.array(corners), INK, 0.7, closed=self.framed)


def dash_of(style: Style) -> Sequence[float]:
    """Lengths of strokes and gaps, in widths of the line."""
    if isinstance(style, tuple):
        return tuple(style[1])
    return (3.7, 1.6) if style == "--" else ()


def _arrows(starts: np.ndarray, ends: np.ndarray, width: float) -> np.ndarray:
    """Outlines (n, 7, 2) of arrows; short ones are smaller as a whole."""
    along = ends - starts
    length = np.linalg.norm(along, axis=1)
    kept = np.isfinite(length) & (length > 1e-9)
    starts, along, length = starts[kept], along[kept], length[kept]
    unit = along / length[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
    own = width * np.minimum(1, length / (_HEAD * width))
    neck, head = length - _NECK * own, length - _HEAD * own
    profile = [(0 * own, own / 2), (neck, own / 2), (head, _HEAD_WIDTH * own / 2), (length, 0 * own)]
    profile += [(forward, -aside) for forward, aside in profile[2::-1]]
    return np.stack([starts + f[:, None] * unit + a[:, None] * normal for f, a in profile], axis=1)
