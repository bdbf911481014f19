"""What the recording could and could not tell, each finding with what to record more of.

No error on the calibration set shows what the set never looked at: hence coverage, depth at large angles, and the
near/far split, which fits the nearer and the farther half of the views by themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.asymmetry import not_symmetric
from fisheye_ep_calib.calibration.assessing.board_findings import board_bent, board_scale
from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference, camera_difference
from fisheye_ep_calib.calibration.assessing.coverage import SECTOR_NAMES, azimuth_and_distance, coverage, reachable
from fisheye_ep_calib.calibration.assessing.extent import smaller_lattice
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.assessing.nuisance_models import joint_linearisation
from fisheye_ep_calib.calibration.assessing.pixel_shape import pixels_not_square
from fisheye_ep_calib.calibration.assessing.two_cameras import PARAMETERS, two_cameras
from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.assessing.view_changes import changes_found, view_changes
from fisheye_ep_calib.calibration.estimating.fit import MIN_VIEWS, Fit, of_images, refine
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.parameters import pupil_names
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import FLAT

RING_DEGREES = 15
SECTORS = len(SECTOR_NAMES)
_FARTHEST_M, _LARGEST_PUPIL_M = 20.0, 0.05  # beyond which a length's unit is doubted
_TELLING = 1.0  # px expected between near and far, below which their agreement says something
_FEW_VIEWS = 8  # below which a view more or less changes the camera beyond its bands


@dataclass(frozen=True)
class NearFarSplit:
    """The structure fitted to the nearer and to the farther half of the views, and how the two cameras differ.

    near_m, far_m: median distances of the halves. difference: at infinity, for the field that both have seen.
    """

    near_m: float
    far_m: float
    difference: CameraDifference


@dataclass(frozen=True)
class Diagnosis:
    """counts (rings, sectors): sightings by incidence angle and azimuth. reachable: bool, same shape, in the image.

    view_rms_px (V,): RMS of each view. near_far: None where a half determines no camera. findings: in words.
    """

    counts: np.ndarray
    reachable: np.ndarray
    view_rms_px: np.ndarray
    near_far: NearFarSplit | None
    findings: tuple[Finding, ...]


def diagnose(
    fit: Fit,
    camera: FisheyeCamera,
    names: tuple[str, ...],
    same_place: Mapping[int, tuple[int, ...]] | None = None,
    board: BoardShape | None = None,
    chosen: bool = False,
) -> Diagnosis:
    """camera: the fitted one with its theta_max. names: of the images. same_place: view → images it stands for.

    board: the target's shape as the fit found it. chosen: whether "auto" took the model: what it has tried already is
    no advice.
    """
    theta, azimuth, distance = _sighting_geometry(fit)
    counts = coverage(theta, azimuth, RING_DEGREES, SECTORS)
    in_image = reachable(camera, len(counts), RING_DEGREES, SECTORS)
    view_rms = fit.view_rms
    split = split_near_far(fit, distance)
    findings = [
        _coverage(counts, in_image),
        _depth(theta, distance),
        *([_pupil_against_depth(fit)] if len(camera.coefficients) else []),
        *([_near_far(split, _near_far_advice(fit, chosen))] if split else []),
        _worst_view(fit, view_rms, names),
        *_correlated_residuals(uncertainty(fit).clustering),
        *_copies(len(fit.sightings.images), same_place or {}),
        *_two_cameras(fit, names),
        pixels_not_square(camera),
        *_squares_counted(fit),
        *_units(distance, camera),
        *_view_changes(fit),
        _few_views(len(fit.sightings.images)),
        *not_symmetric(fit),
        *(() if board is None else (board_bent(board), board_scale(board))),
    ]
    return Diagnosis(counts, in_image, view_rms, split, tuple(findings))


def _sighting_geometry(fit: Fit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Incidence angle (rad), azimuth (rad) and distance from the camera (metres) of every sighting used."""
    used = fit.used
    observations, images = fit.sightings.observations, fit.sightings.images
    azimuth, distance = azimuth_and_distance(observations, images, fit.state.camera_from_target, used)
    return fit.residuals[1][used], azimuth, distance


def _coverage(counts: np.ndarray, reachable: np.ndarray) -> Finding:
    covered = (counts > 0) & reachable
    share = covered.sum() / max(reachable.sum(), 1)
    missing = np.argwhere(reachable & (counts == 0))
    values = {"share_of_field": float(share), "rings": float(len(counts))}
    if len(missing) == 0:
        return Finding("coverage", values, False, "every part of the field up to the largest angle seen is covered")
    ring = int(missing[:, 0].max())
    sectors = ", ".join(SECTOR_NAMES[sector] for which, sector in missing if which == ring)
    return Finding(
        "coverage",
        values,
        bool(share < 0.9),
        f"{100 * share:.0f} % of the field is covered; show the target {RING_DEGREES * ring}–"
        f"{RING_DEGREES * (ring + 1)}° off the axis ({sectors})",
    )


def _depth(theta: np.ndarray, distance: np.ndarray) -> Finding:
    """Spread of distance at large angles: what tells a pupil's shift from a longer r(θ)."""
    outer = distance[theta > 0.75 * theta.max()]
    near, far = np.quantile(outer, [0.05, 0.95])
    values = {"nearest_m": float(near), "farthest_m": float(far), "ratio": float(far / near)}
    told = f"beyond {np.degrees(0.75 * theta.max()):.0f}° the target stood {near:.3f}–{far:.3f} m away"
    if far / near >= 2:
        return Finding("depth", values, False, f"{told}: enough to observe the entrance pupil")
    return Finding(
        "depth",
        values,
        True,
        f"{told}; show it there at half and at twice that distance too, which is what makes the pupil observable",
    )


def _pupil_against_depth(fit: Fit) -> Finding:
    """Correlation of E near the rim with the mean t_z of the views; shared parameters and poses together."""
    fit_uncertainty = uncertainty(fit)
    equations, camera = fit.settled, fit.state.camera
    inverse = np.linalg.inv(equations.pose)
    depth_row = -(inverse @ equations.mixed)[:, 5].mean(axis=0)
    own = fit_uncertainty.sigma_px**2 * inverse[:, 5, 5].sum() / len(inverse) ** 2
    angle = 0.9 * fit.largest_angle
    names, _ = fit.shared_parameters
    row = np.zeros(len(names))
    basis = camera.pupil_family.basis(np.array(angle), len(camera.coefficients))
    row[[names.index(name) for name in pupil_names(len(basis))]] = basis
    shared = fit_uncertainty.shared
    spread = np.sqrt((row @ shared @ row) * (depth_row @ shared @ depth_row + own))
    correlation = float(row @ shared @ depth_row / spread) if spread > 0 else 0.0
    sigma = float(pupil_sigma(camera, fit_uncertainty.covariance, np.array(angle)))
    values = {"theta_deg": float(np.degrees(angle)), "correlation": correlation, "E_sigma_mm": 1e3 * sigma}
    told = f"E({np.degrees(angle):.0f}°) is known to {1e3 * sigma:.3f} mm and correlates {correlation:+.2f} with depth"
    concern = abs(correlation) > 0.95
    advice = "; views nearer to the lens would separate the two" if concern else ": the two are told apart"
    return Finding("pupil_against_depth", values, concern, told + advice)


def split_near_far(fit: Fit, distance: np.ndarray) -> NearFarSplit | None:
    """Fit the nearer and the farther half of the views by themselves and compare them at infinity.

    distance (n,): metres, of every sighting used. None where a half determines no camera.
    """
    observations, used = fit.sightings.observations, fit.used
    view = np.searchsorted(fit.sightings.images, observations.image_index[used])
    views = len(fit.sightings.images)
    mean = np.bincount(view, weights=distance, minlength=views) / np.maximum(np.bincount(view, minlength=views), 1)
    order = np.argsort(mean, kind="stable")
    parts = (order[: views // 2], order[views // 2 :])
    cameras, covariances = [], []
    for part in parts:
        images = fit.sightings.images[np.sort(part)]
        enough = 2 * sum(np.isin(observations.image_index[used], images)) > 2 * fit.problem.shared_size + 12 * len(part)
        if len(part) < MIN_VIEWS or not enough:
            return None
        half = refine(fit, fit.structure, of_images(fit.sightings, images))
        if not half.adjustment.converged:
            return None
        largest_angle = half.largest_angle
        try:
            half_uncertainty = uncertainty(half)
        except np.linalg.LinAlgError:  # half of the views leave something open
            return None
        # A model that fails makes residuals correlate within a view: that must not excuse it.
        covariances.append(half_uncertainty.covariance / half_uncertainty.clustering)
        cameras.append(replace(half.state.camera, theta_max=largest_angle))
    near, far = (float(np.median(mean[part])) for part in parts)
    difference = camera_difference(cameras[0], cameras[1], (np.inf,), (covariances[0], covariances[1]))
    return NearFarSplit(near, far, difference)


def _near_far_advice(fit: Fit, chosen: bool) -> str:
    """What may help where near and far differ and was not tried already."""
    if not (fit.structure.pupil_terms or chosen):
        return "let a pupil be estimated (model auto), or record only at the distance of use"
    if fit.structure.board_shape == FLAT:
        return "check that the target is flat and record more views, near and far"
    return "record more views, near and far, or only at the distance of use"


def _near_far(split: NearFarSplit, advice: str) -> Finding:
    difference, expected = (
        float(np.sqrt(np.nanmean(px**2))) for px in (split.difference.length_px, split.difference.sigma_px)
    )
    values = {
        "near_m": split.near_m,
        "far_m": split.far_m,
        "difference_px": difference,
        "expected_px": expected,
    }
    told = (
        f"the near half ({split.near_m:.3f} m) and the far half ({split.far_m:.3f} m) differ by "
        f"{difference:.3f} px at infinity, {expected:.3f} px expected"
    )
    if difference <= 2.5 * expected:
        if expected < _TELLING:
            return Finding("near_far", values, False, f"{told}: the camera holds at every distance recorded")
        told += ": these data cannot tell whether it holds at other distances; record more views, near and far"
        return Finding("near_far", values, True, told)
    return Finding(
        "near_far",
        values,
        True,
        f"{told}: an error hides at the distances recorded and shows at others; {advice}",
    )


def _correlated_residuals(clustering: float) -> list[Finding]:
    if clustering == 1:
        return []
    wider = float(np.sqrt(clustering))
    told = f"the points of a view err together: bands are {wider:.1f} times as wide as independent noise makes them"
    return [Finding("correlated_residuals", {"widening": wider}, False, told)]


def _few_views(views: int) -> Finding:
    values = {"views": float(views)}
    if views >= _FEW_VIEWS:
        return Finding("few_views", values, False, f"{views} views: a single one does not decide the camera")
    told = f"{views} views are few: one of them more or less changes the camera; record {2 * _FEW_VIEWS} or more"
    return Finding("few_views", values, True, told)


def _copies(views: int, same_place: Mapping[int, tuple[int, ...]]) -> list[Finding]:
    if not same_place:
        return []
    images = views + sum(len(images) - 1 for images in same_place.values())
    told = (
        f"{images} images show {views} places: copies, and images of a board at rest, count as one view each; "
        "move the target between images"
    )
    return [Finding("copies", {"images": float(images), "places": float(views)}, True, told)]


def _squares_counted(fit: Fit) -> list[Finding]:
    observations = fit.sightings.observations
    lattice = smaller_lattice(observations.object_points, observations.image_index, observations.point_index)
    if lattice is None:
        return []
    columns, rows, most_columns, most_rows = lattice
    values = {"columns": float(columns), "rows": float(rows)}
    told = (
        f"no view shows more than {most_columns} × {most_rows} of the target file's {columns} × {rows} points: were"
        " squares counted instead of inner corners? Then points are named differently from view to view"
    )
    return [Finding("squares_counted", values, True, told)]


def _units(distance: np.ndarray, camera: FisheyeCamera) -> list[Finding]:
    """Distances (M,) and a pupil, metres, that no target and no lens have."""
    far = float(np.median(distance))
    shift = float(np.abs(camera.entrance_pupil(np.linspace(0, camera.theta_max, 50))).max())
    if far <= _FARTHEST_M and shift <= _LARGEST_PUPIL_M:
        return []
    told = f"the target stands {far:.3g} m away and the entrance pupil moves by {1e3 * shift:.3g} mm"
    advice = ": are the target file's lengths in metres?"
    return [Finding("units", {"distance_m": far, "pupil_mm": 1e3 * shift}, True, told + advice)]


def _two_cameras(fit: Fit, names: tuple[str, ...]) -> list[Finding]:
    """Whether the residuals split the images in two groups, as those of two cameras do."""
    pose, middle = fit.state.camera_from_target, fit.problem.features.board.middle
    middles = pose[:, :3, :3] @ middle + pose[:, :3, 3]
    points = 2 * fit.sightings.point_count
    try:
        split = two_cameras(fit.adjustment.equations, fit.shared_parameters[0], points, middles)
    except np.linalg.LinAlgError:
        return []
    if split is None:
        return []
    shift = split.corrections[1] - split.corrections[0]
    values = {
        "explained": split.explained,
        **{f"{name}_px": float(px) for name, px in zip(PARAMETERS, shift, strict=True)},
    }
    if not split.raised:
        return [Finding("two_cameras", values, False, "the residuals are those of one camera")]
    groups = [
        f"{len(images)} ({names[int(images[0])]} … {names[int(images[-1])]})"
        for images in (fit.sightings.images[~split.group], fit.sightings.images[split.group])
    ]
    told = (
        f"the residuals split the images in two groups, {' and '.join(groups)}, whose cameras differ by "
        f"{shift[0]:+.1f} px in fx and by ({shift[2]:+.1f}, {shift[3]:+.1f}) px in (cx, cy): are they of two cameras, "
        "or was the focus or the mount touched in between? Calibrate each group by itself"
    )
    return [Finding("two_cameras", values, True, told)]


def _view_changes(fit: Fit) -> tuple[Finding, ...]:
    """Whether the board bent between views, or something moved while the shutter rolled."""
    try:
        return changes_found(
            view_changes(joint_linearisation(fit)), fit.problem.effects.names if fit.problem.effects else ()
        )
    except np.linalg.LinAlgError:  # the views leave something open
        return ()


def _worst_view(fit: Fit, view_rms: np.ndarray, names: tuple[str, ...]) -> Finding:
    worst, middle = int(np.argmax(view_rms)), float(np.median(view_rms))
    name = names[int(fit.sightings.images[worst])]
    values = {"rms_px": float(view_rms[worst]), "median_rms_px": middle, "image": float(fit.sightings.images[worst])}
    told = f"the worst view is {name}: {view_rms[worst]:.3f} px, where the middle one has {middle:.3f} px"
    if view_rms[worst] <= 2.5 * max(middle, 1e-9):
        return Finding("worst_view", values, False, f"{told}: none stands out")
    return Finding("worst_view", values, True, f"{told}; look at it for blur or a bent target, or record it again")
