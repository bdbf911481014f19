"""From a matplotlib figure to an SVG that takes its colours and its typeface from the page around it.

Axes and text are drawn in stand-in colours that become CSS variables, so that one figure serves a light and a dark
page; data use colours that are seen on both.
"""

from __future__ import annotations

import contextlib
import gc
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

SERIES = ("#2f81c9", "#d9730d", "#2a9d6f", "#a35bc4", "#c9485b", "#8a8f98")
ACCENT, SECOND = SERIES[0], SERIES[1]
MAP = "viridis"

_INK, _FAINT, _PAPER = "#0a0b0c", "#0d0e0f", "#f1f2f3"
_THEME = {_INK: "var(--ink)", _FAINT: "var(--line)", _PAPER: "var(--card)"}
_SETTINGS: dict[Any, Any] = {  # matplotlib has a type for its settings from 3.11 on
    "svg.fonttype": "none",
    "font.size": 10.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "normal",
    "axes.labelsize": 10.0,
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "axes.titlecolor": _INK,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "grid.color": _FAINT,
    "grid.linewidth": 0.6,
    "hatch.color": _FAINT,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "lines.linewidth": 1.6,
    "patch.linewidth": 0.0,
}
_DPI = 160  # of what is drawn as pixels within the SVG
INK, FAINT, PAPER = _INK, _FAINT, _PAPER


@dataclass(frozen=True)
class Margins:
    """Inches around the axes, for numbers and labels."""

    left: float = 0.68
    right: float = 0.14
    bottom: float = 0.48
    top: float = 0.1


PLAIN, BESIDE_A_BAR = Margins(), Margins(right=0.66)
BAR: dict[str, Any] = {
    "shrink": 0.85,
    "fraction": 0.055,
    "pad": 0.035,
}  # of a colour bar: shares of the axes that it is taken from


def svg(
    draw: Callable[[Figure], object],
    identity: str,
    size: tuple[float, float] = (4.6, 3.1),
    margins: Margins = PLAIN,
) -> str:
    """Draw a figure of ``size`` inches. identity: unique in the page; prefixes every id within the SVG.

    Margins are fixed: a layout that fits itself draws everything twice.
    """
    with matplotlib.rc_context({**_SETTINGS, "svg.hashsalt": identity}), without_collection():
        figure = Figure(figsize=size)
        FigureCanvasSVG(figure)
        figure.subplots_adjust(
            left=margins.left / size[0],
            right=1 - margins.right / size[0],
            bottom=margins.bottom / size[1],
            top=1 - margins.top / size[1],
        )
        draw(figure)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", dpi=_DPI, metadata={"Date": None})
    return _for_page(stream.getvalue(), identity)


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """A figure's thousands of artists refer to each other, and all of them live until it is drawn."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _for_page(text: str, identity: str) -> str:
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    # Numbered, as matplotlib's own names may follow addresses in memory.
    own = {name: f"{identity}-{number}" for number, name in enumerate(re.findall(r'\bid="([^"]*)"', text))}
    text = re.sub(r'\b(id="|href="#|url\(#)([^")]*)', lambda match: match[1] + own.get(match[2], match[2]), text)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font: \1px var(--sans)", text)
    for stand_in, variable in _THEME.items():
        text = text.replace(stand_in, variable)
    return text.replace("<svg ", '<svg aria-hidden="true" focusable="false" ', 1)


def image_axes(axes: Axes, size: tuple[int, int]) -> None:
    """Axes over an image: pixels, y down, the frame drawn."""
    width, height = size
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u, px", ylabel="v, px")
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(True)


def plain_log_ticks(axis: Axis, values: np.ndarray) -> None:
    """Ticks at 1, 2, 5, 10, … within the values, written as plain numbers, on a logarithmic axis."""
    decades = 10.0 ** np.arange(np.floor(np.log10(values.min())), np.ceil(np.log10(values.max())) + 1)
    ticks = np.outer(decades, (1, 2, 5)).ravel()
    ticks = ticks[(ticks >= values.min()) & (ticks <= values.max())]
    axis.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    axis.set_ticks([], minor=True)
