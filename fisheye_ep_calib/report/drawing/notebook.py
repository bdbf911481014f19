"""The same methods as ``PageAxes`` on matplotlib's axes, for notebooks and one's own pages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, Normalize
from matplotlib.ticker import FuncFormatter
from numpy.typing import ArrayLike

from fisheye_ep_calib.report.drawing.colours import Colouring


class NotebookAxes:
    """What is not told otherwise is as in ``PageAxes``."""

    on_page = False

    def __init__(self, axes: Any) -> None:
        self._axes: Any = axes
        self.polar = axes.name == "polar"
        if self.polar:
            axes.set_theta_direction(-1)
            axes.grid(False)
            axes.set_yticks([])
            axes.set_xticks([])
            axes.spines["polar"].set_visible(False)

    def set(self, **given: Any) -> None:
        if self.polar:
            given = {"rlim": given["ylim"]} if "ylim" in given else {}
        self._axes.set(**given)

    def over_image(self, size: tuple[int, int]) -> None:
        width, height = size
        self._axes.set(
            xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u, px", ylabel="v, px"
        )
        self._axes.grid(False)

    def log_ticks(self, axis: str, ticks: ArrayLike) -> None:
        getattr(self._axes, f"set_{axis}scale")("log")
        of_axis = getattr(self._axes, f"{axis}axis")
        of_axis.set_ticks(ticks, labels=[f"{tick:g}" for tick in np.asarray(ticks)])
        of_axis.set_ticks([], minor=True)

    def margins(self, x: float, y: float) -> None:
        self._axes.margins(x=x, y=y)

    def plot(self, x: ArrayLike, y: ArrayLike, kind: str = "-", **look: Any) -> None:
        if kind == ".":
            look |= {"mew": 0, "rasterized": True}
        self._axes.plot(x, y, *([] if "ls" in look else [kind]), **look)

    def segments(self, starts: np.ndarray, ends: np.ndarray, color: str, lw: float, alpha: float) -> None:
        lines = np.stack([starts, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2)
        self._axes.plot(*lines.T, color=color, lw=lw, alpha=alpha, rasterized=True)

    def loglog(self, x: ArrayLike, y: ArrayLike, kind: str, **look: Any) -> None:
        self._axes.loglog(x, y, kind, **look)
        self._axes.minorticks_off()
        plain = FuncFormatter(lambda value, _: f"{value:g}")
        self._axes.set_xticks([each for each in np.asarray(x) if np.isfinite(each)])
        self._axes.xaxis.set_major_formatter(plain)
        self._axes.yaxis.set_major_formatter(plain)

    def axhline(self, y: float, color: str, lw: float) -> None:
        self._axes.axhline(y, color="0.3", lw=lw)

    def fill_between(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, color: str, alpha: float, lw: float) -> None:
        self._axes.fill_between(x, low, high, color=color, alpha=alpha, lw=lw)

    def errorbar(self, x: ArrayLike, y: ArrayLike, error: ArrayLike, fmt: str, **look: Any) -> None:
        self._axes.errorbar(x, y, error, fmt=fmt, **look)

    def quiver(self, x: ArrayLike, y: ArrayLike, u: ArrayLike, v: ArrayLike, **look: Any) -> None:
        self._axes.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=1, **{"zorder": 3, **look})

    def scatter(self, x: ArrayLike, y: ArrayLike, c: np.ndarray, size: float, edge: str, colouring: Colouring) -> None:
        look = {"edgecolors": "0.2", "linewidths": 0.4, "zorder": 2}
        self._axes.scatter(x, y, c=c, s=size, **look, **_look(colouring))

    def pcolormesh(self, columns: np.ndarray, rows: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        self._axes.pcolormesh(columns, rows, np.ma.masked_invalid(values), rasterized=True, **_look(colouring))

    def contourf(self, x: np.ndarray, y: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        shown = np.ma.masked_invalid(values)
        self._axes.contourf(x, y, shown, levels=colouring.levels, cmap=colouring.name, extend="max")

    def tripcolor(self, x: np.ndarray, y: np.ndarray, values: np.ndarray, colouring: Colouring) -> None:
        self._axes.tripcolor(x, y, values, shading="gouraud", rasterized=True, **_look(colouring))

    def text(self, x: float, y: float, words: str, size: float = 9.5, box: str = "") -> None:
        behind = (
            {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "edgecolor": "none"} if box else None
        )
        self._axes.text(x, y, words, ha="center", va="center", fontsize=size, bbox=behind)

    def annotate(self, words: str, x: float, y: float, offset: tuple[float, float]) -> None:
        self._axes.annotate(words, (x, y), textcoords="offset points", xytext=offset)

    def color_bar(self, colouring: Colouring, label: str, text_of: Callable[[float], str]) -> None:
        look = _look(colouring)
        bar = self._axes.figure.colorbar(ScalarMappable(look["norm"], look["cmap"]), ax=self._axes, shrink=0.85)
        bar.set_label(label)
        bar.outline.set_visible(False)
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: text_of(value)))
        bar.ax.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: ""))

    def legend(self, loc: str = "best", ncols: int = 1) -> None:
        self._axes.legend(loc=loc, ncols=ncols)


def _look(colouring: Colouring) -> dict[str, Any]:
    norm = LogNorm if colouring.logarithmic else Normalize
    by: Any = norm(colouring.low, colouring.high)
    if colouring.levels:
        by = BoundaryNorm(colouring.levels, 256, extend="max")
    return {"cmap": ListedColormap([colouring.name]) if colouring.name.startswith("#") else colouring.name, "norm": by}
