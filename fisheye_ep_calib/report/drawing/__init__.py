"""Figures of the page as SVG: what a page needs, at a tenth of what matplotlib takes to load and to draw.

``PageAxes`` has the methods of matplotlib's axes that the figures use, under the same names, so that one function draws
on a page and in a notebook.
"""

from fisheye_ep_calib.report.drawing.axes import PageAxes
from fisheye_ep_calib.report.drawing.figure import page_figure

__all__ = ["PageAxes", "page_figure"]
