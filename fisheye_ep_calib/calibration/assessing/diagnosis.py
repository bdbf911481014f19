"""What the recording could and could not tell, each finding with what to record more of.

No error on the calibration set shows what the set never looked at: hence coverage, depth at large angles, and the
near/far split (near_far.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.asymmetry import not_symmetric
from fisheye_ep_calib.calibration.assessing.coverage import SECTOR_NAMES, azimuth_and_distance, coverage, reachable
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.assessing.near_far import NearFarSplit, near_far, near_far_advice, split_near_far
from fisheye_ep_calib.calibration.assessing.structured_views import points_by_view, structured_views
from fisheye_ep_calib.calibration.assessing.target_findings import board_bent, board_scale, squares_counted, units
from fisheye_ep_calib.calibration.assessing.two_cameras import PARAMETERS, two_cameras
from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.assessing.view_changes import ViewChanges, changes_found, view_changes
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.parameters import pupil_names
from fisheye_ep_calib.target.shape.measured import BoardShape

_AS_GOOD_AS_ANY = 0.05  # px RMS of a view, up to which nothing about it is worth a second look
_STANDS_OUT = 2.5  # times the RMS of the middle view
_UNEQUAL = 0.02  # |fx / fy − 1|, beyond which something other than the sensor is likelier
RING_DEGREES = 15
SECTORS = len(SECTOR_NAMES)
_FEW_VIEWS = 8  # below which a view more or less changes the camera beyond its bands


@dataclass(frozen=True)
class Diagnosis:
    """counts (rings, sectors): sightings by incidence angle and azimuth. reachable: bool, same shape, in the image.

    view_rms_px (V,): RMS of each view. near_far: as ``split_near_far``. findings: in words.
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
    view_rms, changes = fit.view_rms, _view_changes(fit)
    told = changes.told if changes else None
    explained = changes.explained_px(told, points_by_view(fit)) if changes and told else np.zeros(len(view_rms))
    split = split_near_far(fit, distance)
    findings = [
        _coverage(counts, in_image),
        _depth(theta, distance),
        *([_pupil_against_depth(fit)] if len(camera.coefficients) else []),
        *([near_far(split, near_far_advice(fit, chosen))] if split else []),
        _worst_view(fit, view_rms, names, explained, changes.noise_px[told] if changes and told else 0.0),
        *_correlated_residuals(uncertainty(fit).clustering),
        *_copies(len(fit.sightings.images), same_place or {}),
        *_two_cameras(fit, names),
        pixels_not_square(camera),
        *squares_counted(fit),
        *units(distance, camera),
        *(changes_found(changes, fit.problem.effects.names if fit.problem.effects else ()) if changes else ()),
        *structured_views(fit, names),
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


def _view_changes(fit: Fit) -> ViewChanges | None:
    """Whether the board bent between views, or something moved while the shutter rolled."""
    try:
        return view_changes(joint_variances(fit))
    except np.linalg.LinAlgError:  # the views leave something open
        return None


def _worst_view(
    fit: Fit, view_rms: np.ndarray, names: tuple[str, ...], explained: np.ndarray, noise_px: float
) -> Finding:
    """The view that is farthest beyond what is usual.

    explained (V,), noise_px: what a change from view to view that is told explains, and the noise beside it; 0 where
    none is.
    """
    middle = float(np.median(view_rms))
    limit = np.full(len(view_rms), max(_STANDS_OUT * middle, _AS_GOOD_AS_ANY))
    limit = np.maximum(limit, np.hypot(_STANDS_OUT * noise_px, explained))
    worst = int(np.argmax(view_rms / limit))
    name = names[int(fit.sightings.images[worst])]
    values = {"rms_px": float(view_rms[worst]), "median_rms_px": middle, "image": float(fit.sightings.images[worst])}
    told = f"the worst view is {name}: {view_rms[worst]:.3f} px, where the middle one has {middle:.3f} px"
    if view_rms[worst] <= limit[worst]:
        return Finding("worst_view", values, False, f"{told}: none stands out")
    return Finding("worst_view", values, True, f"{told}; look at it for blur or a bent target, or record it again")


def pixels_not_square(camera: FisheyeCamera) -> Finding:
    """fx and fy are the focal length in a pixel's width and in its height."""
    excess = camera.fx / camera.fy - 1
    values = {"fx_px": camera.fx, "fy_px": camera.fy, "excess": excess}
    if abs(excess) <= _UNEQUAL:
        return Finding("pixels_not_square", values, False, f"fx and fy agree within {100 * abs(excess):.2f} %")
    larger, smaller = ("fx", "fy") if excess > 0 else ("fy", "fx")
    told = (
        f"{larger} is {100 * (max(camera.fx, camera.fy) / min(camera.fx, camera.fy) - 1):.1f} % larger than {smaller}: "
        "sensors have square pixels, so check whether the image was scaled or cropped unevenly by the driver, and "
        "whether the target's spacings in x and y are as its file says"
    )
    return Finding("pixels_not_square", values, True, told)
