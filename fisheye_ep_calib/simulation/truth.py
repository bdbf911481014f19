"""Where a target's features truly appear: the reference for detectors and calibrations."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import BoolArray, FloatArray
from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.simulation.patterns import printed_side
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.target import Target

_RADII, _ANGLES = 8, 24


def feature_pixels(
    camera: SceneCamera, target: Target, camera_from_target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """True pixels (..., n, 2) and validity (..., n) of a target's features at poses (..., 4, 4).

    Corners are projected points; discs give the centre of gravity of the projected disc.
    """
    if target.disc_radius is not None:
        return disc_centroids(camera, target.object_points, target.disc_radius, camera_from_target)
    return camera.project(points_in_camera(camera_from_target, target.object_points))


def points_in_camera(camera_from_target: FloatArray, points: FloatArray) -> FloatArray:
    """R P + T: points (n, 3) at poses (..., 4, 4) as (..., n, 3), metres."""
    rotation, translation = camera_from_target[..., :3, :3], camera_from_target[..., :3, 3]
    return points @ np.swapaxes(rotation, -1, -2) + translation[..., None, :]


def disc_centroids(
    camera: SceneCamera, centers: np.ndarray, radius: float, camera_from_target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centres of gravity (..., n, 2) of the images of discs, and whether all of each is in view (..., n).

    centers (n, 3), radius: metres, discs parallel to z = 0. The area integral itself, on purpose not the
    boundary integral by which a calibration predicts it: with p(x, y) the pixel of a disc's point and
    J = |det ∂p/∂(x, y)|, the centre of gravity is ∫ p J dx dy / ∫ J dx dy, by Gauss–Legendre quadrature along
    the radius and the trapezoidal rule around the circle.
    """
    node, weight = np.polynomial.legendre.leggauss(_RADII)
    distance = radius * (node + 1) / 2
    angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    offset = np.zeros((_RADII, _ANGLES, 3))
    offset[..., 0] = distance[:, None] * np.cos(angle)
    offset[..., 1] = distance[:, None] * np.sin(angle)
    area = np.repeat(weight * distance, _ANGLES)
    points = (centers[:, None, :] + offset.reshape(-1, 3)).reshape(-1, 3)
    in_camera = points_in_camera(camera_from_target, points)
    pixels, valid, d_point, _ = camera.project_with_jacobian(in_camera)
    d_plane = d_point @ camera_from_target[..., None, :3, :2]
    stretch = d_plane[..., 0, 0] * d_plane[..., 1, 1] - d_plane[..., 0, 1] * d_plane[..., 1, 0]
    shape = (*camera_from_target.shape[:-2], len(centers), len(area))
    share = area * np.abs(stretch).reshape(shape)
    share = np.where(valid.reshape(shape), share, 0)
    pixels = np.where(valid[..., None], pixels, 0).reshape(*shape, 2)
    total = np.maximum(share.sum(axis=-1), 1e-300)
    centroid = (share[..., None] * pixels).sum(axis=-2) / total[..., None]
    return centroid, np.asarray(valid.reshape(shape).all(axis=-1))


def observe(camera: SceneCamera, target: Target, poses: np.ndarray, noise: float = 0.0, seed: int = 0) -> Observations:
    """What an ideal detector measures in views at poses (V, 4, 4): every feature within the image.

    noise: σ of the Gaussian error of each pixel coordinate.
    """
    width, height = camera.image_size
    parts = [feature_pixels(camera, target, poses[i : i + 16]) for i in range(0, len(poses), 16)]
    pixels, valid = (np.concatenate(part) for part in zip(*parts, strict=True))
    pixels = pixels + np.random.default_rng([seed, 3]).normal(0, noise, pixels.shape)
    inside = (pixels > 0) & (pixels < [width - 1, height - 1])
    image_index, point_index = np.nonzero(valid & inside.all(axis=-1) & _faces_camera(target, poses)[:, None])
    return Observations.create(
        target.object_points,
        image_index,
        point_index,
        pixels[image_index, point_index],
        camera.image_size,
        image_names=tuple(f"{view:06d}" for view in range(len(poses))),
        disc_radius=target.disc_radius,
    )


def _faces_camera(target: Target, poses: FloatArray) -> BoolArray:
    """Whether the printed side of a target at poses (V, 4, 4) looks toward the camera's origin (V,)."""
    result: BoolArray = -np.einsum("vi,vi->v", poses[:, :3, 2], poses[:, :3, 3]) * printed_side(target) > 0
    return result
