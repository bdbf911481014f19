"""The report's figures one by one, on matplotlib's axes, for notebooks and one's own pages."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.report.data import CameraReport, StandInLoss
from fisheye_ep_calib.report.figures.board import draw_board
from fisheye_ep_calib.report.figures.coverage import draw_coverage, draw_distances, draw_uncertainty
from fisheye_ep_calib.report.figures.curves import draw_lens, draw_near_far, draw_pupil, draw_stand_in
from fisheye_ep_calib.report.figures.residuals import (
    draw_residual_vectors,
    draw_residuals_by_angle,
    draw_residuals_by_distance,
)


class CameraPlots:
    """Each draws on the axes given, or on new ones, and returns them."""

    def __init__(self, page: CameraReport) -> None:
        self._page = page

    def entrance_pupil(self, ax: Axes | None = None) -> Axes:
        """E(θ), mm, with its 1σ band, of every model that was compared."""
        return _drawn(ax, draw_pupil, self._page.models)

    def lens(self, ax: Axes | None = None) -> Axes:
        """What r(θ) departs from the equidistant lens, px, with its 1σ band."""
        return _drawn(ax, draw_lens, self._page.lens)

    def single_viewpoint(self, ax: Axes | None = None) -> Axes:
        """What a consumer of plain CameraInfo loses by distance, px RMS."""
        return _drawn(ax, draw_stand_in, self._page.stand_in or StandInLoss(float("inf"), {}))

    def residuals(self, ax: Axes | None = None) -> Axes:
        """Residuals over the image, enlarged, and their means by cell."""
        return _drawn(ax, draw_residual_vectors, self._page.residuals, self._page.rejected, self._page.image_size)

    def residuals_by_angle(self, ax: Axes | None = None) -> Axes:
        """Residuals against θ."""
        return _drawn(ax, draw_residuals_by_angle, self._page.residuals)

    def residuals_by_distance(self, ax: Axes | None = None) -> Axes:
        """Residuals against the target's distance."""
        return _drawn(ax, draw_residuals_by_distance, self._page.residuals)

    def coverage(self, ax: Axes | None = None) -> Axes:
        """Points by angle and azimuth; red where the image shows a direction that no view filled. On polar axes: others
        are replaced by polar ones at their place.
        """
        return _drawn(_polar(ax), draw_coverage, self._page.coverage)

    def depth(self, ax: Axes | None = None) -> Axes:
        """Points by angle and distance."""
        return _drawn(ax, draw_distances, self._page.residuals)

    def uncertainty(self, ax: Axes | None = None, which: int = 0) -> Axes:
        """1σ of a projected point over the image: which 0 at the distance recorded, 1 at infinity."""
        if not 0 <= which < len(self._page.uncertainty_maps):
            raise InputError(
                f"there are {len(self._page.uncertainty_maps)} maps of the uncertainty; `which` is {which}"
            )
        return _drawn(ax, draw_uncertainty, self._page.uncertainty_maps[which], self._page.image_size)

    def board(self, ax: Axes | None = None) -> Axes:
        """The board as it is: height as colour, what its points are off in the plane as arrows; mm."""
        if self._page.board is None or not self._page.board.bends:
            raise InputError("the board is as its file has it: there is no shape to draw")
        return _drawn(ax, draw_board, self._page.board)

    def near_far(self, ax: Axes | None = None) -> Axes:
        """The nearer and the farther half of the views, each fitted alone, compared at infinity."""
        if self._page.near_far is None:
            raise InputError("the views do not determine a camera by halves: there is no near/far split to draw")
        return _drawn(ax, draw_near_far, self._page.near_far)


def _drawn(ax: Axes | None, draw: Any, *data: Any) -> Axes:
    axes = _new_axes() if ax is None else ax
    draw(axes, *data)
    return axes


def _new_axes(**projection: str) -> Axes:
    from matplotlib import pyplot  # only here: it opens windows, which a server has none of

    return pyplot.figure(layout="constrained").add_subplot(**projection)


def _polar(ax: Axes | None) -> Axes:
    if ax is None:
        return _new_axes(projection="polar")
    if ax.name == "polar":
        return ax
    figure, place = ax.figure, ax.get_subplotspec()
    position = ax.get_position()
    ax.remove()
    if place is not None:
        return figure.add_subplot(place, projection="polar")
    return figure.add_axes(position.bounds, projection="polar")
