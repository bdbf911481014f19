"""Where axes stand in a figure, and the SVG of what stands there. Lengths in points; y down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.report.drawing.raster import as_address
from fisheye_ep_calib.report.drawing.scales import Scale

INK, FAINT, PAPER = "var(--ink)", "var(--line)", "var(--card)"
FONT = 9.5  # of numbers; labels have 10
_LETTER = 0.58  # of the font's size: how wide a letter is about
_DPI = 200  # of what is drawn as pixels

Dash = Sequence[float]


@dataclass(frozen=True)
class Frame:
    """The box of axes whose scales have their limits. polar: x is an azimuth, clockwise from the right, y a radius."""

    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale
    polar: bool = False

    @property
    def pixels(self) -> tuple[int, int]:
        """(h, w) of a picture that fills it."""
        return round(self.height * _DPI / 72), round(self.width * _DPI / 72)

    @property
    def radius(self) -> float:
        """Of polar axes."""
        return min(self.width, self.height) / 2

    def places(self, x: np.ndarray, y: np.ndarray) -> FloatArray:
        """Of data (n,), (n, 2) in the figure."""
        if self.polar:
            reach = self.radius * self.y.place(np.asarray(y))
            u, v = reach * np.cos(x), reach * np.sin(x)
            return np.stack([self.left + self.width / 2 + u, self.top + self.height / 2 + v], axis=-1)
        return np.stack(
            [self.left + self.width * self.x.place(x), self.top + self.height * (1 - self.y.place(y))], axis=-1
        )

    def in_picture(self, x: np.ndarray, y: np.ndarray) -> FloatArray:
        """The same in pixels of the picture that fills the box."""
        corner = np.array([self.left, self.top])
        return np.asarray((self.places(x, y) - corner) * _DPI / 72 - 0.5)

    def data_of_pixels(self) -> tuple[FloatArray, FloatArray]:
        """x and y (h, w) at the middle of every pixel of that picture."""
        rows, columns = self.pixels
        v, u = (np.arange(rows) + 0.5)[:, None] / rows, (np.arange(columns) + 0.5)[None] / columns
        if self.polar:
            right, down = (u - 0.5) * self.width / self.radius, (v - 0.5) * self.height / self.radius
            return np.arctan2(down, right), self.y.limits()[1] * np.hypot(right, down)
        x, y = (_value(scale, share) for scale, share in ((self.x, u), (self.y, 1 - v)))
        return np.broadcast_to(x, (rows, columns)), np.broadcast_to(y, (rows, columns))

    def image(self, picture: np.ndarray) -> str:
        """A picture (h, w, 4) that fills the box."""
        return (
            f'<image x="{self.left:.2f}" y="{self.top:.2f}" width="{self.width:.2f}" height="{self.height:.2f}" '
            f'preserveAspectRatio="none" xlink:href="{as_address(picture)}"/>'
        )


def _value(scale: Scale, share: np.ndarray) -> FloatArray:
    first, last = scale.limits()
    return np.asarray(first * (last / first) ** share if scale.logarithmic else first + (last - first) * share)


def line(
    places: np.ndarray, colour: str, width: float, alpha: float = 1.0, dash: Dash = (), closed: bool = False
) -> str:
    """Through places (n, 2), broken at NaN."""
    pattern = f";stroke-dasharray:{' '.join(f'{width * each:.1f}' for each in dash)}" if dash else ""
    faint = f";stroke-opacity:{alpha:g}" if alpha < 1 else ""
    look = f"fill:none;stroke:{colour};stroke-width:{width:g}{pattern}{faint}"
    return f'<path d="{outline(places, closed)}" style="{look}"/>'


def area(places: np.ndarray, colour: str, alpha: float = 1.0) -> str:
    """Filled; several closed outlines (m, n, 2), or one (n, 2)."""
    rings = places[None] if places.ndim == 2 else places
    faint = f";fill-opacity:{alpha:g}" if alpha < 1 else ""
    return f'<path d="{"".join(outline(ring, True) for ring in rings)}" style="fill:{colour}{faint}"/>'


def outline(places: np.ndarray, closed: bool = False) -> str:
    """Path data."""
    told, begins = [], True
    for u, v in np.round(places, 2).tolist():
        if u != u or v != v:
            begins = True
            continue
        told.append(f"{'M' if begins else 'L'}{u:g} {v:g}")
        begins = False
    return "".join(told) + ("z" if closed and told else "")


def markers(places: np.ndarray, kind: str, size: float, colour: str, width: float = 1.0) -> str:
    """Discs "o" or crosses "x" at places (n, 2), size across."""
    half, kept = size / 2, np.round(places[np.isfinite(places).all(axis=1)], 2).tolist()
    if kind == "x":
        crosses = "".join(
            f"M{u - half:g} {v - half:g}l{size:g} {size:g}m0 {-size:g}l{-size:g} {size:g}" for u, v in kept
        )
        return f'<path d="{crosses}" style="fill:none;stroke:{colour};stroke-width:{width:g}"/>'
    round_about = f"a{half:g} {half:g} 0 1 0 {size:g} 0a{half:g} {half:g} 0 1 0 {-size:g} 0"
    discs = "".join(f"M{u - half:g} {v:g}{round_about}" for u, v in kept)
    return f'<path d="{discs}" style="fill:{colour}"/>'


def text(
    words: str, u: float, v: float, size: float = FONT, anchor: str = "start", turned: bool = False, colour: str = INK
) -> str:
    """Words whose baseline begins, or has its middle or end, at a place; turned: read from below."""
    turn = f' transform="rotate(-90 {u:.2f} {v:.2f})"' if turned else ""
    told = words.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    look = f"font: {size:g}px var(--sans); text-anchor: {anchor}; fill: {colour}"
    return f'<text x="{u:.2f}" y="{v:.2f}" style="{look}"{turn}>{told}</text>'


def width_of(words: str, size: float = FONT) -> float:
    """About how wide words are."""
    return _LETTER * size * len(words)
