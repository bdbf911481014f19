"""The normal equations of the bundle adjustment, view by view, and their solution by Schur complement.

For the pose of view j and the shared parameters s (camera, and a bow's three):

    [ A_j   B_j ] [δ_j]     [g_j]
    [ B_jᵀ  C   ] [δ_s] = − [g_s],     C = Σ_j C_j,  g_s = Σ_j g_sj

What else is a view's own (view_effects.py) stands beside its pose in δ_j.

Eliminating the poses: (C − Σ B_jᵀ A_j⁻¹ B_j) δ_s = −(g_s − Σ B_jᵀ A_j⁻¹ g_j), then δ_j = −A_j⁻¹ (g_j + B_j δ_s)
(Triggs et al., "Bundle adjustment: a modern synthesis", section 6). A free shape of the target adds columns of its own:
shape_equations.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.shape_equations import ShapeEquations, block_system, solve_scaled

ALMOST_UNDAMPED = 1e-9  # for a step that is not checked by a second one
_BOUNDLESS = 1e30  # of a step, in radians, metres or pixels


@dataclass(frozen=True)
class NormalEquations:
    """by_view (V, q + S + 1, q + S + 1): JᵀJ of each view for the columns (the view's own, shared, residual).

    cost: half the sum of the squared (or robust) residuals and of the shape's penalty, px². valid: every prediction
    exists. shape: of a target whose shape is free, penalty included. prior (S, S): information on the shared parameters
    that no view holds (settled.py, and what is known beforehand); prior_gradient (S,): of the cost of the latter.
    view_size: q, the six of the pose and what else is a view's own, whose penalty is in by_view.
    """

    by_view: np.ndarray
    cost: float
    valid: bool
    shape: ShapeEquations | None = None
    prior: np.ndarray | float = 0.0
    prior_gradient: np.ndarray | float = 0.0
    view_size: int = 6

    @property
    def pose(self) -> np.ndarray:
        """A_j (V, q, q)."""
        return self.by_view[:, : self.view_size, : self.view_size]

    @property
    def mixed(self) -> np.ndarray:
        """B_j (V, q, S)."""
        return self.by_view[:, : self.view_size, self.view_size : -1]

    @property
    def pose_gradient(self) -> np.ndarray:
        """g_j (V, q)."""
        return self.by_view[:, : self.view_size, -1]

    @property
    def known_beforehand(self) -> tuple[np.ndarray, np.ndarray]:
        """The prior's information (S, S) and its gradient (S,)."""
        size = self.by_view.shape[1] - self.view_size - 1
        return np.zeros((size, size)) + self.prior, np.zeros(size) + self.prior_gradient

    @cached_property
    def shared(self) -> np.ndarray:
        """C (S, S)."""
        total: FloatArray = self.by_view[:, self.view_size : -1, self.view_size : -1].sum(axis=0) + self.prior
        return total

    @cached_property
    def shared_gradient(self) -> np.ndarray:
        """g_s (S,)."""
        total: FloatArray = self.shared_gradients.sum(axis=0) + self.prior_gradient
        return total

    @property
    def shared_gradients(self) -> np.ndarray:
        """g_sj (V, S)."""
        return self.by_view[:, self.view_size : -1, -1]

    def from_flat(self, unknowns: np.ndarray) -> NormalEquations:
        """The same linearised residuals with the shape's unknowns (K,), as they are at the state, put back to zero.

        r − J x: gradients lose H x, and the cost x·g − ½ x·H x.
        """
        shape = self.shape
        assert shape is not None
        by_view = self.by_view.copy()
        size = self.view_size
        by_view[:, :size, -1] -= shape.pose @ unknowns
        by_view[:, -1, :size] = by_view[:, :size, -1]
        own = shape.times(unknowns)
        gradient = shape.gradient - own
        # What the shared gradient loses is no single view's; it is put to the first.
        by_view[0, size:-1, -1] -= shape.camera @ unknowns
        by_view[0, -1, size:-1] = by_view[0, size:-1, -1]
        cost = self.cost - float(unknowns @ shape.gradient) + 0.5 * float(unknowns @ own)
        return replace(self, by_view=by_view, cost=cost, shape=replace(shape, gradient=gradient))

    def without_effects(self, values: np.ndarray) -> NormalEquations:
        """The same linearised residuals with what is each view's own beside its pose, values (V, k), put back to zero.

        Its penalty is not among them.
        """
        by_view, own = self.by_view.copy(), slice(6, self.view_size)
        by_view[..., -1] -= np.einsum("vck,vk->vc", self.by_view[..., own], values)
        by_view[:, -1] = by_view[..., -1]
        square = np.einsum("vk,vkl,vl->v", values, self.by_view[:, own, own], values)
        linear = (values * self.by_view[:, own, -1]).sum(axis=-1)
        by_view[:, -1, -1] = self.by_view[:, -1, -1] - 2 * linear + square
        cost = self.cost + float((0.5 * square - linear).sum())
        shape = self.shape
        if shape is not None:
            shape = replace(shape, gradient=shape.gradient - np.einsum("vqk,vq->k", shape.pose[:, own], values))
        return replace(self, by_view=by_view, cost=cost, shape=shape)

    def without_shared(self, columns: np.ndarray, values: np.ndarray) -> NormalEquations:
        """The same linearised residuals with some (c,) of the shared parameters, values (c,), put back to zero."""
        by_view, own = self.by_view.copy(), self.view_size + columns
        by_view[:, :-1, -1] -= self.by_view[:, :-1, own] @ values
        by_view[:, -1, :-1] = by_view[:, :-1, -1]
        linear = self.by_view[:, own, -1] @ values
        square = np.einsum("k,vkl,l->v", values, self.by_view[:, own[:, None], own], values)
        by_view[:, -1, -1] += square - 2 * linear
        cost = self.cost + float((0.5 * square - linear).sum())
        shape = self.shape
        if shape is not None:
            shape = replace(shape, gradient=shape.gradient - shape.camera[columns].T @ values)
        return replace(self, by_view=by_view, cost=cost, shape=shape)

    def of_views(self, views: np.ndarray) -> NormalEquations:
        """The equations of some of the views alone, at the same state; under a robust loss the cost is Σ ρ′ s / 2."""
        part = self.by_view[views]
        return replace(self, by_view=part, cost=0.5 * float(part[:, -1, -1].sum()), shape=None)


@dataclass(frozen=True)
class Step:
    """pose (V, q), shared (S + K,): camera, then shape; predicted_decrease of the cost, px²."""

    pose: np.ndarray
    shared: np.ndarray
    predicted_decrease: float


def _reduce(
    pose: np.ndarray, mixed: np.ndarray, shared: np.ndarray, pose_gradient: np.ndarray, shared_gradient: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eliminate the poses: reduced matrix (S, S), reduced gradient (S,), and A⁻¹ [B, g] (V, q, S + 1)."""
    right = np.concatenate([mixed, pose_gradient[..., None]], axis=-1)
    solved = np.linalg.solve(pose, right)
    size = shared.shape[0]
    rows = pose.shape[0] * pose.shape[1]
    folded = mixed.reshape(rows, size).T @ solved.reshape(rows, size + 1)
    return shared - folded[:, :size], shared_gradient - folded[:, size], solved


def solve_damped(equations: NormalEquations, damping: float) -> Step:
    """The Levenberg–Marquardt step: diagonal entries multiplied by 1 + damping (Marquardt's scaling).

    Raises numpy.linalg.LinAlgError where a pose block is singular, or so nearly that the step knows no bounds.
    """
    diagonal = np.arange(equations.view_size)
    pose = equations.pose.copy()
    pose[:, diagonal, diagonal] *= 1 + damping
    shared = equations.shared.copy()
    size = shared.shape[0]
    shared[np.arange(size), np.arange(size)] *= 1 + damping
    if equations.shape is not None:
        return _solve_damped_with_shape(equations, equations.shape, pose, shared, damping)
    reduced, gradient, solved = _reduce(
        pose, equations.mixed, shared, equations.pose_gradient, equations.shared_gradient
    )
    shared_step = -solve_scaled(reduced, gradient)
    pose_step = -(solved[..., size] + solved[..., :size] @ shared_step)
    return checked_step(
        equations, pose_step, shared_step, equations.shared_gradient, np.diag(equations.shared), damping
    )


def checked_step(
    equations: NormalEquations,
    pose: np.ndarray,
    shared: np.ndarray,
    gradient: np.ndarray,
    diagonal: np.ndarray,
    damping: float,
) -> Step:
    """The step and what it promises; gradient, diagonal: of the shared unknowns, undamped."""
    if not max(np.abs(pose).max(initial=0.0), np.abs(shared).max(initial=0.0)) < _BOUNDLESS:
        raise np.linalg.LinAlgError
    linear = shared @ gradient + (pose * equations.pose_gradient).sum()
    own = np.einsum("vii->vi", equations.pose)
    damped = ((pose**2 * own).sum() + (shared**2 * diagonal).sum()) * damping
    return Step(pose, shared, float(0.5 * (damped - linear)))


def _solve_damped_with_shape(
    equations: NormalEquations, shape: ShapeEquations, pose: np.ndarray, camera: np.ndarray, damping: float
) -> Step:
    """The step of poses, camera and shape; pose (V, q, q) and camera (S, S) are damped already."""
    system = block_system(pose, equations.mixed, camera, shape.damped(damping))
    smooth = shape.smooth_size
    gradient = {
        "pose": equations.pose_gradient.reshape(-1, 1),
        "camera": equations.shared_gradient[:, None],
        "smooth": shape.gradient[:smooth, None],
        "rough": shape.gradient[smooth:, None],
    }
    solution = system.solve(gradient)
    return checked_step(
        equations,
        -solution["pose"].reshape(-1, equations.view_size),
        -np.concatenate([solution[name][:, 0] for name in ("camera", "smooth", "rough")]),
        np.concatenate([equations.shared_gradient, shape.gradient]),
        np.concatenate([np.diag(equations.shared), shape.diagonal]),
        damping,
    )


def reduced_information(equations: NormalEquations) -> np.ndarray:
    """(S, S): the information on the shared parameters once every pose is free (inverse covariance × σ²)."""
    reduced, _, _ = _reduce(
        equations.pose,
        equations.mixed,
        equations.shared,
        equations.pose_gradient,
        equations.shared_gradient,
    )
    symmetric: FloatArray = 0.5 * (reduced + reduced.T)
    return symmetric


def view_clustering(equations: NormalEquations, variance: float) -> tuple[float, float]:
    """How much more the views' scores scatter than independent residuals of that variance would let them, and its σ.

    With s_j the scores of ``view_robust_covariance``, I_j what view j tells, I = Σ I_j, A_j = I⁻¹ I_j and B = Σ A_j²:
    as Σ s_j = 0, independent residuals have Cov(s_j, s_k) = σ² (δ_jk I_j − I_j I⁻¹ I_k), so that q = Σ s_jᵀ I⁻¹ s_j has
    the mean σ² (S − tr B) and the variance 2 σ⁴ (tr B − 2 Σ tr A_j³ + tr B²). Returned: q over its mean, 1 then.
    """
    scores = _scores(equations)
    each = _information_of_views(equations)
    size = each.shape[1]
    information = each.sum(axis=0) + equations.prior
    shares = solve_scaled(information, each.transpose(1, 0, 2).reshape(size, -1)).reshape(size, -1, size).swapaxes(0, 1)
    squares = shares @ shares
    total = squares.sum(axis=0)
    cubes = float(np.einsum("vij,vji->", squares, shares))
    scatter = float(np.trace(total) - 2 * cubes + np.trace(total @ total))
    observed = float((scores * solve_scaled(information, scores.T).T).sum()) / max(variance, 1e-300)
    expected = max(size - float(np.trace(total)), 1e-3 * size)
    return observed / expected, float(np.sqrt(2 * max(scatter, 0.0))) / expected


def _scores(equations: NormalEquations) -> np.ndarray:
    """s_j (V, S): the gradient by the shared parameters that each view leaves once its pose has settled."""
    solved = np.linalg.solve(equations.pose, equations.pose_gradient[..., None])
    scores: FloatArray = equations.shared_gradients - (np.swapaxes(equations.mixed, 1, 2) @ solved)[..., 0]
    return scores


def view_robust_covariance(equations: NormalEquations) -> np.ndarray:
    """Covariance (S, S) of the shared parameters with residuals of one view free to correlate.

    The sandwich I⁻¹ (V/(V − 1) Σ_j s_j s_jᵀ) I⁻¹ over the views' scores s_j = g_sj − B_jᵀ A_j⁻¹ g_j.
    """
    scores = _scores(equations)
    views = len(scores)
    information = reduced_information(equations)
    half = solve_scaled(information, scores.T)
    covariance: FloatArray = half @ half.T * (views / max(views - 1, 1))
    return covariance


def unbiased_view_robust_covariance(equations: NormalEquations) -> np.ndarray:
    """``view_robust_covariance`` that does not take a view's own pull for agreement.

    A view that alone holds a parameter has hardly any residual left, and so a score near zero. With I_j what view j
    tells, scores (1 − I_j I⁻¹)^−½ s_j have the scatter that they should where residuals are independent after all (Bell
    and McCaffrey, Survey Methodology 28, 2002): Σ_j t_j t_jᵀ of t_j = (1 − A_j)^−½ I^−½ s_j, A_j = I^−½ I_j I^−½.
    """
    scores, each = _scores(equations), _information_of_views(equations)
    information = each.sum(axis=0) + equations.prior
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * scale[:, None] * scale)
    root = (vectors / np.sqrt(np.maximum(values, 1e-300))) @ vectors.T * scale
    shares, axes = np.linalg.eigh(root @ each @ root.T)
    along = np.einsum("vij,vi->vj", axes, scores @ root.T) / np.sqrt(np.clip(1 - shares, 1e-9, 1.0))
    half = root.T @ np.einsum("vij,vj->iv", axes, along)
    covariance: FloatArray = half @ half.T
    return covariance


def _information_of_views(equations: NormalEquations) -> np.ndarray:
    """I_j (V, S, S): what each view tells of the shared parameters once its pose is free."""
    settled = np.linalg.solve(equations.pose, equations.mixed)
    own = slice(equations.view_size, -1)
    information: FloatArray = equations.by_view[:, own, own] - np.swapaxes(equations.mixed, 1, 2) @ settled
    return information
