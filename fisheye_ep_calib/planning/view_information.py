"""What a view would tell about the camera, before it is recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.rotation import motion_jacobian


@dataclass(frozen=True)
class ViewInformation:
    """pixels (F, n, 2): where the points would appear, NaN where out of sight.

    information (F, P, P): on camera.parameters once each pose is free, per px⁻² of noise.
    """

    pixels: np.ndarray
    information: np.ndarray


def view_information(camera: FisheyeCamera, points: np.ndarray, poses: np.ndarray) -> ViewInformation:
    """Of views of points (n, 3), metres, at poses camera_from_target (F, 4, 4).

    With A, B the derivatives of the pixels by the camera and by the pose: Aᵀ A − Aᵀ B (Bᵀ B)⁻¹ Bᵀ A.
    """
    turned = points @ np.swapaxes(poses[:, :3, :3], -1, -2)
    pixels, valid, d_point, d_camera = camera.project_with_jacobian(turned + poses[:, None, :3, 3])
    inside = valid & ((pixels > 0) & (pixels < np.array(camera.image_size) - 1)).all(axis=-1)
    d_pose = d_point @ motion_jacobian(turned)
    shape = (len(poses), 2 * len(points))  # −1 would be open where there are no poses
    a = np.where(inside[..., None, None], d_camera, 0).reshape(*shape, d_camera.shape[-1])
    b = np.where(inside[..., None, None], d_pose, 0).reshape(*shape, 6)
    b_b = np.swapaxes(b, -1, -2) @ b
    scale = np.trace(b_b, axis1=-2, axis2=-1)[:, None, None]
    a_b = np.swapaxes(a, -1, -2) @ b
    folded = a_b @ np.linalg.solve(b_b + (1e-12 * scale + 1e-30) * np.eye(6), np.swapaxes(a_b, -1, -2))
    information = np.swapaxes(a, -1, -2) @ a - folded
    information[inside.sum(axis=-1) < 4] = 0
    return ViewInformation(np.where(inside[..., None], pixels, np.nan), information)


def variance_reduction(information: np.ndarray, so_far: np.ndarray, sought: np.ndarray) -> np.ndarray:
    """How much each view (F,) would lower the variances of what is sought, as shares of them, summed over it.

    information (F, P, P): of the views; so_far M (P, P): without them; sought (Q, P): rows j, derivatives of what
    is sought by the parameters. To first order a view with information N lowers a variance jᵀ M⁻¹ j by
    jᵀ M⁻¹ N M⁻¹ j (Fedorov, Theory of Optimal Experiments, 1972).
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(so_far), 1e-300))
    covariance = np.linalg.inv(so_far * scale * scale[:, None] + 1e-9 * np.eye(len(so_far)))
    rows = sought * scale
    variance = np.einsum("qi,ij,qj->q", rows, covariance, rows)
    spread = (rows @ covariance) * scale / np.sqrt(np.maximum(variance, 1e-300))[:, None]
    result: np.ndarray = np.einsum("nij,ij->n", information, spread.T @ spread)
    return result
