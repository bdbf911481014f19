"""One structure fitted from nothing, each place once, without wrong poses and wrong sightings."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.lens_field_estimate import with_lens_field
from fisheye_ep_calib.calibration.estimating.point_names import recounted
from fisheye_ep_calib.calibration.estimating.pose_repair import repaired
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.calibration.estimating.sightings import MIN_VIEWS, Sightings, prepare
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHUTTER
from fisheye_ep_calib.calibration.estimating.view_effects_estimate import with_view_effects
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.options import AUTO, Options
from fisheye_ep_calib.calibration.selecting.cross_validation import shape_predicts
from fisheye_ep_calib.calibration.selecting.independent_views import without_copies, without_resting_views
from fisheye_ep_calib.calibration.selecting.outliers import (
    RejectedPoint,
    Screening,
    huber_fit,
    richest_structure,
    screen,
    screen_with_shape,
)
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS, Structure
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.target.shape.faces import faces_of
from fisheye_ep_calib.target.shape.model import BOW, FLAT, FREE

_DRAGGED = 5.0  # RMS over the median residual, beyond which wrong points pull at a fit
_CLOSE = 1e-5  # tolerance of a fit that only tells which point is which


@dataclass(frozen=True)
class ScreenedFit:
    """fit: the base structure, without wrong sightings, from ``start``; with the target's shape where that is free.

    reasons: for or against that shape. The rest as in ``CalibrationResult``.
    """

    start: Fit
    fit: Fit
    rejected: tuple[RejectedPoint, ...]
    wrong_views: tuple[int, ...]
    seconds: dict[str, float]
    same_place: dict[int, tuple[int, ...]]
    reasons: tuple[str, ...] = ()


def screened_fit(
    observations: Observations, settings: Options, base: Structure, shape: str = FLAT, families: Sequence[str] = ()
) -> ScreenedFit:
    """Fit the base structure from nothing, each place once, mend wrong poses and leave out wrong sightings.

    shape: of BOARD_SHAPES. families: pupils with which a free shape is judged.
    """
    started = time.perf_counter()
    field = LENS_FIELD.name in base.extras  # which comes last: what is wrong with points or poses would pass for it
    base = replace(base, extras=tuple(name for name in base.extras if name != LENS_FIELD.name))
    start, same_place = _first_fit_of_places(observations, settings, base)
    initialized = time.perf_counter()
    fit = _in_stages(start, base)
    mended = repaired(fit)
    if mended is not fit:
        start, fit = refine(mended, start.structure), mended
    start, fit, alike = _counted_alike(start, fit, shape)
    adjusted = time.perf_counter()
    reasons: tuple[str, ...] = ()
    if shape in (FREE, AUTO) and faces_of(fit.sightings.observations.object_points):
        screening, fit, reasons = _with_shape(start, fit, settings, shape, families)
    else:
        screening = Screening(huber_fit(start, fit), (), ()) if settings.loss == "huber" else screen(start, fit)
        if screening.start is not start:
            fit = refine(screening.start, base)
    effects = (*((FLEX, IN_PLANE) if settings.flex else ()), *(SHUTTER if settings.rolling_shutter else ()))
    if effects:
        fit = with_view_effects(fit, effects)
    if field:
        fit = _with_field(fit)
    if effects or field:
        screening = replace(screening, start=fit)
    seconds = {
        "initialize": initialized - started,
        "adjust": adjusted - initialized,
        "screen": time.perf_counter() - adjusted,
    }
    left_out = (screening.rejected, screening.wrong_views)
    return ScreenedFit(screening.start, fit, *left_out, seconds, same_place, (*alike, *reasons))


def _with_field(fit: Fit) -> Fit:
    try:
        return with_lens_field(fit, shape_anew=True)
    except np.linalg.LinAlgError:  # the views leave open even less
        return fit


def _in_stages(start: Fit, base: Structure) -> Fit:
    """The base structure from a first fit: one with further terms of the pupil or of r(θ) by way of the usual ones.

    All of them free at once, far from the truth, may end where r(θ) has taken the pupil's part.
    """
    usual = replace(base, terms=None, lens=LENS if base.lens == FREER_LENS else base.lens)
    if base.lens == usual.lens and base.pupil_terms <= usual.pupil_terms:
        return refine(start, base)
    return refine(refine(start, usual), base)


def _counted_alike(start: Fit, fit: Fit, shape: str) -> tuple[Fit, Fit, tuple[str, ...]]:
    """Both fits with all views counting a plain lattice alike, where its shape matters, and what was done for it."""
    observations = fit.sightings.observations
    if not observations.mistakable or (shape not in (FREE, AUTO) and observations.board is None):
        return start, fit, ()
    rich = richest_structure(fit.structure, fit.sightings, FLAT)
    plain = refine(fit, rich, tolerance=_CLOSE)
    if plain.rms_px > _DRAGGED * plain.median_px * plain.sightings.usual_weight:
        plain = refine(huber_fit(start, fit), rich, tolerance=_CLOSE)
    alike, images = recounted(plain)
    if not images:
        return start, fit, ()
    told = (
        f"{len(images)} of {len(fit.sightings.images)} views count the board's points from another corner, or some "
        "rows on: its shape tells, and they are counted as the others"
    )
    sightings = replace(alike.sightings, loss=fit.sightings.loss)
    return refine(alike, start.structure, sightings), refine(alike, fit.structure, sightings), (told,)


def _first_fit_of_places(
    observations: Observations, settings: Options, base: Structure
) -> tuple[Fit, dict[int, tuple[int, ...]]]:
    """A first fit to views that are independent, and which images each of them stands for (independent_views.py)."""
    _refuse_alike_views(observations)
    different = without_copies(observations)
    _refuse_few_places(observations.view_count, different.observations.view_count)
    sightings = prepare(different.observations, settings.disc_centers)
    _refuse_warp_of_solid(sightings, base)
    start = first_fit(sightings, base.lens)
    resting = without_resting_views(start)
    if resting.images:
        _refuse_few_places(observations.view_count, resting.observations.view_count)
        start = refine(start, start.structure, prepare(resting.observations, settings.disc_centers))
    return start, _together(different.images, resting.images)


def _together(copies: dict[int, tuple[int, ...]], resting: dict[int, tuple[int, ...]]) -> dict[int, tuple[int, ...]]:
    """Image number → the images at its place, from copies of images and from images of a board at rest."""
    places = {
        first: tuple(sorted(image for member in images for image in copies.get(member, (member,))))
        for first, images in resting.items()
    }
    placed = {image for images in places.values() for image in images}
    return places | {first: images for first, images in copies.items() if first not in placed}


def _with_shape(
    start: Fit, fit: Fit, settings: Options, shape: str, families: Sequence[str]
) -> tuple[Screening, Fit, tuple[str, ...]]:
    """Estimate the target's shape, leave out wrong sightings, and fit the structure again; reasons for the shape.

    "auto" keeps the shape where folds over views are predicted better with it.
    """
    if settings.loss == "huber":
        rough = huber_fit(start, fit)
        screening = Screening(
            with_estimated_shape(rough, richest_structure(fit.structure, fit.sightings, FLAT)), (), ()
        )
    else:
        screening = screen_with_shape(fit, families)
    shaped = screening.start
    reasons: tuple[str, ...] = ()
    if shape == AUTO:
        kept, reasons = shape_predicts(shaped, fit.structure)
        shape = FREE if kept else FLAT
    return screening, refine(shaped, replace(fit.structure, board_shape=shape)), reasons


def _refuse_warp_of_solid(sightings: Sightings, base: Structure) -> None:
    if base.board_shape == BOW and not sightings.features.board.planar:
        raise CalibrationError("a board warp needs a flat target; this one has depth: leave `board_warp` away")


def _refuse_alike_views(observations: Observations) -> None:
    """Refuse a set in which every view shows the target at the same place."""
    views = observations.view_count
    order = np.argsort(observations.point_index, kind="stable")
    pixels = observations.pixels[order]
    starts = np.flatnonzero(np.diff(observations.point_index[order], prepend=-1))
    spread = float((np.maximum.reduceat(pixels, starts) - np.minimum.reduceat(pixels, starts)).max())
    if views >= MIN_VIEWS and spread < 0.01 * max(observations.image_size):
        raise CalibrationError(
            f"all {views} views are alike (no point moves more than {spread:.1f} px): "
            "move and tilt the target, near and far, and out to the edge of the image"
        )


def _refuse_few_places(images: int, places: int) -> None:
    """Refuse a set of enough images that show too few places."""
    if images >= MIN_VIEWS > places:
        raise CalibrationError(
            f"{images} images show {places} places, and at least {MIN_VIEWS} are needed: copies, and images of a board "
            "at rest, count as one view each; move and tilt the target between images"
        )
