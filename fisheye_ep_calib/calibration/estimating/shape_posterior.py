"""What one linearisation of the adjustment says of a target's shape under any variances (target/shape/variances.py).

What is eliminated first (shape_equations.py) is kept: poses serve all variances, points those of the same penalties.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, evaluate
from fisheye_ep_calib.calibration.estimating.eliminated_system import Eliminated, Factored
from fisheye_ep_calib.calibration.estimating.shape_equations import block_system
from fisheye_ep_calib.target.shape.model import AXIS_GROUP
from fisheye_ep_calib.target.shape.variances import Likelihood, Posterior, Variances


@dataclass(frozen=True)
class _Kept:
    """What was eliminated last. used (G,): the groups that are there. kind, penalty: of the unknowns in blocks."""

    used: np.ndarray
    kind: str
    penalty: np.ndarray
    eliminated: Eliminated

    def serves(self, used: np.ndarray, penalty: np.ndarray) -> bool:
        """Whether it holds what is asked for, under the same penalty."""
        points = np.array_equal(used[AXIS_GROUP], self.used[AXIS_GROUP])
        return points and not (used & ~self.used).any() and np.array_equal(penalty, self.penalty)


class Linearisation:
    """The normal equations at one state of a problem whose shape is free, to be solved under different variances."""

    def __init__(self, problem: AdjustmentProblem, state: AdjustmentState, point_count: int) -> None:
        self._equations = evaluate(problem, state, penalised=False).from_flat(state.shape.vector)
        self._model = problem.shape
        self._group = problem.shape.group
        points = len(problem.shape.nominal) if problem.shape.rough_size else 0
        self._unknown_group = np.concatenate([self._group, np.tile(AXIS_GROUP, points)])
        self._freedom = 2 * point_count - 6 * problem.view_count - problem.shared_size
        self._kept: _Kept | None = None

    @property
    def valid(self) -> bool:
        return self._equations.valid and self._freedom > 0

    def __call__(self, variances: Variances) -> Posterior:
        """The shape's posterior. Raises numpy.linalg.LinAlgError where the sightings leave something open."""
        solution, likelihood = self._solved(variances)
        value, variance = (
            np.concatenate([of_kind["smooth"], of_kind["rough"]]) for of_kind in (solution.step, solution.variance)
        )
        return Posterior(
            likelihood.group,
            likelihood.objective,
            likelihood.log_determinant,
            likelihood.freedom,
            value,
            variance,
        )

    def likelihood(self, variances: Variances) -> Likelihood:
        """That of the posterior, at less than half of its cost. Raises numpy.linalg.LinAlgError like it."""
        return self._solved(variances)[1]

    def _solved(self, variances: Variances) -> tuple[Factored, Likelihood]:
        used, of_group = variances.deviation > 0, np.append(variances.penalties, 0.0)
        smooth = self._group[used[self._group]]
        rough = self._unknown_group[len(self._group) :]
        rough = rough[used[rough]]
        groups = {
            "pose": np.full(self._equations.pose.shape[0] * self._equations.view_size, -1),
            "camera": np.full(len(self._equations.shared), -1),
            "smooth": smooth,
            "rough": rough,
        }
        penalties = {kind: of_group[group] for kind, group in groups.items()}
        solution = self._eliminated(used, penalties).factored(penalties)
        group = np.concatenate([smooth, rough])
        objective = 2 * self._equations.cost - solution.decrease
        return solution, Likelihood(group, objective, solution.log_determinant, self._freedom)

    def _eliminated(self, used: np.ndarray, penalties: dict[str, np.ndarray]) -> Eliminated:
        """Without the unknowns in blocks. It is kept: other variances may differ in the rest, or have less of it."""
        shape, equations, kept = self._equations.shape, self._equations, self._kept
        assert shape is not None
        if kept is not None and kept.serves(used, penalties[kept.kind]):
            return kept.eliminated.without_smooth(used[self._group][kept.used[self._group]])
        chosen = shape.chosen(used[self._group], used[AXIS_GROUP])
        system = block_system(equations.pose, equations.mixed, equations.shared, chosen)
        gradient = {
            "pose": equations.pose_gradient.reshape(-1),
            "camera": equations.shared_gradient,
            "smooth": chosen.gradient[: chosen.smooth_size],
            "rough": chosen.gradient[chosen.smooth_size :],
        }
        kind = system.block_kind
        self._kept = None  # not two at a time: they are large
        self._kept = _Kept(used, kind, penalties[kind], system.eliminated(gradient, penalties[kind]))
        return self._kept.eliminated

    def shift_variance(self, variances: Variances) -> np.ndarray:
        """Variance (n, 3) of every point's shift in the target frame, in units of σ²: m²/px²."""
        rows, own, inverse = self._shifts(variances)
        variance: FloatArray = np.einsum("nii->ni", own) + ((rows @ inverse) * rows).sum(axis=-1)
        return variance

    def sum_variance(self, variances: Variances, weights: np.ndarray) -> float:
        """Variance of Σ w · shift over all points, weights w (n, 3) in the target frame, in units of σ²."""
        rows, own, inverse = self._shifts(variances)
        row = np.einsum("ni,nik->k", weights, rows)
        return float(row @ inverse @ row + np.einsum("ni,nij,nj->", weights, own, weights))

    def _shifts(self, variances: Variances) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows M_i (n, 3, D), what comes of a point alone (n, 3, 3), and (H + P)⁻¹ of the D dense unknowns.

        A shift is M (a, ρ_i) with M = [φ(i), A]; where points are eliminated first, ρ_i = −D_i⁻¹ G_i d of the dense
        unknowns d adds to its rows, and A D_i⁻¹ Aᵀ to its variance.
        """
        shape, fields, axes = self._equations.shape, self._model.fields[:, :3], self._model.point_axes
        assert shape is not None
        used = variances.deviation > 0
        smooth, along = used[self._group], used[AXIS_GROUP]
        chosen = shape.chosen(smooth, along)
        penalty = variances.penalties[self._unknown_group[used[self._unknown_group]]]
        chosen = chosen.penalised(penalty, np.zeros_like(penalty))
        equations = self._equations
        system = block_system(equations.pose, equations.mixed, equations.shared, chosen)
        reduced, solved = system.reduced()
        inverse, _ = inverse_and_log_determinant(reduced)
        points = len(fields)
        rows = np.zeros((points, 3, len(reduced)))
        rows[..., system.places["smooth"][1]] = fields[..., smooth]
        own = np.zeros((points, 3, 3))
        if along.any():
            is_dense, place = system.places["rough"]
            if is_dense:
                each = np.zeros((points, 3, points, int(along.sum())))
                each[np.arange(points), :, np.arange(points)] = axes[..., along]
                rows[..., place] = each.reshape(points, 3, -1)
            else:
                rows -= axes[..., along] @ solved
                own = np.einsum("nia,nab,njb->nij", axes[..., along], np.linalg.inv(system.blocks), axes[..., along])
        return rows, own, inverse


def inverse_and_log_determinant(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse and log-determinant of a symmetric positive definite matrix, its diagonal scaled to one meanwhile."""
    if len(matrix) == 0:
        return matrix, 0.0
    from scipy.linalg import lapack  # half a second that a command's --help need not wait for

    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    factor, failed = lapack.dpotrf(matrix * scale[:, None] * scale, lower=1)
    if failed:
        raise np.linalg.LinAlgError
    inverse, failed = lapack.dpotri(factor, lower=1)
    if failed:
        raise np.linalg.LinAlgError
    log_determinant = 2 * float(np.log(np.diag(factor)).sum() - np.log(scale).sum())
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    return inverse * scale[:, None] * scale, log_determinant
