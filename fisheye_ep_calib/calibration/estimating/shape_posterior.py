"""What one linearisation of the adjustment says of a target's shape under any variances (target/shape/variances.py).

The poses are eliminated once for all variances; where the points are (shape_equations.py), for each variances anew.
"""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, evaluate
from fisheye_ep_calib.calibration.estimating.shape_equations import ShapeEquations, block_system
from fisheye_ep_calib.target.shape.model import AXIS_GROUP
from fisheye_ep_calib.target.shape.variances import Posterior, Variances


class Linearisation:
    """The normal equations at one state of a problem whose shape is free, to be solved under different variances."""

    def __init__(self, problem: AdjustmentProblem, state: AdjustmentState, point_count: int) -> None:
        self._equations = evaluate(problem, state, penalised=False).from_flat(state.shape.vector)
        self._model = problem.shape
        self._group = problem.shape.group
        points = len(problem.shape.nominal) if problem.shape.rough_size else 0
        self._unknown_group = np.concatenate([self._group, np.tile(AXIS_GROUP, points)])
        self._freedom = 2 * point_count - 6 * problem.view_count - problem.shared_size
        self._systems: dict[bytes, tuple[np.ndarray, np.ndarray, float, float]] = {}

    @property
    def valid(self) -> bool:
        return self._equations.valid and self._freedom > 0

    def __call__(self, variances: Variances) -> Posterior:
        """The shape's posterior. Raises numpy.linalg.LinAlgError where the sightings leave something open."""
        shape, equations = self._equations.shape, self._equations
        assert shape is not None
        used = variances.deviation > 0
        kept = used[self._unknown_group]
        chosen = shape.chosen(used[self._group], used[AXIS_GROUP])
        group = self._unknown_group[kept]
        penalty = variances.penalties[group]
        points_first = equations.view_size * len(equations.by_view) < chosen.rough.shape[0] * chosen.rough.shape[-1]
        if points_first:
            solved = self._with_points_first(chosen.penalised(penalty, np.zeros_like(penalty)))
        else:
            solved = self._with_poses_first(kept, chosen, penalty)
        value, variance, log_determinant, decrease = solved
        return Posterior(group, 2 * equations.cost - decrease, log_determinant, self._freedom, value, variance)

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

    def _with_poses_first(
        self, kept: np.ndarray, chosen: ShapeEquations, penalty: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Value (K,), diagonal of S (K,), log-determinant and decrease of the objective, dense in camera and shape."""
        key = kept.tobytes()
        if key not in self._systems:
            self._systems = {key: self._without_poses(chosen)}
        matrix, gradient, log_poses, decrease = self._systems[key]
        camera = len(matrix) - len(penalty)
        diagonal = np.arange(camera, len(matrix))
        matrix = matrix.copy()
        matrix[diagonal, diagonal] += penalty
        inverse, log_determinant = inverse_and_log_determinant(matrix)
        step = -inverse @ gradient
        return (
            step[camera:],
            np.diag(inverse)[camera:],
            log_poses + log_determinant,
            decrease - float(step @ gradient),
        )

    def _without_poses(self, chosen: ShapeEquations) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Matrix and gradient of camera and shape with the poses eliminated, log-determinant and decrease of that."""
        equations = self._equations
        system = block_system(equations.pose, equations.mixed, equations.shared, chosen)
        matrix, solved = system.reduced()
        own = equations.pose_gradient.reshape(-1)
        gradient = np.concatenate([equations.shared_gradient, chosen.gradient])
        gradient -= solved.reshape(len(own), -1).T @ own
        settled = np.linalg.solve(equations.pose, equations.pose_gradient[..., None]).reshape(-1)
        return matrix, gradient, float(np.linalg.slogdet(equations.pose)[1].sum()), float(settled @ own)

    def _with_points_first(self, chosen: ShapeEquations) -> tuple[np.ndarray, np.ndarray, float, float]:
        """The same with the points in blocks and poses, camera and smooth fields dense."""
        equations, smooth = self._equations, chosen.smooth_size
        system = block_system(equations.pose, equations.mixed, equations.shared, chosen)
        reduced, coupled = system.reduced()
        own = chosen.gradient[smooth:].reshape(system.blocks.shape[:2])
        dense = np.concatenate(
            [equations.pose_gradient.reshape(-1), equations.shared_gradient, chosen.gradient[:smooth]]
        )
        flat = coupled.reshape(own.size, -1)
        inverse_blocks = np.linalg.inv(system.blocks)
        settled = (inverse_blocks @ own[..., None]).reshape(-1)
        inverse, log_determinant = inverse_and_log_determinant(reduced)
        right = dense - flat.T @ own.reshape(-1)
        step = -inverse @ right
        rough = -(settled + flat @ step)
        variance = np.einsum("nii->ni", inverse_blocks).reshape(-1) + ((flat @ inverse) * flat).sum(axis=1)
        log_determinant += float(np.linalg.slogdet(system.blocks)[1].sum())
        decrease = -float(rough @ own.reshape(-1) + step @ dense)
        first = len(dense) - smooth
        return (
            np.concatenate([step[first:], rough]),
            np.concatenate([np.diag(inverse)[first:], variance]),
            log_determinant,
            decrease,
        )


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
