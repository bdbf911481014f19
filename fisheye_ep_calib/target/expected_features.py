"""Where a first calibration says a target's features are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.rotation import motion_jacobian
from fisheye_ep_calib.target.discs.centroid import boundary_directions, curve_centroid

BOUNDARY = 12  # samples of a disc's edge
FARTHER = 0.15  # rad
FEWEST_FOR_PLANE, FEWEST_FOR_QUADRATIC = 8, 15


@dataclass(frozen=True)
class ExpectedFeatures:
    """n features. pixels (n, 2). plane_jacobian (n, 2, 2): pixels per metre along the target's x and y.

    visible (n,): the camera has a pixel for the feature, inside the image, and sees the board's front.
    """

    pixels: np.ndarray
    plane_jacobian: np.ndarray
    visible: np.ndarray


def beyond_evidence(camera: FisheyeCamera) -> FisheyeCamera:
    """The camera, believed a little beyond the largest angle that it was calibrated at: features farther out are to be
    found now. Other cameras as they are.
    """
    if not isinstance(camera, FisheyeCamera):
        return camera
    return replace(camera, theta_max=min(camera.theta_max + FARTHER, np.pi))


def expect(
    camera: FisheyeCamera, camera_from_target: np.ndarray, points: np.ndarray, image_shape: tuple[int, ...]
) -> ExpectedFeatures:
    """Project a target's points (n, 3), metres, at a pose (4, 4)."""
    camera = beyond_evidence(camera)
    rotation, translation = camera_from_target[:3, :3], camera_from_target[:3, 3]
    in_camera = points @ rotation.T + translation
    pixels, valid, d_point, _ = camera.project_with_jacobian(in_camera)
    jacobian = d_point @ rotation[:, :2]
    height, width = image_shape[:2]
    with np.errstate(invalid="ignore"):
        inside = (pixels >= 0).all(axis=1) & (pixels <= [width - 1, height - 1]).all(axis=1)
    visible = valid & inside & np.isfinite(jacobian).all(axis=(1, 2))
    pixels = np.where(visible[:, None], pixels, 0.0)
    return ExpectedFeatures(pixels, np.where(visible[:, None, None], jacobian, np.eye(2)), visible)


def expect_discs(
    camera: FisheyeCamera,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    radius: float,
    image_shape: tuple[int, ...],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where discs about points (n, 3), radius in metres, appear at a pose (4, 4).

    Returns their centres of gravity (n, 2), their ellipses x' shape⁻¹ x = 1 (n, 2, 2) and whether all of each
    disc is in view (n,). The boundary p_j at equal angles of an ellipse about c has mean (p_j − c)(p_j − c)'
    = shape/2.
    """
    edge = np.repeat(points[:, None], BOUNDARY, axis=1)
    edge[..., :2] += radius * boundary_directions(BOUNDARY)
    expected = expect(camera, camera_from_target, edge.reshape(-1, 3), image_shape)
    visible = np.asarray(expected.visible.reshape(-1, BOUNDARY).all(axis=1))
    pixels = expected.pixels.reshape(-1, BOUNDARY, 2)[visible]
    center, shape = np.zeros((len(points), 2)), np.tile(np.eye(2), (len(points), 1, 1))
    if visible.any():
        center[visible] = curve_centroid(pixels[..., 0].T, pixels[..., 1].T)[0].T
        spread = pixels - pixels.mean(axis=1, keepdims=True)
        shape[visible] = 2 * np.einsum("kji,kjl->kil", spread, spread) / BOUNDARY
    return center, shape, visible


def expect_bend(
    camera: FisheyeCamera,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    reach: np.ndarray,
    image_shape: tuple[int, ...],
) -> np.ndarray:
    """Second differences (n, 2, 3) of the pixel along x x, x y and y y, for a step of reach (n,) metres; 0
    where unseen.

    Taken over half the reach, in the plane of the target.
    """
    steps = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]]) / 2
    moved = np.repeat(points[None], len(steps), axis=0)
    moved[..., :2] += steps[:, None, :] * reach[None, :, None]
    expected = expect(camera, camera_from_target, moved.reshape(-1, 3), image_shape)
    at = expected.pixels.reshape(len(steps), -1, 2)
    visible = np.asarray(expected.visible.reshape(len(steps), -1).all(axis=0))
    xx, yy = at[1] + at[2] - 2 * at[0], at[3] + at[4] - 2 * at[0]
    xy = (at[5] - at[6] - at[7] + at[8]) / 4
    return np.where(visible[:, None, None], 4 * np.stack([xx, xy, yy], axis=-1), 0.0)


def pose_columns(camera: FisheyeCamera, camera_from_target: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How pixels of points (n, 3) move with small rotations about the camera's axes and with translations, (n, 2, 6).

    d(R P + T) = ω × (R P) + τ. Zero where the camera has no pixel.
    """
    camera = beyond_evidence(camera)
    turned = points @ camera_from_target[:3, :3].T
    _, valid, d_point, _ = camera.project_with_jacobian(turned + camera_from_target[:3, 3])
    columns = d_point @ motion_jacobian(turned)
    return np.where((valid & np.isfinite(columns).all(axis=(1, 2)))[:, None, None], columns, 0.0)


def smooth_residuals(points: np.ndarray, values: np.ndarray, columns: np.ndarray | None = None) -> np.ndarray:
    """How far each feature's value (k, m) is from one that varies smoothly over the board (k,).

    A camera that does not fit yet errs smoothly, and so do sizes change: the values are fitted with a
    quadratic in the board's x and y (points (k, 2 or 3)), robustly (iteratively reweighted, Cauchy weights).
    columns (k, m, p): further ways in which the values may vary, such as by the pose.
    """
    count, width = values.shape
    centred = points[:, :2] - points[:, :2].mean(axis=0)
    x, y = (centred / max(float(np.abs(centred).max()), 1e-9)).T
    by_columns = columns is not None and count >= FEWEST_FOR_PLANE
    chosen = 6 if count >= FEWEST_FOR_QUADRATIC else 3 if count >= FEWEST_FOR_PLANE and not by_columns else 1
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y][:chosen], axis=-1)
    design = np.einsum("kt,ij->kijt", terms, np.eye(width)).reshape(count, width, -1)
    if columns is not None and by_columns:
        design = np.concatenate([design, columns / np.maximum(np.abs(columns).max(axis=(0, 1)), 1e-12)], axis=-1)
    rest = np.linalg.norm(values - np.median(values, axis=0), axis=1)
    for _ in range(8):
        weight = (1 / (1 + (rest / max(2 * float(np.median(rest)), 1e-6)) ** 2))[:, None]
        weighted = (design * weight[..., None]).reshape(count * width, -1)
        coefficients = np.linalg.lstsq(weighted, (values * weight).ravel(), rcond=1e-9)[0]
        rest = np.linalg.norm(values - design @ coefficients, axis=1)
    result: np.ndarray = rest
    return result


def stays_smooth(
    points: np.ndarray,
    values: np.ndarray,
    usual: float | np.ndarray,
    columns: np.ndarray | None = None,
    slack: float | np.ndarray = 1.0,
) -> np.ndarray:
    """Whether each value (k, m) fits the others (k,): within ``usual``, or six times what is common among
    them; slack: times so much.
    """
    rest = smooth_residuals(points, values, columns)
    return rest < slack * np.maximum(6 * float(np.median(rest)), usual)
