"""Rectification of two cameras: rows that correspond, for CameraInfo's R and P.

With x along the baseline from the left camera to the right one, z between the two optical axes and y across both:

    p_rectified = R p_camera,  P = [f 0 cx Tx; 0 f cy 0; 0 0 1 0],  Tx = −f B of the right camera, B the baseline, m

so that a point at depth Z has the same row in both images and the disparity f B / Z. (sensor_msgs/CameraInfo; Fusiello,
Trucco and Verri, "A compact algorithm for rectification of stereo pairs", 2000.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.formats.placed_camera import PlacedCamera

_WIDEST = np.radians(50)  # half of a rectified image's field of view


@dataclass(frozen=True)
class RectifiedPair:
    """rectified_from_camera: R (3, 3) of left and right. projection: P (3, 4), px and px · m, of both."""

    rectified_from_camera: tuple[np.ndarray, np.ndarray]
    projection: tuple[np.ndarray, np.ndarray]


def rectified_pair(left: PlacedCamera, right: PlacedCamera) -> RectifiedPair:
    """Of two cameras side by side. Raises InputError where they are not."""
    left_from_right = left.camera_from_reference @ right.reference_from_camera
    shift, turn = left_from_right[:3, 3], left_from_right[:3, :3]
    length = float(np.linalg.norm(shift))
    between = np.array([0.0, 0.0, 1.0]) + turn[:, 2]
    along = shift / max(length, 1e-12)
    across = np.cross(between, along)
    if length < 1e-6 or abs(along[0]) < 0.7 or np.linalg.norm(across) < 0.2:
        raise InputError(f"{left.name} and {right.name} do not stand side by side: they make no stereo pair")
    if along[0] < 0:
        raise InputError(f"{right.name} stands to the left of {left.name}: name it first in the rig")
    across /= np.linalg.norm(across)
    from_left = np.stack([along, across, np.cross(along, across)])
    width, height = left.camera.image_size
    half = min(left.camera.theta_limit, right.camera.theta_limit, float(_WIDEST))
    focal = 0.5 * width / np.tan(half)
    projection = np.array([[focal, 0, (width - 1) / 2, 0], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]])
    other = projection.copy()
    other[0, 3] = -focal * length
    return RectifiedPair((from_left, from_left @ turn), (projection, other))
