"""The centre of gravity of a projected disc, by Green's theorem over the image of its boundary.

    A = ½∮(u dv − v du),  u_c = (1/2A) ∮ u² dv,  v_c = −(1/2A) ∮ v² du

with u, v sampled at N points of the boundary, u about its mean, and derivatives along the curve taken spectrally
(Trefethen, Spectral Methods in MATLAB, chapter 3, Nyquist term zero). It holds for any forward model that
is smooth over the disc. The projection of the disc's centre is something else: see docs/model.md.
"""

from functools import cache

import numpy as np


@cache
def boundary_directions(samples: int) -> np.ndarray:
    """Unit vectors (samples, 2) at equal angles: where the boundary of a disc is sampled."""
    angle = 2 * np.pi * np.arange(samples) / samples
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@cache
def _derivative_matrix(samples: int) -> np.ndarray:
    """(N, N), antisymmetric: d/da of a periodic function given at N equal steps of a."""
    frequency = np.fft.fftfreq(samples, 1 / samples)
    if samples % 2 == 0:
        frequency[samples // 2] = 0.0
    columns = np.fft.ifft(1j * frequency[:, None] * np.fft.fft(np.eye(samples), axis=0), axis=0)
    return np.ascontiguousarray(columns.real)


def curve_centroid(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre of gravity of the areas inside closed curves.

    u, v (N, *S): pixels of N samples of each curve, N ≥ 4. Returns the centroid (2, *S) and its Jacobian
    (2, 2, N, *S): ∂(u_c, v_c)/∂(u, v) of each sample.

    With S = Σ(u v′ − v u′), I = Σ u² v′, K = Σ v² u′ over samples about their mean: u_c = ū + I/S,
    v_c = v̄ − K/S, and D antisymmetric gives ∂S/∂u = 2 v′, ∂S/∂v = −2 u′, ∂I/∂u = 2 u v′ − mean(2 u v′),
    ∂I/∂v = −D u², and the same for K.
    """
    samples = len(u)
    matrix = _derivative_matrix(samples)
    mean_u, mean_v = u.mean(axis=0), v.mean(axis=0)
    u, v = u - mean_u, v - mean_v
    slope_u = np.tensordot(matrix, u, axes=1)
    slope_v = np.tensordot(matrix, v, axes=1)
    twice_area = (u * slope_v - v * slope_u).sum(axis=0)
    shift_u = (u * u * slope_v).sum(axis=0) / twice_area
    shift_v = -(v * v * slope_u).sum(axis=0) / twice_area
    product_u, product_v = 2 * u * slope_v, 2 * v * slope_u
    jacobian = np.empty((2, 2, *u.shape))
    jacobian[0, 0] = (product_u - product_u.mean(axis=0) - 2 * shift_u * slope_v) / twice_area + 1 / samples
    jacobian[0, 1] = (2 * shift_u * slope_u - np.tensordot(matrix, u * u, axes=1)) / twice_area
    jacobian[1, 0] = (np.tensordot(matrix, v * v, axes=1) - 2 * shift_v * slope_v) / twice_area
    jacobian[1, 1] = (product_v.mean(axis=0) - product_v + 2 * shift_v * slope_u) / twice_area + 1 / samples
    return np.stack([mean_u + shift_u, mean_v + shift_v]), jacobian
