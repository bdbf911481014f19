"""Where the sightings lie as seen from the camera, and which directions were covered.

Ring k holds incidence angles from k times its width on; sector k is centred on azimuth k · 360°/sectors, 0 to the right
in the image and 90° downwards.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.camera.directions import direction

SECTOR_NAMES = ("right", "lower right", "lower", "lower left", "left", "upper left", "upper", "upper right")


def azimuth_and_distance(
    observations: Observations, images: np.ndarray, camera_from_target: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth (n,), rad, and distance from the camera (n,), metres, of the sightings used (M,) bool.

    images (V,), sorted: those of the poses (V, 4, 4).
    """
    pose = camera_from_target[np.searchsorted(images, observations.image_index[used])]
    points = observations.object_points[observations.point_index[used]]
    points = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
    return np.arctan2(points[:, 1], points[:, 0]), np.linalg.norm(points, axis=-1)


def sector_of(azimuth: float | np.ndarray, sectors: int) -> np.ndarray:
    """Number of the sector, of the shape of azimuth (rad)."""
    return np.round(np.asarray(azimuth) / (2 * np.pi / sectors)).astype(int) % sectors


def coverage(theta: np.ndarray, azimuth: np.ndarray, ring_degrees: float, sectors: int) -> np.ndarray:
    """Sightings (rings, sectors) by ring and sector, up to the largest θ; theta, azimuth (n,): rad."""
    ring = (np.degrees(theta) // ring_degrees).astype(int)
    rings = int(ring.max()) + 1
    cell = ring * sectors + sector_of(azimuth, sectors)
    return np.bincount(cell, minlength=rings * sectors).reshape(rings, sectors)


def reachable(camera: FisheyeCamera, rings: int, ring_degrees: float, sectors: int) -> np.ndarray:
    """bool (rings, sectors): whether the image shows the direction in the middle of the ring and sector."""
    theta = np.radians(ring_degrees * (np.arange(rings) + 0.5))
    theta, azimuth = np.meshgrid(theta, 2 * np.pi * np.arange(sectors) / sectors, indexing="ij")
    pixels, valid = camera.project(FAR * direction(theta, azimuth))
    return valid & (pixels >= 0).all(axis=-1) & (pixels <= np.array(camera.image_size) - 1).all(axis=-1)
