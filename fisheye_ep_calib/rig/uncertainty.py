"""How well a rig's poses are known: from the noise of the sightings, and from what each camera's file does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.shape_equations import solve_scaled
from fisheye_ep_calib.rig.adjustment import RigProblem, RigState, evaluate_rig
from fisheye_ep_calib.rig.equations import rig_information
from fisheye_ep_calib.rotation import motion_jacobian


def pose_covariance(
    problem: RigProblem, state: RigState, variance: float, camera_covariances: Sequence[np.ndarray | None]
) -> np.ndarray:
    """Covariance (6 (C − 1), 6 (C − 1)) of the steps (ω, δ) of camera_from_reference of the cameras 1, 2, …

    variance: px², of one coordinate. camera_covariances: (P, P) of each camera's parameters, of those that the
    problem holds fixed; None: taken as exact. With the information I on poses (r) and fixed parameters (c),
    Cov = σ² I_rr⁻¹ + J Σ_c Jᵀ, J = −I_rr⁻¹ I_rc.
    """
    held = [
        (np.zeros_like(view.free) if covariance is None else (np.diag(covariance) > 0) & ~view.free)
        for view, covariance in zip(problem.views, camera_covariances, strict=True)
    ]
    opened = replace(
        problem,
        views=tuple(replace(view, free=view.free | fixed) for view, fixed in zip(problem.views, held, strict=True)),
    )
    information = rig_information(evaluate_rig(opened, state))
    fixed_columns, covariances = [], []
    for camera, (view, fixed) in enumerate(zip(opened.views, held, strict=True)):
        among_free = fixed[view.free]
        fixed_columns.append(opened.parameter_columns(camera)[among_free])
        given = camera_covariances[camera]
        if given is not None:
            covariances.append(given[np.ix_(fixed, fixed)])
    fixed = np.concatenate(fixed_columns).astype(int)
    estimated = np.setdiff1d(np.arange(len(information)), fixed)
    inverse = solve_scaled(information[np.ix_(estimated, estimated)], np.eye(len(estimated)))
    covariance = variance * inverse
    if len(fixed):
        from scipy.linalg import block_diag  # not before it is needed: it takes long to load

        sensitivity = -inverse @ information[np.ix_(estimated, fixed)]
        covariance = covariance + sensitivity @ block_diag(*covariances) @ sensitivity.T
    poses = covariance[: problem.pose_size, : problem.pose_size]
    symmetric: FloatArray = 0.5 * (poses + poses.T)
    return symmetric


def of_inverse(camera_from_reference: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (6, 6) of the steps of reference_from_camera from that of camera_from_reference (4, 4).

    For T = (R, t) and T⁻¹ = (Rᵀ, p), p = −Rᵀ t, steps (ω, δ) of T are steps (−Rᵀ ω, −Rᵀ [t]× ω − Rᵀ δ) of T⁻¹.
    """
    turn, shift = camera_from_reference[:3, :3].T, camera_from_reference[:3, 3]
    jacobian = np.zeros((6, 6))
    jacobian[:3, :3] = jacobian[3:, 3:] = -turn
    jacobian[3:, :3] = turn @ motion_jacobian(shift)[:, :3]
    moved: FloatArray = jacobian @ covariance @ jacobian.T
    return moved
