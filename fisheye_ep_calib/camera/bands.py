"""Bands of a camera's curves: 1σ of E(θ) and of the image radius, from the covariance of its parameters.

First order: for a curve that is linear in some parameters p, curve = rows(θ)ᵀ p, σ² = rowsᵀ Cov_p rows.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.camera.fisheye import FisheyeCamera

CHOSEN, LEFT_OPEN = "chosen", "left open"


def pupil_sigma(camera: FisheyeCamera, covariance: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Standard deviation of E(θ), metres, shape of θ (rad): √(bᵀ Cov_e b) with b the family's basis."""
    part = camera.parameter_slice("coefficients")
    basis = camera.pupil_family.basis(np.asarray(theta, dtype=float), len(camera.coefficients))
    return _band(basis, covariance[part, part])


def entrance_pupil_band(
    camera: FisheyeCamera, covariance: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray, str]:
    """E(θ) and its standard deviation, metres, shapes of θ (rad), and whose they are.

    The camera's own, "chosen", or, where it has none, those that its data leave open, "left open".
    """
    left_open = camera.pupil_left_open
    if left_open is not None and not camera.coefficients:
        return left_open.entrance_pupil(theta), left_open.sigma(theta), LEFT_OPEN
    return camera.entrance_pupil(theta), pupil_sigma(camera, covariance, theta), CHOSEN


def radius_sigma(camera: FisheyeCamera, covariance: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Standard deviation of fx r(θ), px, shape of θ (rad)."""
    theta = np.asarray(theta, dtype=float)
    part = camera.parameter_slice("radial")
    columns = np.arange(len(camera.parameters))[part]
    rows = np.concatenate(
        [camera.radius(theta)[None], camera.fx * camera.lens_model.radius_jacobian(theta, camera.radial_array)]
    )
    index = np.concatenate([[0], columns])
    return _band(rows, covariance[np.ix_(index, index)])


def _band(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """√(rowsᵀ Cov rows) for rows (n, *S)."""
    result: np.ndarray = np.sqrt(np.maximum(np.einsum("i...,ij,j...->...", rows, covariance, rows), 0.0))
    return result
