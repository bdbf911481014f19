"""The figures of one camera in the order of the page, each with its title and how to read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget
from fisheye_ep_calib.calibration.words import distance_text, sentence
from fisheye_ep_calib.report.data import CameraReport, StandInLoss
from fisheye_ep_calib.report.figures.board import board_figure
from fisheye_ep_calib.report.figures.coverage import coverage_figure, distance_figure, uncertainty_figure
from fisheye_ep_calib.report.figures.curves import lens_figure, near_far_figure, pupil_figure
from fisheye_ep_calib.report.figures.residuals import (
    drawn_residuals,
    residual_vectors_figure,
    residuals_by_angle_figure,
    residuals_by_distance_figure,
)

_LEAST_LOSS = 1e-3  # px; less cannot be told from nothing
_SOURCES = {
    "corner_noise_px": "corner noise",
    "board_px": "board, its shape",
    "board_rough_px": "board, single points",
    "lens_px": "lens",
    "view_px": "from view to view",
}


@dataclass(frozen=True)
class Bar:
    """A number of a few that are compared: text beside a bar, share (0 to 1) of the room long."""

    label: str
    text: str
    share: float


@dataclass(frozen=True)
class Panel:
    """A figure of the page. identity: its anchor, unique in the page. caption: how to read it. svg or bars: what it is.

    Few numbers are bars of the page itself.
    """

    identity: str
    title: str
    svg: str
    caption: str
    bars: tuple[Bar, ...] = ()


def panels_of(camera: CameraReport, prefix: str) -> dict[str, tuple[Panel, ...]]:
    """Section → its panels. prefix: unique to the camera, made of letters, digits and -."""
    sections = {
        "The camera": _camera_panels(camera, prefix),
        "Residuals": _residual_panels(camera, prefix),
        "The target": _board_panels(camera, prefix),
        "What was recorded": _coverage_panels(camera, prefix),
        "What is left uncertain": _uncertainty_panels(camera, prefix),
    }
    return {title: panels for title, panels in sections.items() if panels}


def _camera_panels(camera: CameraReport, prefix: str) -> tuple[Panel, ...]:
    panels = []
    if camera.budget is not None:
        identity = f"{prefix}-budget"
        panels.append(
            Panel(
                identity,
                "Where the residuals come from",
                "",
                f"What each source does to the points, RMS of (dx, dy) over all of them, px: {camera.budget.sentence}.",
                budget_bars(camera.budget),
            )
        )
    identity = f"{prefix}-pupil"
    several = len(camera.models) > 1
    panels.append(
        Panel(
            identity,
            "Entrance pupil E(θ)",
            pupil_figure(camera.models, identity),
            "How far the point through which rays enter moves along the axis, by the angle of incidence, with its 1σ "
            "band (negative: toward the scene)"
            + (", for every model that was compared. Where the bands overlap, the models agree." if several else "."),
        )
    )
    identity = f"{prefix}-lens"
    panels.append(
        Panel(
            identity,
            "Lens r(θ) against the equidistant",
            lens_figure(camera.lens, identity),
            "What the lens departs from r = f θ, in pixels, with its 1σ band in a lighter blue, at most "
            f"{camera.lens.sigma_px.max():.2g} px.",
        )
    )
    if camera.stand_in is not None:
        bars = stand_in_bars(camera.stand_in)
        if bars:
            panels.append(
                Panel(
                    f"{prefix}-stand-in",
                    "What a single viewpoint loses",
                    "",
                    "RMS error of a consumer that reads only the plain CameraInfo, which is best at "
                    f"{distance_text(camera.stand_in.distance_m)}, over the image at each distance.",
                    bars,
                )
            )
    return tuple(panels)


def budget_bars(budget: ErrorBudget) -> tuple[Bar, ...]:
    """RMS, px, of each source."""
    shares = budget.to_dict()
    most = max(*shares.values(), 1e-12)
    return tuple(Bar(_SOURCES[name], f"{value:.3f}", value / most) for name, value in shares.items())


def stand_in_bars(stand_in: StandInLoss) -> tuple[Bar, ...]:
    """RMS, px, lost at each distance; none where nothing is."""
    losses = {distance: stand_in.loss_px[distance] for distance in sorted(stand_in.loss_px)}
    most = max((loss for loss in losses.values() if np.isfinite(loss)), default=0.0)
    if most < _LEAST_LOSS:
        return ()
    return tuple(
        Bar(distance_text(distance), f"{loss:.2g} px", min(loss / most, 1.0) if np.isfinite(loss) else 0.0)
        for distance, loss in losses.items()
    )


def _residual_panels(camera: CameraReport, prefix: str) -> tuple[Panel, ...]:
    identity = f"{prefix}-vectors"
    drawn, factor, mean_factor = residual_vectors_figure(camera.residuals, camera.rejected, camera.image_size, identity)
    crosses = " Red crosses are rejected points." if camera.rejected else ""
    return (
        Panel(
            identity,
            "Over the image",
            drawn,
            f"Blue: {drawn_residuals(camera.residuals)}, {factor:g} times their size; in orange the mean of each "
            f"cell, {mean_factor:g} times. "
            f"Noise points everywhere; arrows that agree with their neighbours are an error of the model.{crosses}",
        ),
        Panel(
            f"{prefix}-by-angle",
            "Against the angle θ",
            residuals_by_angle_figure(camera.residuals, f"{prefix}-by-angle"),
            f"Blue dots: radial parts of {drawn_residuals(camera.residuals)}; orange and green: means with their "
            "standard errors. "
            "A mean that leaves zero by more than its bar shows a lens the model does not follow.",
        ),
        Panel(
            f"{prefix}-by-distance",
            "Against the distance",
            residuals_by_distance_figure(camera.residuals, f"{prefix}-by-distance"),
            f"Blue dots: lengths of {drawn_residuals(camera.residuals)}; orange: their RMS. "
            "An RMS that rises toward the near end tells of an entrance pupil that is "
            "missing or wrong, or of blur.",
        ),
    )


def _board_panels(camera: CameraReport, prefix: str) -> tuple[Panel, ...]:
    """Nothing where the target is as its file has it."""
    board = camera.board
    if board is None or not board.bends:
        return ()
    identity = f"{prefix}-board"
    drawn, factor = board_figure(board, identity)
    return (
        Panel(
            identity,
            "The target against its file",
            drawn,
            f"{sentence(board.sentence)} Colours: height along the board's z axis, which on a print whose y "
            "runs down points away from you: red lies behind the plane, blue before it. Violet arrows: by how much "
            f"points are off within the plane, {factor:g} times its size.",
        ),
    )


def _coverage_panels(camera: CameraReport, prefix: str) -> tuple[Panel, ...]:
    coverage = camera.coverage
    missing = int(coverage.missing.sum())
    cell = f"{coverage.missing_ring_degrees:g}° × {360 / coverage.missing.shape[1]:g}°"
    gaps = f"Every cell of {cell} that the image shows is covered."
    if missing:
        cells = "1 cell" if missing == 1 else f"{missing} cells"
        gaps = f"Red: {cells} of {cell} that the image shows and no view filled."
    return (
        Panel(
            f"{prefix}-coverage",
            "Coverage by angle and azimuth",
            coverage_figure(camera.coverage, f"{prefix}-coverage"),
            f"Points by direction as seen in the image, the axis in the middle; the scale tells how many a "
            f"colour stands for. {gaps}",
        ),
        Panel(
            f"{prefix}-depth",
            "Coverage by angle and distance",
            distance_figure(camera.residuals, f"{prefix}-depth"),
            "The scale tells how many points a colour stands for. "
            "The pupil is told from the lens where a column at a large angle is filled over a wide range of distances.",
        ),
    )


def _uncertainty_panels(camera: CameraReport, prefix: str) -> tuple[Panel, ...]:
    panels = []
    for number, uncertainty in enumerate(camera.uncertainty_maps):
        identity = f"{prefix}-uncertainty-{number}"
        where = distance_text(uncertainty.distance_m)
        panels.append(
            Panel(
                identity,
                f"Projection uncertainty at {where}",
                uncertainty_figure(uncertainty, camera.image_size, identity),
                "Colours: 1σ per axis in pixels, by the scale. Where noise alone may have moved a projected point. "
                "It knows nothing of errors of the model.",
            )
        )
    if camera.near_far is not None:
        identity = f"{prefix}-near-far"
        panels.append(
            Panel(
                identity,
                "Near against far",
                near_far_figure(camera.near_far, identity),
                f"The nearer half of the views ({camera.near_far.near_m:.3f} m) and the farther half "
                f"({camera.near_far.far_m:.3f} m), each fitted alone and compared at infinity after the best rotation. "
                "A line far above the band is an error that the residuals hide.",
            )
        )
    return tuple(panels)
