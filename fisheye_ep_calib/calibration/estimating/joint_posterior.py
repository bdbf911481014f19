"""The target's shape, a lens field and what differs from view to view, under any variances, from one linearisation.

Groups of coefficients, each a priori N(0, τ²): those of the shape (target/shape/model.py, metres), of the views
(view_effects.py, metres and radians) and of the lens field by azimuthal order. The field's columns of each order are
made orthonormal over the sightings, so that its τ is in pixels. The likelihood is that of target/shape/variances.py: as
it is of the same residuals, models with other groups are compared by it. What has no prior, camera and poses, has its
solution and its covariance with every choice of variances: one Gauss–Newton step from the linearisation's state.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, evaluate
from fisheye_ep_calib.calibration.estimating.eliminated_system import Eliminated, Factored
from fisheye_ep_calib.calibration.estimating.fit import Fit, opened
from fisheye_ep_calib.calibration.estimating.gathered_field import field_prior, with_gathered_field
from fisheye_ep_calib.calibration.estimating.shape_equations import (
    BlockSystem,
    ShapeEquations,
    block_system,
    solve_scaled,
)
from fisheye_ep_calib.calibration.estimating.sightings import Sightings
from fisheye_ep_calib.calibration.estimating.view_effects import VIEW_GROUPS, view_effects
from fisheye_ep_calib.calibration.field_prior import FieldPrior
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD, ORDERS
from fisheye_ep_calib.target.shape.model import AXIS_GROUP, FREE, GROUPS, free_model
from fisheye_ep_calib.target.shape.variances import Likelihood, Posterior, Variances

LENS_GROUPS = tuple(f"lens order {order}" for order in ORDERS)
JOINT_GROUPS = (*GROUPS, *VIEW_GROUPS, *LENS_GROUPS)
FIRST_VIEW, FIRST_LENS = len(GROUPS), len(GROUPS) + len(VIEW_GROUPS)
_FREE = -1  # without a prior
_NO_FIELD = 1e-3  # pixels: τ of an order that has vanished beside another that has not


@dataclass(frozen=True)
class JointPosterior(Posterior):
    """With the camera: change (P,) of its free parameters from the linearisation's state, and S (P, P), its covariance
    over σ². kinds: how many of the coefficients are the shape's, the views' and the lens field's, in this order.
    """

    change: np.ndarray
    camera: np.ndarray
    kinds: tuple[int, int, int]


@dataclass(frozen=True)
class _Assembled:
    """Normal equations of some groups. groups: by kind of unknown the group of each, or _FREE.

    group (K,): of each coefficient. kinds: as of the posterior.
    """

    system: BlockSystem
    gradient: dict[str, np.ndarray]
    groups: dict[str, np.ndarray]
    group: np.ndarray
    kinds: tuple[int, int, int]


class JointLinearisation:
    """Of a problem whose shape, view effects and lens field are all free, at a state."""

    def __init__(self, problem: AdjustmentProblem, state: AdjustmentState, point_count: int) -> None:
        effects, shape = problem.effects, problem.shape
        assert effects is not None
        equations = evaluate(problem, state, penalised=False)
        if len(state.effects):
            equations = equations.without_effects(state.effects)
        if equations.shape is not None:
            equations = equations.from_flat(state.shape.vector)
        self.point_count = point_count
        self._view_group = FIRST_VIEW + effects.group
        self._smooth_group = shape.group if problem.shape_size else np.zeros(0, int)
        names = np.array(state.camera.parameter_names)[problem.free]
        in_field = np.isin(np.concatenate([names, [""] * problem.bow_size]), LENS_FIELD.coefficient_names)
        self._camera_columns, field = np.flatnonzero(~in_field), np.flatnonzero(in_field)
        self.camera_names = tuple(names[~in_field[: len(names)]].tolist())
        if len(field):
            equations = equations.without_shared(field, state.camera.parameters[problem.free][field])
        self._field_gram = equations.shared[np.ix_(field, field)]
        self._equations, lens_order = with_gathered_field(equations, field, point_count)
        self._lens_group = FIRST_LENS + lens_order
        self._lens_columns = len(in_field) - len(field) + np.arange(len(self._lens_group))
        if len(field):
            self._camera_columns = np.arange(len(in_field) - len(field))
        self._kept_assembled: tuple[bytes, _Assembled] | None = None
        self._kept_eliminated: tuple[tuple[int, bytes], Eliminated] | None = None
        self.freedom = 2 * point_count - 6 * problem.view_count - len(self._camera_columns)

    @property
    def valid(self) -> bool:
        return self._equations.valid and self.freedom > 0

    @property
    def available(self) -> tuple[str, ...]:
        """Groups of which there are columns."""
        shape = self._equations.shape
        rough = AXIS_GROUP if shape is not None and shape.rough.size else np.zeros(0, int)
        there = np.concatenate([self._smooth_group, rough, self._view_group, self._lens_group])
        return tuple(JOINT_GROUPS[group] for group in np.unique(there))

    def __call__(self, variances: Variances) -> JointPosterior:
        """Raises numpy.linalg.LinAlgError where the sightings leave something open."""
        solution, kinds, likelihood = self._solved(variances)
        first = len(self._camera_columns)
        parts = [
            (
                solved["smooth"],
                solved["rough"],
                solved["pose"].reshape(len(self._equations.pose), -1)[:, 6:].reshape(-1),
                solved["camera"][first:],
            )
            for solved in (solution.step, solution.variance)
        ]
        return JointPosterior(
            likelihood.group,
            likelihood.objective,
            likelihood.log_determinant,
            likelihood.freedom,
            np.concatenate(parts[0]),
            np.concatenate(parts[1]),
            solution.step["camera"][:first],
            solution.camera[:first, :first],
            kinds,
        )

    def likelihood(self, variances: Variances) -> Likelihood:
        """That of the posterior, at a third of its cost. Raises numpy.linalg.LinAlgError like it."""
        return self._solved(variances)[2]

    def _solved(self, variances: Variances) -> tuple[Factored, tuple[int, int, int], Likelihood]:
        """The normal equations under these variances, factored; kinds of coefficients; the likelihood."""
        assembled = self._assembled(variances.deviation > 0)
        of_group = np.append(variances.penalties, 0.0)
        penalties = {kind: of_group[group] for kind, group in assembled.groups.items()}
        solution = self._eliminated(assembled, penalties[assembled.system.block_kind]).factored(penalties)
        objective = 2 * self._equations.cost - solution.decrease
        likelihood = Likelihood(assembled.group, objective, solution.log_determinant, self.freedom)
        return solution, assembled.kinds, likelihood

    def _eliminated(self, assembled: _Assembled, penalty: np.ndarray) -> Eliminated:
        """Without the unknowns in blocks; kept for the next variances, which may differ in others alone."""
        key = (id(assembled), penalty.tobytes())
        if self._kept_eliminated is None or self._kept_eliminated[0] != key:
            self._kept_eliminated = None  # not two at a time: they are large
            self._kept_eliminated = key, assembled.system.eliminated(assembled.gradient, penalty)
        return self._kept_eliminated[1]

    def _assembled(self, used: np.ndarray) -> _Assembled:
        """The normal equations of the groups in use, without penalties; kept, as the next variances are of the same."""
        key = used.tobytes()
        if self._kept_assembled is None or self._kept_assembled[0] != key:
            self._kept_assembled = self._kept_eliminated = None
            self._kept_assembled = key, self._assemble(used)
        return self._kept_assembled[1]

    def _assemble(self, used: np.ndarray) -> _Assembled:
        equations = self._equations
        views = np.flatnonzero(used[self._view_group])
        view_group, lens = self._view_group[views], self._lens_columns[used[self._lens_group]]
        lens_group = self._lens_group[used[self._lens_group]]
        own, shared = np.concatenate([np.arange(6), 6 + views]), np.concatenate([self._camera_columns, lens])
        pose, camera = equations.pose[:, own[:, None], own], equations.shared[np.ix_(shared, shared)]
        shape, shape_group = self._chosen_shape(used, own, shared)
        smooth, count = shape.smooth_size, len(pose)
        gradient = {
            "pose": equations.pose_gradient[:, own].reshape(-1),
            "camera": equations.shared_gradient[shared],
            "smooth": shape.gradient[:smooth],
            "rough": shape.gradient[smooth:],
        }
        groups = {
            "pose": np.tile(np.concatenate([np.full(6, _FREE), view_group]), count),
            "camera": np.concatenate([np.full(len(self._camera_columns), _FREE), lens_group]),
            "smooth": shape_group[:smooth],
            "rough": shape_group[smooth:],
        }
        return _Assembled(
            block_system(pose, equations.mixed[:, own[:, None], shared], camera, shape),
            gradient,
            groups,
            np.concatenate([shape_group, np.tile(view_group, count), lens_group]),
            (len(shape_group), len(view_group) * count, len(lens_group)),
        )

    def _chosen_shape(self, used: np.ndarray, own: np.ndarray, shared: np.ndarray) -> tuple[ShapeEquations, np.ndarray]:
        """The shape's equations of the groups in use, with some of the views' and shared columns; their groups (K,)."""
        shape = self._equations.shape
        if shape is None:
            views = len(self._equations.by_view)
            none = np.zeros((0, 0))
            return ShapeEquations(
                np.zeros((views, len(own), 0)), np.zeros((len(shared), 0)), none, np.zeros((0, 3, 3)), np.zeros(0)
            ), np.zeros(0, int)
        axes = used[AXIS_GROUP] if shape.rough.size else np.zeros(3, bool)
        chosen = shape.chosen(used[self._smooth_group], axes)
        smooth = self._smooth_group[used[self._smooth_group]]
        group = np.concatenate([smooth, np.tile(AXIS_GROUP[axes], len(shape.rough) * bool(axes.any()))])
        return replace(chosen, pose=chosen.pose[:, own], camera=chosen.camera[shared]), group

    def effect_of_unit(self, group: int) -> float:
        """Root mean square, px, of what a coefficient 1 of a group does to the points of all views."""
        if group >= FIRST_LENS:
            return 1.0
        columns = 6 + np.flatnonzero(self._view_group == group)
        square = self._equations.by_view[:, columns, columns].sum(axis=0).mean()
        return float(np.sqrt(square / self.point_count))

    def field_prior(self, variances: Variances) -> FieldPrior:
        """Of the lens field's own coefficients under these variances."""
        tau = np.maximum(variances.deviation[FIRST_LENS:], _NO_FIELD)
        return field_prior(self._field_gram, tau, variances.noise, self.point_count)

    def expected_square(self, variances: Variances, groups: Iterable[str]) -> np.ndarray:
        """Of every view (V,) what some of the views' groups do to its points a priori, px² summed: Σ τ_k² |z_k|²."""
        own = np.isin(np.array(JOINT_GROUPS)[self._view_group], list(groups))
        columns = 6 + np.flatnonzero(own)
        square: np.ndarray = (
            self._equations.by_view[:, columns, columns] @ variances.deviation[self._view_group[own]] ** 2
        )
        return square

    def visible(self, variances: Variances, posterior: JointPosterior, groups: Iterable[str]) -> float:
        """What some groups do to the residuals of a camera and poses fitted without them: px², summed over the points.

        The posterior's mean of |M Z b|², Z their columns and M the projection that eliminates poses and camera:
        |M Z a|² + σ² tr(Zᵀ M Z S). With S = (Zᵀ M Z + P)⁻¹, as it is where all groups are asked for, the trace is
        Σ γ_k, γ_k = 1 − S_kk P_kk (variances.py), and not less otherwise. The prior's mean, τ² tr(Zᵀ M Z), would miss
        that of a few coefficients each is what it is.
        """
        wanted = np.isin(np.array(JOINT_GROUPS)[posterior.group], list(groups))
        value = np.where(wanted, posterior.value, 0.0)
        spread = float(posterior.determined(variances)[wanted].sum()) * variances.noise**2
        return self._square_beside_camera(variances, posterior, value) + spread

    def _parts(self, variances: Variances, posterior: JointPosterior) -> tuple[np.ndarray, np.ndarray, ShapeEquations]:
        """Columns used of the views' own and of the lens field; the shape's equations with all the other columns."""
        used = variances.deviation > 0
        views = 6 + np.flatnonzero(used[self._view_group])
        lens = self._lens_columns[used[self._lens_group]]
        shape, _ = self._chosen_shape(
            used, np.arange(self._equations.view_size), np.arange(len(self._equations.shared))
        )
        return views, lens, shape

    def _square_beside_camera(self, variances: Variances, posterior: JointPosterior, value: np.ndarray) -> float:
        """|M Z a|² of coefficients a (K,) in the posterior's order."""
        equations = self._equations
        views, lens, shape = self._parts(variances, posterior)
        ends = np.cumsum(posterior.kinds)
        a, by_view, of_lens = (
            value[: ends[0]],
            value[ends[0] : ends[1]].reshape(len(equations.pose), -1),
            value[ends[1] :],
        )
        camera = self._camera_columns
        hessian, size = equations.by_view, equations.view_size
        on_own = shape.pose @ a + np.einsum("vqk,vk->vq", hessian[:, :size, views], by_view)
        on_own += equations.mixed[:, :, lens] @ of_lens
        on_shared = shape.camera @ a + np.einsum("vsk,vk->s", hessian[:, size:-1, views], by_view)
        on_shared += equations.shared[:, lens] @ of_lens
        square = a @ shape.times(a) + 2 * (np.einsum("vq,vqk->k", by_view, shape.pose[:, views]) @ a)
        square += np.einsum("vk,vkl,vl->", by_view, hessian[:, views[:, None], views], by_view)
        square += of_lens @ (2 * on_shared[lens] - equations.shared[np.ix_(lens, lens)] @ of_lens)
        pose, mixed = equations.pose[:, :6, :6], equations.mixed[:, :6, camera]
        on_pose = on_own[:, :6]
        settled = np.linalg.solve(pose, np.concatenate([mixed, on_pose[..., None]], axis=-1))
        reduced = equations.shared[np.ix_(camera, camera)] - np.einsum("vqs,vqt->st", mixed, settled[..., :-1])
        right = on_shared[camera] - np.einsum("vqs,vq->s", mixed, settled[..., -1])
        taken = (on_pose * settled[..., -1]).sum() + right @ solve_scaled(reduced, right)
        return max(float(square - taken), 0.0)


def linearised_jointly(fit: Fit) -> JointLinearisation:
    """At a fit, whatever of shape, views and lens field it has: all of them free."""
    sightings, structure = fit.sightings, fit.structure
    points = seen_points(sightings)
    effects = view_effects(sightings.target, points, sightings.observations.image_size[1])
    extras = tuple(dict.fromkeys((*structure.extras, LENS_FIELD.name)))
    structure = replace(structure, extras=extras, field_prior=None)
    sightings = replace(sightings, effects=effects)
    if sightings.features.board.planar:
        structure = replace(structure, board_shape=FREE)
        if not fit.problem.shape_size:
            sightings = replace(sightings, free=free_model(sightings.target, points))
    return JointLinearisation(*opened(fit, structure, sightings), sightings.point_count)


def seen_points(sightings: Sightings) -> np.ndarray:
    """Which points (n,) of the target are seen by the images in use."""
    observations = sightings.observations
    used = (observations.weights > 0) & np.isin(observations.image_index, sightings.images)
    return np.bincount(observations.point_index[used], minlength=len(observations.object_points)) > 0
