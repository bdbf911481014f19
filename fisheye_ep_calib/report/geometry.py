"""Where the sightings lie as seen from the camera, and which directions were covered."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.report.data import Coverage, Rejected, Residuals, View

RING_DEGREES = 5.0
SECTORS = 24
_FAR = 1e6  # metres


def residuals_of(
    observations: Observations,
    images: np.ndarray,
    camera_from_target: np.ndarray,
    error: np.ndarray,
    theta: np.ndarray,
    used: np.ndarray,
) -> Residuals:
    """images (V,), sorted: those of the poses (V, 4, 4). error (M, 2), theta (M,), used (M,) by observation row."""
    view = np.searchsorted(images, observations.image_index[used])
    pose = camera_from_target[view]
    points = observations.object_points[observations.point_index[used]]
    points = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
    weighted = error[used] * observations.weights[used, None]
    return Residuals(
        observations.pixels[used],
        weighted,
        theta[used],
        np.arctan2(points[:, 1], points[:, 0]),
        np.linalg.norm(points, axis=-1),
        view,
    )


def views_of(names: list[str], residuals: Residuals, rejected: tuple[Rejected, ...] = ()) -> tuple[View, ...]:
    """One View a name; ``residuals.view`` counts the names."""
    length = np.linalg.norm(residuals.error, axis=-1)
    views = []
    for row, name in enumerate(names):
        own = residuals.view == row
        if not own.any():
            views.append(View(name, 0, float("nan"), float("nan"), float("nan"), float("nan")))
            continue
        views.append(
            View(
                name,
                int(own.sum()),
                float(np.sqrt((length[own] ** 2).mean())),
                float(length[own].max()),
                float(np.median(residuals.distance[own])),
                float(residuals.theta[own].max()),
                sum(point.view == name for point in rejected),
            )
        )
    return tuple(views)


def coverage_of(residuals: Residuals, camera: FisheyeCamera) -> Coverage:
    """Counts by ring and sector up to the largest angle seen."""
    ring = (np.degrees(residuals.theta) // RING_DEGREES).astype(int)
    sector = np.round(residuals.azimuth / (2 * np.pi / SECTORS)).astype(int) % SECTORS
    rings = int(ring.max()) + 1
    counts = np.bincount(ring * SECTORS + sector, minlength=rings * SECTORS).reshape(rings, SECTORS)
    return Coverage(counts, _reachable(camera, rings) | (counts > 0), RING_DEGREES)


def _reachable(camera: FisheyeCamera, rings: int) -> np.ndarray:
    """bool (rings, SECTORS): whether the middle of the cell lies in the image."""
    theta = np.radians(RING_DEGREES * (np.arange(rings) + 0.5))
    theta, azimuth = np.meshgrid(theta, 2 * np.pi * np.arange(SECTORS) / SECTORS, indexing="ij")
    directions = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], -1)
    pixels, valid = camera.project(directions * _FAR)
    return valid & (pixels >= 0).all(axis=-1) & (pixels <= np.array(camera.image_size) - 1).all(axis=-1)
