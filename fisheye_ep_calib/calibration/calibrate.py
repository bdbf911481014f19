"""Calibrate one camera from its observations."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.refusal import why_undetermined, why_unusable
from fisheye_ep_calib.calibration.assessing.uncertainty import independent_covariance, uncertainty
from fisheye_ep_calib.calibration.estimating.adjustment import adjust
from fisheye_ep_calib.calibration.estimating.fit import MIN_VIEWS, Fit, Sightings, first_fit, prepare, refine
from fisheye_ep_calib.calibration.estimating.point_names import recounted
from fisheye_ep_calib.calibration.estimating.pose_repair import repaired
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHUTTER
from fisheye_ep_calib.calibration.estimating.view_effects_estimate import with_view_effects
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.result import CalibrationResult
from fisheye_ep_calib.calibration.selecting.independent_views import without_copies, without_resting_views
from fisheye_ep_calib.calibration.selecting.model_selection import Search, choose
from fisheye_ep_calib.calibration.selecting.outliers import (
    RejectedPoint,
    Screening,
    huber_fit,
    richest_structure,
    screen,
    screen_with_shape,
)
from fisheye_ep_calib.calibration.selecting.shape_choice import shape_predicts
from fisheye_ep_calib.calibration.structure import LENS, Structure
from fisheye_ep_calib.camera import LENS_EXTRAS, FisheyeCamera
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.target.registry import load_shape
from fisheye_ep_calib.target.shape.faces import faces_of
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import BOW, FLAT, FREE

AUTO = "auto"
PRINTED_FORM = "ep_odd_target_axis"
DISC_CENTERS = ("unbiased", "naive")
LOSSES = ("cut", "huber")
BOARD_SHAPES = (FLAT, BOW, FREE, AUTO)
_JUDGES = ("ep_even", "ep_odd")  # between them they come near to every pupil
_NO_CAMERA = 0.02  # median error over the longer side of the image
_LOOSE = 0.2  # σ of a focal length over its value, at which it counts as unknown
_DRAGGED = 5.0  # RMS over the median residual, beyond which wrong points pull at a fit
_CLOSE = 1e-5  # tolerance of a fit that only tells which point is which
_SURE = 0.05  # and below which the linear σ is to be believed


@dataclass(frozen=True)
class Options:
    """What the user may fix; None leaves it to ``auto``, or to the model's own default where a model is named.

    terms: of E(θ). lens: key of LENSES. skew, board_warp: whether each is estimated. extras: the same of LENS_EXTRAS.
    board_shape: of BOARD_SHAPES, or one that was measured before and is held; ``of`` also takes a file that has it.
    disc_centers: "unbiased" predicts the centre of gravity of each projected disc, "naive" the image of its centre.
    loss: "cut" leaves out what lies beyond 6 σ of the richest model; "huber" keeps every sighting at less weight.
    flex, rolling_shutter: whether a board that changes from view to view, and a motion within each image, are
    estimated (view_effects.py).
    svp_distance: metres, for which the single-viewpoint stand-in is fitted.
    force: give back a camera that is refused for what its views leave open, with the reason in ``refused``.

    An extra that is asked for is estimated; but ``lens_field``, which passes what is wrong with a view for the lens,
    "auto" takes only where folds over views are predicted better with it.
    """

    terms: int | None = None
    lens: str | None = None
    skew: bool | None = None
    board_warp: bool | None = None
    board_shape: str | BoardShape | None = None
    disc_centers: str = "unbiased"
    loss: str = "cut"
    flex: bool = False
    rolling_shutter: bool = False
    svp_distance: float = np.inf
    force: bool = False
    extras: Mapping[str, bool | None] = field(default_factory=dict)

    @staticmethod
    def of(**given: Any) -> Options:
        """From keywords; the name of a lens extra is one too, such as ``tangential=True``."""
        extras = {name: given.pop(name) for name in LENS_EXTRAS if name in given}
        shape = given.get("board_shape")
        if isinstance(shape, str | PathLike) and shape not in BOARD_SHAPES:
            given["board_shape"] = _shape_of_file(shape)
        return Options(**given, extras=extras)

    def __post_init__(self) -> None:
        choices = (
            ("disc_centers", self.disc_centers, DISC_CENTERS),
            ("loss", self.loss, LOSSES),
        )
        for name, value, words in choices:
            if value not in words:
                raise InputError(f"unknown {name} {value!r}; known: {', '.join(words)}")
        if not self.svp_distance > 0:
            raise InputError(f"`svp_distance` must be positive, not {self.svp_distance:g} m")


def calibrate(observations: Observations, model: str = AUTO, **options: Any) -> CalibrationResult:
    """Calibrate a camera. options: those of ``Options.of``. Raises CalibrationError, InputError.

    A named model is fitted as it is, skew included and the board flat, and nothing else: what judges it is worked out
    when it is looked at (result.py). "auto" fits all models, decides skew, tangential terms and board warp, and takes
    what the data support.
    """
    settings = Options.of(**options)
    observations = _with_board(observations, settings)
    base = base_structure(settings, model)
    families = _JUDGES if model == AUTO else (base.model,)
    screened = _screened_fit(observations, settings, base, _wanted_shape(settings, model), families)
    began = time.perf_counter()
    choice, fit = None, screened.fit
    if model == AUTO:
        choice = choose(screened.start, screened.fit.structure, _open_questions(settings))
        choice = replace(choice, reasons=(*screened.reasons, *choice.reasons))
        fit = choice.chosen.fit
    seconds = screened.seconds | {"compare": time.perf_counter() - began}
    _refuse_unexplained(fit)
    result = CalibrationResult(
        fit, screened.rejected, screened.wrong_views, seconds, choice, settings.svp_distance, screened.same_place
    )
    refused = _why_refused(result)
    if refused is not None:
        if not settings.force:
            raise CalibrationError(f"{refused}, or take it as it is with `force`")
        result = replace(result, refused=refused)
    if np.isfinite(settings.svp_distance):
        _ = result.stand_in  # refuses a distance that is too near
    return result


@dataclass(frozen=True)
class RoughCamera:
    """Good enough to say where in an image the target is. camera: valid to the largest angle seen.

    camera_from_target (V, 4, 4): metres, poses in the images of these numbers, view_images (V,), sorted; images of a
    board at rest share one. seconds: as in ``CalibrationResult``, without "compare".
    """

    camera: FisheyeCamera
    camera_from_target: np.ndarray
    view_images: np.ndarray
    seconds: dict[str, float]


def rough_camera(observations: Observations, model: str = AUTO, **options: Any) -> RoughCamera:
    """What a second look at the images needs of a first calibration: camera and poses, and nothing chosen or judged.

    Takes the arguments of ``calibrate``. The camera is the named model, or for "auto" one with an even pupil; wrong
    sightings are left out. Raises CalibrationError, InputError.
    """
    settings = Options.of(**options)
    observations = _with_board(observations, settings)
    screened = _screened_fit(observations, settings, base_structure(settings, model))
    fit = screened.fit
    _refuse_unexplained(fit)
    camera = replace(fit.state.camera, theta_max=fit.largest_angle)
    poses = dict(zip(fit.sightings.images.tolist(), fit.state.camera_from_target, strict=True))
    for first, images in screened.same_place.items():
        poses |= {image: poses[first] for image in images if first in poses}
    numbers = sorted(poses)
    return RoughCamera(camera, np.array([poses[image] for image in numbers]), np.array(numbers), screened.seconds)


@dataclass(frozen=True)
class _ScreenedFit:
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


def _screened_fit(
    observations: Observations, settings: Options, base: Structure, shape: str = FLAT, families: Sequence[str] = ()
) -> _ScreenedFit:
    """Fit the base structure from nothing, each place once, mend wrong poses and leave out wrong sightings.

    shape: of BOARD_SHAPES. families: pupils with which a free shape is judged.
    """
    started = time.perf_counter()
    start, same_place = _first_fit_of_places(observations, settings, base)
    initialized = time.perf_counter()
    fit = refine(start, base)
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
        screening = replace(screening, start=fit)
    seconds = {
        "initialize": initialized - started,
        "adjust": adjusted - initialized,
        "screen": time.perf_counter() - adjusted,
    }
    found = (screening.rejected, screening.wrong_views)
    return _ScreenedFit(screening.start, fit, *found, seconds, same_place, (*alike, *reasons))


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
        kept, reasons = shape_predicts(shaped)
        shape = FREE if kept else FLAT
    return screening, refine(shaped, replace(fit.structure, board_shape=shape)), reasons


def base_structure(settings: Options, model: str) -> Structure:
    """What the user has fixed. Raises InputError where there is no such model, lens or number of terms."""
    tried = (LENS_FIELD.name,) if model == AUTO else ()
    extras = tuple(name for name in LENS_EXTRAS if settings.extras.get(name) and name not in tried)
    return Structure(
        {AUTO: "ep_even", PRINTED_FORM: "ep_odd"}.get(model, model),
        settings.terms,
        settings.lens or LENS,
        settings.skew is not False,
        extras,
        BOW if _wanted_shape(settings, model) == BOW else FLAT,
        target_axis=model == PRINTED_FORM,
    )


def _wanted_shape(settings: Options, model: str) -> str:
    """The board's shape that the user asked for; a named model takes the board as it is, "auto" looks."""
    if isinstance(settings.board_shape, BoardShape):
        return FLAT
    if settings.board_shape is not None:
        return settings.board_shape
    if settings.board_warp is not None:
        return BOW if settings.board_warp else FLAT
    return AUTO if model == AUTO else FLAT


def _shape_of_file(path: str | PathLike[str]) -> BoardShape:
    if not Path(path).expanduser().exists():
        raise InputError(
            f"unknown board_shape {str(path)!r}; known: {', '.join(BOARD_SHAPES)}, or a file with a measured shape"
        )
    return load_shape(path)


def _with_board(observations: Observations, settings: Options) -> Observations:
    """The observations with the measured shape that the user gives, which must be one of this target."""
    shape = settings.board_shape
    if not isinstance(shape, BoardShape):
        return observations
    if not shape.same_target(observations.object_points):
        raise InputError("the measured shape of `board_shape` belongs to another target than the observations")
    return replace(observations, board=shape)


def _open_questions(settings: Options) -> Search:
    return Search(
        skew=settings.skew is None,
        lens=settings.lens is None,
        extras=(
            *(name for name in ("tangential", "tilt") if settings.extras.get(name) is None),
            *((LENS_FIELD.name,) if settings.extras.get(LENS_FIELD.name) else ()),
        ),
    )


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


def _refuse_unexplained(fit: Fit) -> None:
    """Refuse a camera that explains nothing."""
    if fit.median_px > _NO_CAMERA * max(fit.sightings.observations.image_size):
        raise CalibrationError(
            f"no camera explains the points (half of them are off by {fit.median_px:.0f} px or more): "
            "check that the target file describes the board in the images"
        )


def _why_refused(result: CalibrationResult) -> str | None:
    """Why the views leave the focal length open, by the bands as they are given; None where they do not."""
    if not _focal_length_determined(result.fit):
        return why_undetermined(result.fit)
    parameters = result.uncertainty if result.choice else uncertainty(result.fit)
    return why_unusable(result.fit, parameters)


def _focal_length_determined(fit: Fit) -> bool:
    """Whether it is known to a fifth, also by the likelihood itself where the linear σ is not small.

    Where views leave it open, the valley of equal cost bends: σ may look small where the fit happened to stop.
    """
    _, values = fit.shared_parameters
    try:
        sigma_px, covariance = independent_covariance(fit)
    except np.linalg.LinAlgError:
        return False
    # Not more than independent noise leaves open: a model that does not fit is another matter.
    variance = np.diag(covariance)[:2]
    if not ((variance >= 0) & (variance <= (_LOOSE * values[:2]) ** 2)).all():
        return False
    if (variance <= (_SURE * values[:2]) ** 2).all():
        return True
    least = fit.adjustment.equations.cost + 0.5 * sigma_px**2
    return all(_cost_at(fit, scale) > least for scale in (1 + _LOOSE, 1 / (1 + _LOOSE)))


def _cost_at(fit: Fit, scale: float) -> float:
    """The least cost, px², with both focal lengths held at so many times their values; ∞ for no such camera."""
    camera = fit.state.camera
    held = replace(fit.problem, free=fit.problem.free & ~np.isin(camera.parameter_names, ("fx", "fy")))
    moved = replace(camera, fx=scale * camera.fx, fy=scale * camera.fy)
    equations = adjust(replace(held, theta_limit=np.pi), replace(fit.state, camera=moved)).equations
    return equations.cost if equations.valid else np.inf
