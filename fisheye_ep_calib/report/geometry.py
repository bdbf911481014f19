"""Where the sightings lie as seen from the camera, and which directions were covered."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing import diagnosis
from fisheye_ep_calib.calibration.assessing.coverage import azimuth_and_distance, coverage, reachable
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.report.data import Coverage, Rejected, Residuals, View

RING_DEGREES = 5.0
SECTORS = 24


def residuals_of(
    observations: Observations,
    images: np.ndarray,
    camera_from_target: np.ndarray,
    error: np.ndarray,
    theta: np.ndarray,
    used: np.ndarray,
) -> Residuals:
    """images (V,), sorted: those of the poses (V, 4, 4). error (M, 2), theta (M,), used (M,) by observation row."""
    azimuth, distance = azimuth_and_distance(observations, images, camera_from_target, used)
    weighted = error[used] * observations.weights[used, None]
    return Residuals(
        observations.pixels[used],
        weighted,
        theta[used],
        azimuth,
        distance,
        np.searchsorted(images, observations.image_index[used]),
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
    """Counts by ring and sector up to the largest angle seen, and what is missing by the diagnosis's measure."""
    theta, azimuth = residuals.theta, residuals.azimuth
    counts = coverage(theta, azimuth, RING_DEGREES, SECTORS)
    coarse = coverage(theta, azimuth, diagnosis.RING_DEGREES, diagnosis.SECTORS)
    shown = reachable(camera, len(coarse), diagnosis.RING_DEGREES, diagnosis.SECTORS)
    return Coverage(counts, RING_DEGREES, shown & (coarse == 0), diagnosis.RING_DEGREES)
