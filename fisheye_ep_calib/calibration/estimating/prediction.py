"""What a camera predicts for a block of views, and its Jacobian by pose, camera and the target's deformation.

p = R X + t                              camera frame, X a point of the target as it is (target/shape/model.py)
feature = project(p), or the centre of gravity of the projected disc around X with the tangents T:
          its boundary is X + r (T_x cos α + T_y sin α)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.target_axis import project_along_target_axis
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.projection import not_computed, project_coordinates
from fisheye_ep_calib.rotation import turn_jacobian
from fisheye_ep_calib.target.discs.centroid import boundary_directions, curve_centroid
from fisheye_ep_calib.target.shape.frame import BoardFrame
from fisheye_ep_calib.target.shape.model import Surface

_BOUNDARY_SAMPLES = 8  # the centroid is then right to 1e-6 px


@dataclass(frozen=True)
class FeatureModel:
    """What the sightings are. disc_radius: metres, None where they are points. board: frame of the target's plane.

    target_axis: move points along the target's axis, as the paper's equation is printed.
    """

    board: BoardFrame
    disc_radius: float | None = None
    target_axis: bool = False


@dataclass(frozen=True)
class Prediction:
    """pixels (2, B, N); valid (B, N); theta (B, N) rad of the point, the mean over a disc's boundary.

    d_pose (2, 6, B, N): by (ω, δt) of a pose that turns about the board's middle (rotation.moved_poses): about an
    origin metres away, the least turn would carry the board off. d_camera (2, P, B, N): by camera.parameters.
    d_local (2, L, B, N): by the shift of the sighting's point in the target frame (L = 3); with discs also by the
    change of its tangents T_x and T_y (L = 9).
    """

    pixels: np.ndarray
    valid: np.ndarray
    theta: np.ndarray
    d_pose: np.ndarray = field(default_factory=not_computed)
    d_camera: np.ndarray = field(default_factory=not_computed)
    d_local: np.ndarray = field(default_factory=not_computed)


def predict(
    camera: FisheyeCamera,
    features: FeatureModel,
    surface: Surface,
    camera_from_target: np.ndarray,
    block: ViewBlock,
    theta_limit: float,
    jacobian: bool = False,
    local_jacobian: bool = False,
) -> Prediction:
    """Predict every sighting of a block. camera_from_target (B, 4, 4) belongs to the block's views."""
    points = np.ascontiguousarray(surface.points.T)[:, block.points]
    if features.disc_radius is None:
        predicted = _predict_points(camera, features, camera_from_target, points, theta_limit, jacobian)
        if not local_jacobian:
            return predicted
        return replace(predicted, d_local=_turned(predicted.d_pose[:, 3:], camera_from_target))
    directions = boundary_directions(_BOUNDARY_SAMPLES)
    tangents = np.moveaxis(surface.tangents, -1, 0)[:, block.points]
    edge = features.disc_radius * np.einsum("ks,ibns->ikbn", directions, tangents)
    boundary = _predict_points(camera, features, camera_from_target, points[:, None] + edge, theta_limit, jacobian)
    pixels, d_samples = curve_centroid(boundary.pixels[0], boundary.pixels[1])
    valid, theta = np.all(boundary.valid, axis=0), boundary.theta.mean(axis=0)
    if not jacobian:
        return Prediction(pixels, valid, theta)
    d_pose = _contract(d_samples, boundary.d_pose)
    d_local = not_computed()
    if local_jacobian:
        arms = features.disc_radius * directions.T[:, :, None, None]
        parts = [d_pose[:, 3:], *(_contract(d_samples * arm, boundary.d_pose[:, 3:]) for arm in arms)]
        d_local = np.concatenate([_turned(part, camera_from_target) for part in parts], axis=1)
    return Prediction(pixels, valid, theta, d_pose, _contract(d_samples, boundary.d_camera), d_local)


def _turned(d_point: np.ndarray, camera_from_target: np.ndarray) -> np.ndarray:
    """∂pixel/∂(point of the target frame) = ∂pixel/∂p R, from ∂pixel/∂p (2, 3, B, N)."""
    return np.einsum("rmbn,bml->rlbn", d_point, camera_from_target[:, :3, :3], optimize=True)


def _contract(d_samples: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Chain rule: (2, 2, K, B, N) by (2, Q, K, B, N) over coordinate and sample, giving (2, Q, B, N)."""
    result = np.empty((2, columns.shape[1], *columns.shape[3:]))
    for out in range(2):
        for column in range(columns.shape[1]):
            result[out, column] = (d_samples[out, 0] * columns[0, column] + d_samples[out, 1] * columns[1, column]).sum(
                axis=0
            )
    return result


def _predict_points(camera, features, camera_from_target, points, theta_limit, jacobian) -> Prediction:
    """Points (3, ..., B, N) in the target frame through poses (B, 4, 4)."""
    rotated = _rotated(camera_from_target[:, :3, :3], points)
    x, y, z = rotated + camera_from_target[:, :3, 3].T.reshape(3, *[1] * (points.ndim - 3), -1, 1)
    if features.target_axis:
        normal = camera_from_target[:, :3, :3] @ features.board.axes[:, 2]
        projected, moved = project_along_target_axis(camera, x, y, z, normal.T, theta_limit, jacobian)
        rotated = rotated + moved
    else:
        projected = project_coordinates(camera, x, y, z, theta_limit, jacobian)
    pixels = np.stack([projected.u, projected.v])
    if not jacobian:
        return Prediction(pixels, projected.valid, projected.theta)
    d_point = projected.d_point
    middle = (camera_from_target[:, :3, :3] @ features.board.middle).T
    arms = rotated - middle.reshape(3, *[1] * (points.ndim - 3), -1, 1)
    d_pose = np.empty((2, 6, *projected.u.shape))
    turn_jacobian(arms, d_point, out=d_pose[:, :3])
    d_pose[:, 3:] = d_point
    return Prediction(pixels, projected.valid, projected.theta, d_pose, projected.d_parameters)


def _rotated(rotation: np.ndarray, points: np.ndarray) -> np.ndarray:
    """R p (3, ..., B, N) of points (3, ..., B, N), one rotation (B, 3, 3) a view."""
    result = np.empty(points.shape)
    coordinate_inside = (*range(1, points.ndim - 1), 0, points.ndim - 1)
    np.matmul(rotation, points.transpose(coordinate_inside), out=result.transpose(coordinate_inside))
    return result
