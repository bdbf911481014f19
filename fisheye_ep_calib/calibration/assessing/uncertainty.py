"""What the calibration does not know: covariance of its parameters, bands for E(θ) and r(θ), projection error.

Cov = σ² I⁻¹ with I the information on the shared parameters once every pose is free, and σ² the residuals' sum of
squares over the degrees of freedom, or what robust.noise_variance puts in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.adjustment import predict_block, shared_jacobian
from fisheye_ep_calib.calibration.estimating.fit import Fit, independent_covariance
from fisheye_ep_calib.calibration.estimating.shape_equations import solve_scaled
from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.rotation import motion_jacobian, placed, turn_jacobian


@dataclass(frozen=True)
class Uncertainty:
    """sigma_px: noise of one coordinate. covariance (P, P): of camera.parameters, zero where fixed.

    clustering: by how much the residuals of a view, which hang together, raise the covariances; 1 where they do not.
    shared (S, S): the same with the board warp, only what was estimated. gauge (6, S): the rigid motion of all
    boards, (ω, t) rad and metres, that best makes up for a change of the shared parameters.
    beside: where the camera has no pupil, the one with the pupil that the data leave open, and which of its parameters
    (P',) are estimated; shared and gauge are then its own.
    """

    sigma_px: float
    covariance: np.ndarray
    shared: np.ndarray
    gauge: np.ndarray
    clustering: float = 1.0
    beside: tuple[FisheyeCamera, np.ndarray] | None = None


def uncertainty(fit: Fit) -> Uncertainty:
    """Of a converged fit."""
    sigma_px, independent = independent_covariance(fit)
    clustering = fit.clustering
    shared = clustering * independent
    free = np.flatnonzero(fit.problem.free)
    covariance = np.zeros((len(fit.problem.free),) * 2)
    covariance[np.ix_(free, free)] = shared[: len(free), : len(free)]
    return Uncertainty(sigma_px, covariance, shared, _gauge(fit), clustering)


def _gauge(fit: Fit) -> np.ndarray:
    """(6, S): minus the least-squares motion that a change of the shared parameters looks like in the images.

    Every residual's derivative by a motion p → p + ω × p + t of the camera frame is ∂pixel/∂p [−[p]×, I].
    """
    motion, mixed = np.zeros((6, 6)), np.zeros((6, fit.problem.shared_size))
    surface, has_bow = fit.problem.shape.surface(fit.state.shape), fit.problem.bow_size > 0
    for block in fit.problem.blocks:
        poses = fit.state.camera_from_target[block.views]
        predicted = predict_block(fit.problem, fit.state, surface, block, jacobian=True, local_jacobian=has_bow)
        # d_pose turns about the board's middle c; turning about the camera's origin adds c × ∂pixel/∂p.
        columns = predicted.d_pose * block.weights
        middle = placed(poses, fit.problem.features.board.middle).T[..., None]
        columns[:, :3] += turn_jacobian(middle, columns[:, 3:])
        shared_columns = shared_jacobian(fit.problem, block, predicted) * block.weights
        motion += np.einsum("caij,cbij->ab", columns, columns, optimize=True)
        mixed += np.einsum("caij,cbij->ab", columns, shared_columns, optimize=True)
    return -solve_scaled(motion, mixed)


TABLE_DISTANCES = (0.1, 0.3, 1.0, 10.0, np.inf)  # metres
_TABLE_STEP = 10  # degrees


@dataclass(frozen=True)
class ProjectionTable:
    """sigma_px (angles, distances): projection uncertainty at theta_deg (angles,) and distance_m (distances,)."""

    theta_deg: np.ndarray
    distance_m: np.ndarray
    sigma_px: np.ndarray


def projection_table(camera: FisheyeCamera, uncertainty: Uncertainty, free: np.ndarray) -> ProjectionTable:
    """Projection uncertainty by angle and distance, RMS over eight azimuths."""
    degrees = np.arange(0, int(np.degrees(camera.theta_limit)) + 1, _TABLE_STEP)
    azimuth = np.radians(np.arange(0, 360, 45))
    distances = np.array(TABLE_DISTANCES)
    theta, turn, distance = np.meshgrid(np.radians(degrees), azimuth, np.minimum(distances, FAR), indexing="ij")
    points = direction(theta, turn) * distance[..., None]
    points[..., 2] -= camera.entrance_pupil(theta)
    sigma = projection_uncertainty(camera, uncertainty, free, points)
    return ProjectionTable(degrees, distances, np.sqrt((sigma**2).mean(axis=1)))


def projection_uncertainty(
    camera: FisheyeCamera, uncertainty: Uncertainty, free: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Standard deviation (...), px per axis, of the pixels of points (..., 3) in the camera frame, metres.

    The boards that fixed the camera define the frame: a change of parameters that only moves all of them rigidly is
    no error of the camera, so the gauge's motion is taken along (as in mrcal's projection uncertainty).
    """
    if uncertainty.beside is not None:
        camera, free = uncertainty.beside
    _, _, d_point, d_parameters = camera.project_with_jacobian(points)
    motion = d_point @ motion_jacobian(points)
    columns = motion @ uncertainty.gauge
    columns[..., : int(free.sum())] += d_parameters[..., free]
    covariance = columns @ uncertainty.shared @ np.swapaxes(columns, -1, -2)
    sigma: FloatArray = np.sqrt(np.maximum(0.5 * np.trace(covariance, axis1=-2, axis2=-1), 0.0))
    return sigma
