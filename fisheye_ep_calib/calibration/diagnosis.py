"""What the recording could and could not tell, each finding with what to record more of.

No error on the calibration set shows what the set never looked at: hence coverage, depth at large angles, and the
near/far split, which fits the nearer and the farther half of the views by themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.fit import MIN_VIEWS, Fit, of_images, refine
from fisheye_ep_calib.calibration.uncertainty import projection_uncertainty, pupil_sigma, uncertainty
from fisheye_ep_calib.camera import FisheyeCamera

RING_DEGREES = 15
SECTORS = 8
_SECTOR_NAMES = ("right", "lower right", "below", "lower left", "left", "upper left", "above", "upper right")
_FAR = 1e6  # metres: where a pupil's shift has no effect
_GRID = 15  # pixels a side at which two cameras are compared


@dataclass(frozen=True)
class Finding:
    """One measured property of the recording. values: numbers by name, with the unit in the name.

    concern: whether it limits the calibration. sentence: what it means and what to record more of.
    """

    name: str
    values: dict[str, float]
    concern: bool
    sentence: str


@dataclass(frozen=True)
class Diagnosis:
    """counts (rings, sectors): sightings by incidence angle and azimuth. reachable: bool, same shape, in the image.

    view_rms_px (V,): RMS of each view. findings: in words.
    """

    counts: np.ndarray
    reachable: np.ndarray
    view_rms_px: np.ndarray
    findings: tuple[Finding, ...]


def diagnose(fit: Fit, camera: FisheyeCamera, names: tuple[str, ...]) -> Diagnosis:
    """camera: the fitted one with its theta_max. names: of the images."""
    theta, azimuth, distance = _sighting_geometry(fit)
    counts = _ring_sector_counts(theta, azimuth)
    reachable = _reachable(camera, len(counts))
    view_rms = _view_rms(fit)
    findings = [
        _coverage(counts, reachable),
        _depth(theta, distance),
        *([_pupil_against_depth(fit)] if len(camera.coefficients) else []),
        *_near_far(fit, distance),
        _worst_view(fit, view_rms, names),
    ]
    return Diagnosis(counts, reachable, view_rms, tuple(findings))


def _used(fit: Fit) -> np.ndarray:
    _, _, valid = fit.residuals
    return valid & (fit.sightings.observations.weights > 0)


def _sighting_geometry(fit: Fit):
    """Incidence angle (rad), azimuth (rad) and distance from the camera (metres) of every sighting used."""
    observations, used = fit.sightings.observations, _used(fit)
    view = np.searchsorted(fit.sightings.images, observations.image_index[used])
    pose = fit.state.camera_from_target[view]
    points = observations.object_points[observations.point_index[used]]
    points = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
    theta = fit.residuals[1][used]
    return theta, np.arctan2(points[:, 1], points[:, 0]), np.linalg.norm(points, axis=-1)


def _ring_sector_counts(theta: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    ring = (np.degrees(theta) // RING_DEGREES).astype(int)
    rings = int(ring.max()) + 1
    return np.bincount(ring * SECTORS + _sector(azimuth), minlength=rings * SECTORS).reshape(rings, SECTORS)


def _sector(azimuth: np.ndarray) -> np.ndarray:
    return np.round(azimuth / (2 * np.pi / SECTORS)).astype(int) % SECTORS


def _reachable(camera: FisheyeCamera, rings: int) -> np.ndarray:
    """bool (rings, SECTORS): whether the image shows directions of that ring and sector."""
    width, height = camera.image_size
    theta = np.radians(RING_DEGREES * (np.arange(rings) + 0.5))
    angle = 2 * np.pi * np.arange(SECTORS) / SECTORS
    theta, angle = np.meshgrid(theta, angle, indexing="ij")
    directions = np.stack([np.sin(theta) * np.cos(angle), np.sin(theta) * np.sin(angle), np.cos(theta)], -1)
    pixels, valid = camera.project(directions * _FAR)
    return valid & (pixels >= 0).all(axis=-1) & (pixels <= [width - 1, height - 1]).all(axis=-1)


def _coverage(counts: np.ndarray, reachable: np.ndarray) -> Finding:
    seen = (counts > 0) & reachable
    share = seen.sum() / max(reachable.sum(), 1)
    missing = np.argwhere(reachable & (counts == 0))
    values = {"share_of_field": float(share), "rings": float(len(counts))}
    if len(missing) == 0:
        return Finding("coverage", values, False, "every part of the field up to the largest angle seen is covered")
    ring = int(missing[:, 0].max())
    sectors = ", ".join(_SECTOR_NAMES[sector] for which, sector in missing if which == ring)
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
        return Finding("depth at large angles", values, False, f"{told}: enough to observe the entrance pupil")
    return Finding(
        "depth at large angles",
        values,
        True,
        f"{told}; show it there at half and at twice that distance too, which is what makes the pupil observable",
    )


def _pupil_against_depth(fit: Fit) -> Finding:
    """Correlation of E near the rim with the mean t_z of the views; shared parameters and poses together."""
    known = uncertainty(fit)
    equations, camera = fit.adjustment.equations, fit.state.camera
    inverse = np.linalg.inv(equations.pose)
    depth_row = -(inverse @ equations.mixed)[:, 5].mean(axis=0)
    own = known.sigma_px**2 * inverse[:, 5, 5].sum() / len(inverse) ** 2
    angle = 0.9 * float(fit.residuals[1][_used(fit)].max())
    names, _ = fit.shared_parameters
    row = np.zeros(len(names))
    basis = camera.pupil_family.basis(np.array(angle), len(camera.coefficients))
    for term, value in enumerate(basis):
        row[names.index(f"e{term + 1}")] = value
    shared = known.shared
    spread = np.sqrt((row @ shared @ row) * (depth_row @ shared @ depth_row + own))
    correlation = float(row @ shared @ depth_row / spread) if spread > 0 else 0.0
    sigma = float(pupil_sigma(camera, known.covariance, np.array(angle)))
    values = {"theta_deg": float(np.degrees(angle)), "correlation": correlation, "E_sigma_mm": 1e3 * sigma}
    told = f"E({np.degrees(angle):.0f}°) is known to {1e3 * sigma:.3f} mm and correlates {correlation:+.2f} with depth"
    concern = abs(correlation) > 0.95
    advice = "; views nearer to the lens would separate the two" if concern else ": the two are told apart"
    return Finding("pupil against depth", values, concern, told + advice)


def _near_far(fit: Fit, distance: np.ndarray) -> list[Finding]:
    """Fit the nearer and the farther half of the views by themselves and compare them at infinity."""
    observations, used = fit.sightings.observations, _used(fit)
    view = np.searchsorted(fit.sightings.images, observations.image_index[used])
    views = len(fit.sightings.images)
    mean = np.bincount(view, weights=distance, minlength=views) / np.maximum(np.bincount(view, minlength=views), 1)
    order = np.argsort(mean, kind="stable")
    halves = []
    for part in (order[: views // 2], order[views // 2 :]):
        images = fit.sightings.images[np.sort(part)]
        enough = 2 * sum(np.isin(observations.image_index[used], images)) > 2 * fit.problem.shared_size + 12 * len(part)
        if len(part) < MIN_VIEWS or not enough:
            return []
        half = refine(fit, fit.structure, of_images(fit.sightings, images))
        if not half.adjustment.converged:
            return []
        halves.append(half)
    difference, expected = difference_at_infinity(*halves)
    values = {
        "near_m": float(np.median(mean[order[: views // 2]])),
        "far_m": float(np.median(mean[order[views // 2 :]])),
        "difference_px": difference,
        "expected_px": expected,
    }
    told = (
        f"the near half ({values['near_m']:.3f} m) and the far half ({values['far_m']:.3f} m) differ by "
        f"{difference:.3f} px at infinity, {expected:.3f} px expected"
    )
    if difference <= 2.5 * expected:
        return [Finding("near/far split", values, False, f"{told}: the camera holds at every distance recorded")]
    return [
        Finding(
            "near/far split",
            values,
            True,
            f"{told}: an error hides at the distances recorded and shows at others; "
            + (
                "check that the target is flat and record more views, near and far"
                if fit.structure.pupil_terms
                else "let a pupil be estimated (--model auto), or record only at the distance of use"
            ),
        )
    ]


def difference_at_infinity(one: Fit, other: Fit) -> tuple[float, float]:
    """RMS difference, px, of two fits' cameras for far points, and the RMS that their uncertainties predict.

    The second camera is turned to agree best with the first: an orientation is no property of a camera.
    """
    cameras = [replace(fit.state.camera, theta_max=_seen(one, other)) for fit in (one, other)]
    width, height = cameras[0].image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, _GRID), np.linspace(0, height - 1, _GRID))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    _, directions, valid = cameras[0].unproject(pixels)
    far = directions[valid] * _FAR
    projected, reached, d_point, _ = cameras[1].project_with_jacobian(far)
    error = (projected - pixels[valid])[reached]
    x, y, z = (far[reached][:, i] for i in range(3))
    zero = np.zeros_like(x)
    turn = np.stack([np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=-2)
    columns = (d_point[reached] @ turn).reshape(-1, 3)
    left = error.ravel() - columns @ np.linalg.lstsq(columns, error.ravel(), rcond=None)[0]
    variance = sum(
        projection_uncertainty(camera, uncertainty(fit), fit.problem.free, far[reached]) ** 2
        for camera, fit in zip(cameras, (one, other), strict=True)
    )
    count = max(int(reached.sum()), 1)
    return float(np.sqrt((left**2).sum() / count)), float(np.sqrt(2 * np.mean(variance)))


def _seen(*fits: Fit) -> float:
    """The largest angle, rad, that all of the fits have seen."""
    return min(float(fit.residuals[1][_used(fit)].max()) for fit in fits)


def _view_rms(fit: Fit) -> np.ndarray:
    observations, used = fit.sightings.observations, _used(fit)
    error, _, _ = fit.residuals
    square = (error[used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
    view = np.searchsorted(fit.sightings.images, observations.image_index[used])
    views = len(fit.sightings.images)
    count = np.maximum(np.bincount(view, minlength=views), 1)
    return np.sqrt(np.bincount(view, weights=square, minlength=views) / count)


def _worst_view(fit: Fit, view_rms: np.ndarray, names: tuple[str, ...]) -> Finding:
    worst, middle = int(np.argmax(view_rms)), float(np.median(view_rms))
    name = names[int(fit.sightings.images[worst])]
    values = {"rms_px": float(view_rms[worst]), "median_rms_px": middle, "image": float(fit.sightings.images[worst])}
    told = f"the worst view is {name}: {view_rms[worst]:.3f} px, where the middle one has {middle:.3f} px"
    if view_rms[worst] <= 2.5 * max(middle, 1e-9):
        return Finding("worst view", values, False, f"{told}: none stands out")
    return Finding("worst view", values, True, f"{told}; look at it for blur or a bent target, or record it again")
