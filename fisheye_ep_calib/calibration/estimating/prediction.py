"""What a camera predicts for a block of views, and its Jacobian by pose, camera and the target's deformation.

p = R X + t                              camera frame, X a point of the target as it is (target/shape/model.py)
feature = project(p), or the centre of gravity of the projected disc around X with the tangents T:
          its boundary is X + r (T_x cos α + T_y sin α)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.target_axis import project_along_target_axis
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.projection import not_computed, project_coordinates
from fisheye_ep_calib.rotation import turn_jacobian
from fisheye_ep_calib.target.discs.centroid import boundary_directions, curve_centroid
from fisheye_ep_calib.target.shape.frame import BoardFrame
from fisheye_ep_calib.target.shape.model import LOCAL, Surface

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
class ViewChange:
    """How views depart from one rigid target that holds still (view_effects.py).

    local (B, N, LOCAL): deformation of each sighting's point in this view, target frame, like that of a shape.
    twist (B, 6): (ω, v), rad and metres, of the board's turn about its middle and of its shift within one image;
    None where it holds still. time (B, N): of the sighting, in units of one image, 0 at the middle.
    """

    local: np.ndarray
    twist: np.ndarray | None
    time: np.ndarray


@dataclass(frozen=True)
class Prediction:
    """pixels (2, B, N); valid (B, N); theta (B, N) rad of the point, the mean over a disc's boundary.

    d_pose (2, 6, B, N): by (ω, δt) of a pose that turns about the board's middle (rotation.moved_poses): about an
    origin metres away, the least turn would carry the board off. d_camera (2, P, B, N): by camera.parameters.
    d_local (2, L, B, N): by the shift of the sighting's point in the target frame (L = 3); with discs also by the
    change of its tangents T_x and T_y (L = 9). d_twist (2, 6, B, N): by a motion during the image.
    d_placed (2, 3, B, N): by where the pose puts the point, before that motion.
    """

    pixels: np.ndarray
    valid: np.ndarray
    theta: np.ndarray
    d_pose: np.ndarray = field(default_factory=not_computed)
    d_camera: np.ndarray = field(default_factory=not_computed)
    d_local: np.ndarray = field(default_factory=not_computed)
    d_twist: np.ndarray = field(default_factory=not_computed)
    d_placed: np.ndarray = field(default_factory=not_computed)


def predict(
    camera: FisheyeCamera,
    features: FeatureModel,
    surface: Surface,
    camera_from_target: np.ndarray,
    block: ViewBlock,
    theta_limit: float,
    jacobian: bool = False,
    local_jacobian: bool = False,
    change: ViewChange | None = None,
) -> Prediction:
    """Predict every sighting of a block. camera_from_target (B, 4, 4) belongs to the block's views."""
    points = np.ascontiguousarray(surface.points.T)[:, block.points]
    if change is not None:
        points = points + np.moveaxis(change.local[..., :3], -1, 0)
    if features.disc_radius is None:
        predicted = _predict_points(camera, features, camera_from_target, points, theta_limit, jacobian, change)
        if not local_jacobian:
            return predicted
        return replace(predicted, d_local=_turned(predicted.d_placed, camera_from_target))
    directions = boundary_directions(_BOUNDARY_SAMPLES)
    tangents = np.moveaxis(surface.tangents, -1, 0)[:, block.points]
    if change is not None:
        slopes = change.local[..., 3:].reshape(*block.points.shape, 2, LOCAL // 3)
        tangents = tangents + np.moveaxis(slopes, -1, 0)
    samples = points[:, None] + features.disc_radius * np.einsum("ks,ibns->ikbn", directions, tangents)
    boundary = _predict_points(camera, features, camera_from_target, samples, theta_limit, jacobian, change)
    pixels, d_samples = curve_centroid(boundary.pixels[0], boundary.pixels[1])
    valid, theta = np.all(boundary.valid, axis=0), boundary.theta.mean(axis=0)
    if not jacobian:
        return Prediction(pixels, valid, theta)
    d_pose = _contract(d_samples, boundary.d_pose)
    d_local = not_computed()
    if local_jacobian:
        arms = features.disc_radius * directions.T[:, :, None, None]
        parts = [_contract(d_samples * arm, boundary.d_placed) for arm in (1.0, *arms)]
        d_local = np.concatenate([_turned(part, camera_from_target) for part in parts], axis=1)
    d_twist = _contract(d_samples, boundary.d_twist) if boundary.d_twist.size else not_computed()
    return Prediction(pixels, valid, theta, d_pose, _contract(d_samples, boundary.d_camera), d_local, d_twist)


def _turned(d_point: np.ndarray, camera_from_target: np.ndarray) -> np.ndarray:
    """∂pixel/∂(point of the target frame) = ∂pixel/∂p R, from ∂pixel/∂p (2, 3, B, N)."""
    turned: FloatArray = np.einsum("rmbn,bml->rlbn", d_point, camera_from_target[:, :3, :3], optimize=True)
    return turned


def _contract(d_samples: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Chain rule: (2, 2, K, B, N) by (2, Q, K, B, N) over coordinate and sample, giving (2, Q, B, N)."""
    result = np.empty((2, columns.shape[1], *columns.shape[3:]))
    for out in range(2):
        for column in range(columns.shape[1]):
            result[out, column] = (d_samples[out, 0] * columns[0, column] + d_samples[out, 1] * columns[1, column]).sum(
                axis=0
            )
    return result


def _predict_points(
    camera: FisheyeCamera,
    features: FeatureModel,
    camera_from_target: np.ndarray,
    points: np.ndarray,
    theta_limit: float,
    jacobian: bool,
    change: ViewChange | None,
) -> Prediction:
    """Points (3, ..., B, N) in the target frame through poses (B, 4, 4), and the motion of a change during the image.

    A point at c + a, c the board's middle, is seen at c + a + s (ω × a + v) at the time s. With g = ∂pixel/∂p there,
    ∂pixel/∂a = g − s ω × g, ∂pixel/∂c = g, ∂pixel/∂ω = s a × g and ∂pixel/∂v = s g.
    """
    rotated = _rotated(camera_from_target[:, :3, :3], points)
    by_view = (3, *[1] * (points.ndim - 3), -1, 1)
    x, y, z = rotated + camera_from_target[:, :3, 3].T.reshape(by_view)
    middle = (camera_from_target[:, :3, :3] @ features.board.middle).T.reshape(by_view)
    twist = None if change is None or change.twist is None else change.time * change.twist.T.reshape(2, *by_view)
    if twist is not None:
        x, y, z = np.stack([x, y, z]) + np.cross(twist[0], rotated - middle, axis=0) + twist[1]
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
    arms = rotated - middle
    d_pose = np.empty((2, 6, *projected.u.shape))
    d_placed, d_twist = d_point, not_computed()
    if change is not None and twist is not None:
        d_placed = d_point - np.cross(twist[0][None], d_point, axis=1)
        d_twist = change.time * np.concatenate([turn_jacobian(arms, d_point), d_point], axis=1)
    turn_jacobian(arms, d_placed, out=d_pose[:, :3])
    d_pose[:, 3:] = d_point
    return Prediction(
        pixels,
        projected.valid,
        projected.theta,
        d_pose,
        projected.d_parameters,
        d_twist=d_twist,
        d_placed=d_placed,
    )


def _rotated(rotation: np.ndarray, points: np.ndarray) -> np.ndarray:
    """R p (3, ..., B, N) of points (3, ..., B, N), one rotation (B, 3, 3) a view."""
    result = np.empty(points.shape)
    coordinate_inside = (*range(1, points.ndim - 1), 0, points.ndim - 1)
    np.matmul(rotation, points.transpose(coordinate_inside), out=result.transpose(coordinate_inside))
    return result
