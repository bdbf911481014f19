"""The columns of a lens field gathered by azimuthal order, orthonormal over the sightings, and their prior.

Of an order's columns X, weighted by the sightings, G = Xᵀ X. With G = D V L Vᵀ D, D its diagonal's root, the columns
√M X D⁻¹ V L^(−1/2) have the mean square 1 px² over M sightings, so that one τ in pixels is the prior of all of them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations
from fisheye_ep_calib.calibration.field_prior import FieldPrior
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD, ORDERS

_GATHERED = 1e-4  # of the mean square: what is less of a lens field's column, the others tell


def with_gathered_field(
    equations: NormalEquations, field: np.ndarray, points: int
) -> tuple[NormalEquations, np.ndarray]:
    """Equations whose columns of the lens field, at these places of the shared ones, stand last, orthonormal by order.

    Their mean square is 1 px² a point; what the sightings do not tell apart is left out. index (F,): which of the
    orders each is of.
    """
    if len(field) == 0:
        return equations, np.zeros(0, int)
    orders = np.array(LENS_FIELD.orders)
    gram = equations.shared[np.ix_(field, field)]
    mixing, order_of = [], []
    for index, order in enumerate(ORDERS):
        own = np.flatnonzero(orders == order)
        scale, values, vectors = _scaled_eigen(gram[np.ix_(own, own)])
        kept = values > _GATHERED * values.max()
        part = np.zeros((len(field), int(kept.sum())))
        part[own] = scale[:, None] * vectors[:, kept] * np.sqrt(points / values[kept])
        mixing.append(part)
        order_of += [index] * part.shape[1]
    size, shared = equations.view_size, len(equations.shared)
    rest = np.setdiff1d(np.arange(shared), field)
    turn = np.zeros((shared, len(rest) + len(order_of)))
    turn[rest, np.arange(len(rest))] = 1.0
    turn[field, len(rest) :] = np.concatenate(mixing, axis=1)
    whole = np.zeros((size + shared + 1, size + turn.shape[1] + 1))
    whole[:size, :size], whole[-1, -1] = np.eye(size), 1.0
    whole[size:-1, size:-1] = turn
    by_view = whole.T @ equations.by_view @ whole
    shape = equations.shape
    if shape is not None:
        shape = replace(shape, camera=turn.T @ shape.camera)
    prior, gradient = equations.known_beforehand
    gathered = replace(equations, prior=turn.T @ prior @ turn, prior_gradient=turn.T @ gradient)
    return replace(gathered, by_view=by_view, shape=shape), np.array(order_of)


def field_prior(gram: np.ndarray, tau: np.ndarray, noise: float, points: int) -> FieldPrior:
    """Of the lens field's own coefficients: Λ = σ²/(τ² M) G in each order of the M sightings.

    gram (F, F): G, px². tau: of each order, px. noise: σ of one coordinate, px. What an order's coefficients c do to
    the points is cᵀ G c, px², and M τ² a priori for each; what the sightings hardly tell of them counts as the least
    that they do.
    """
    penalties, orders = np.zeros_like(gram), np.array(LENS_FIELD.orders)
    for index, order in enumerate(ORDERS):
        own = np.flatnonzero(orders == order)
        scale, values, vectors = _scaled_eigen(gram[np.ix_(own, own)])
        root = (vectors * np.sqrt(np.maximum(values, _GATHERED * values.max()))).T / scale
        penalties[np.ix_(own, own)] = noise**2 / (float(tau[index]) ** 2 * points) * root.T @ root
    return FieldPrior(tuple(map(tuple, penalties.tolist())))


def _scaled_eigen(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1/√ of a Gram matrix's diagonal (k,); eigenvalues (k,) and -vectors (k, k) of the matrix so scaled."""
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    return scale, *np.linalg.eigh(gram * scale[:, None] * scale)
