"""Where a first calibration says a target's features are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera


@dataclass(frozen=True)
class Prediction:
    """n features. pixels (n, 2). plane_jacobian (n, 2, 2): pixels per metre along the target's x and y.

    visible (n,): the camera has a pixel for the feature, inside the image, and sees the board's front.
    """

    pixels: np.ndarray
    plane_jacobian: np.ndarray
    visible: np.ndarray


def predict(
    camera: FisheyeCamera, camera_from_target: np.ndarray, points: np.ndarray, image_shape: tuple[int, ...]
) -> Prediction:
    """Project a target's points (n, 3), metres, at a pose (4, 4)."""
    rotation, translation = camera_from_target[:3, :3], camera_from_target[:3, 3]
    in_camera = points @ rotation.T + translation
    pixels, valid, d_point, _ = camera.project_with_jacobian(in_camera)
    jacobian = d_point @ rotation[:, :2]
    height, width = image_shape[:2]
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels <= [width - 1, height - 1]).all(axis=1)
    visible = valid & inside & np.isfinite(jacobian).all(axis=(1, 2))
    pixels = np.where(visible[:, None], pixels, 0.0)
    return Prediction(pixels, np.where(visible[:, None, None], jacobian, np.eye(2)), visible)
