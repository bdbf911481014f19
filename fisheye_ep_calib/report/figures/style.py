"""What the figures have in common: colours that are seen on a light and on a dark page, and how a figure becomes SVG.

Axes and text take CSS variables of the page around them, so that one figure serves both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias, Union

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.report.drawing import PageAxes, page_figure

if TYPE_CHECKING:  # a page is made without matplotlib, which takes as long to load as all figures take to draw
    from fisheye_ep_calib.report.drawing.notebook import NotebookAxes

AnyAxes: TypeAlias = Union[PageAxes, "NotebookAxes"]

SERIES = ("#2f81c9", "#d9730d", "#2a9d6f", "#a35bc4", "#c9485b", "#8a8f98")
ACCENT, SECOND = SERIES[0], SERIES[1]
MAP = "viridis"


def svg(
    draw: Callable[[PageAxes], object], identity: str, size: tuple[float, float] = (4.6, 3.1), polar: bool = False
) -> str:
    """Draw a figure of ``size`` inches. identity: unique in the page; prefixes every id within the SVG."""
    axes = PageAxes(polar)
    draw(axes)
    return page_figure(axes, identity, size)


def plain_log_ticks(values: np.ndarray) -> FloatArray:
    """1, 2, 5, 10, … within the values."""
    decades = 10.0 ** np.arange(np.floor(np.log10(values.min())), np.ceil(np.log10(values.max())) + 1)
    ticks = np.outer(decades, (1, 2, 5)).ravel()
    return np.asarray(ticks[(ticks >= values.min()) & (ticks <= values.max())])
