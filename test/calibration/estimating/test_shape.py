"""The target's shape in the adjustment: derivatives, both orders of elimination, and boards of known shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import aligned, seen_bent

from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.estimating.adjustment import evaluate, residuals, stepped
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.normal_equations import Step, reduced_information, solve_damped
from fisheye_ep_calib.calibration.estimating.shape_estimate import linearised, with_estimated_shape
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.target.shape.model import FREE, GROUPS, free_model, with_variances
from fisheye_ep_calib.target.shape.variances import Posterior, Variances

STRUCTURE = Structure("ep_even", board_shape=FREE)
RICH = Structure("ep_even", terms=4, lens="kannala_brandt_6", extras=("tangential",))


def discs():
    return observe(paper_camera(), paper_target(), paper_poses(paper_target())[::5], noise=0.3)


def partly_seen(views: int):
    """Some points missing in every view, so that views differ."""
    observations, _ = seen_bent("wave", 2e-4, views=views, noise=0.3)
    rng = np.random.default_rng(4)
    return replace(observations, weights=rng.choice([0.0, 1.0, 2.0], len(observations.pixels)))


SCENES = {
    "points, eliminated first": lambda: partly_seen(6),
    "points, poses eliminated first": lambda: partly_seen(40),
    "discs": discs,
}


def somewhere(name: str, groups: tuple[str, ...] = GROUPS) -> Fit:
    """A fit with a free shape at a state that is not its minimum, with a shape that is not flat."""
    sightings = prepare(SCENES[name]())
    fit = refine(first_fit(sightings), replace(STRUCTURE, board_shape="flat"))
    space = free_model(sightings.target, np.ones(len(sightings.target.nominal), bool))
    variances = Variances(np.array([5e-5 * (name in groups) for name in GROUPS]), 0.3)
    nothing = Posterior(np.zeros(0, int), 1.0, 0.0, 1, np.zeros(0), np.zeros(0))
    free = with_variances(space, variances, nothing)
    sightings = replace(sightings, free=free)
    fit = refine(fit, STRUCTURE, sightings, tolerance=1e-2)
    rng = np.random.default_rng(3)
    step = Step(
        rng.normal(0, 1e-4, (len(sightings.images), 6)),
        np.concatenate([np.zeros(fit.problem.shared_size), rng.normal(0, 5e-5, free.size)]),
        0.0,
    )
    state = stepped(fit.problem, fit.state, step)
    assert state is not None
    equations = evaluate(fit.problem, state)
    return replace(fit, adjustment=replace(fit.adjustment, state=state, equations=equations))


def dense_system(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and matrix of poses, camera and shape, from ``ShapeEquations`` alone."""
    equations, shape = fit.adjustment.equations, fit.adjustment.equations.shape
    assert shape is not None
    views, size = len(equations.by_view), fit.problem.shared_size
    count = 6 * views + size + len(shape.gradient)
    matrix = np.zeros((count, count))
    for view in range(views):
        own = slice(6 * view, 6 * view + 6)
        matrix[own, own] = equations.pose[view]
        matrix[own, 6 * views :] = np.concatenate([equations.mixed[view], shape.pose[view]], axis=1)
    camera = slice(6 * views, 6 * views + size)
    matrix[camera, camera] = equations.shared
    matrix[camera, camera.stop :] = shape.camera
    smooth = camera.stop + shape.smooth_size
    matrix[camera.stop : smooth, camera.stop :] = shape.smooth
    for point, block in enumerate(shape.rough):
        own = slice(smooth + 3 * point, smooth + 3 * point + 3)
        matrix[own, own] = block
    upper = np.triu(matrix)
    gradient = np.concatenate([equations.pose_gradient.ravel(), equations.shared_gradient, shape.gradient])
    return gradient, upper + np.triu(upper, 1).T


@pytest.mark.parametrize("name", SCENES)
def test_the_gradient_is_that_of_the_cost(name) -> None:
    fit = somewhere(name)
    gradient, matrix = dense_system(fit)
    views = len(fit.sightings.images)
    rng = np.random.default_rng(0)
    scale = 1 / np.sqrt(np.diag(matrix))
    for _ in range(8):
        direction = rng.normal(0, 1, len(gradient)) * scale

        def cost(length: float, direction=direction) -> float:
            moved = length * direction
            state = stepped(fit.problem, fit.state, Step(moved[: 6 * views].reshape(-1, 6), moved[6 * views :], 0.0))
            return evaluate(fit.problem, state).cost

        step = 1e-3
        slope = (cost(step) - cost(-step)) / (2 * step)
        assert slope == pytest.approx(gradient @ direction, rel=1e-5, abs=1e-6 * np.abs(gradient * direction).sum())


@pytest.mark.parametrize("name", SCENES)
def test_the_matrix_is_that_of_the_residuals(name) -> None:
    fit = somewhere(name)
    _, matrix = dense_system(fit)
    views, weights = len(fit.sightings.images), fit.sightings.observations.weights
    rng = np.random.default_rng(1)
    scale = 1 / np.sqrt(np.diag(matrix))
    penalty = np.concatenate([np.zeros(len(matrix) - fit.problem.shape.size), fit.problem.shape.all_penalties])

    def error(moved: np.ndarray) -> np.ndarray:
        state = stepped(fit.problem, fit.state, Step(moved[: 6 * views].reshape(-1, 6), moved[6 * views :], 0.0))
        found, _, _ = residuals(fit.problem, state, len(weights))
        return np.where(weights[:, None] > 0, np.nan_to_num(found) * weights[:, None], 0.0).ravel()

    for _ in range(6):
        direction = rng.normal(0, 1, len(matrix)) * scale
        change = (error(1e-3 * direction) - error(-1e-3 * direction)) / 2e-3
        expected = change @ change + penalty @ direction**2
        assert direction @ matrix @ direction == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("groups", [GROUPS, ("z2", "z5", "xy1"), ("rough xy",)])
@pytest.mark.parametrize("name", SCENES)
def test_steps_and_information_are_those_of_the_dense_system(name, groups) -> None:
    fit = somewhere(name, groups)
    gradient, matrix = dense_system(fit)
    equations, views, size = fit.adjustment.equations, len(fit.sightings.images), fit.problem.shared_size
    for damping in (1e-6, 1e-1):
        step = solve_damped(equations, damping)
        both = np.concatenate([step.pose.ravel(), step.shared])
        expected = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), gradient)
        unit = np.sqrt(np.diag(matrix))
        assert np.abs((both - expected) * unit).max() < 1e-5 * np.abs(expected * unit).max()
        assert step.predicted_decrease == pytest.approx(-(gradient @ both + 0.5 * both @ matrix @ both), rel=1e-5)
    scale = 1 / np.sqrt(np.diag(matrix))
    camera = slice(6 * views, 6 * views + size)
    covariance = (np.linalg.inv(matrix * scale[:, None] * scale) * scale[:, None] * scale)[camera, camera]
    information = reduced_information(fit.settled)
    assert np.abs(information @ covariance - np.eye(size)).max() < 1e-4


@pytest.mark.parametrize("name", SCENES)
def test_the_shape_posterior_is_that_of_the_dense_system(name) -> None:
    fit = somewhere(name)
    variances = fit.problem.shape.variances
    posterior = linearised(fit)(variances)
    gradient, matrix = dense_system(fit)
    first = len(matrix) - fit.problem.shape.size
    scale = 1 / np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix * scale[:, None] * scale) * scale[:, None] * scale
    step = -inverse @ gradient
    value = fit.state.shape.vector + step[first:]
    assert np.abs(posterior.value - value).max() < 1e-5 * np.abs(value).max()
    assert posterior.variance == pytest.approx(np.diag(inverse)[first:], rel=1e-5)
    assert posterior.log_determinant == pytest.approx(float(np.linalg.slogdet(matrix)[1]), rel=1e-9)
    assert posterior.objective == pytest.approx(2 * fit.adjustment.equations.cost + gradient @ step, rel=1e-8)
    shape, points = fit.problem.shape, len(fit.problem.shape.nominal)
    rows = np.zeros((points, 3, shape.size))
    rows[..., : shape.smooth_size] = shape.fields[:, :3]
    for point in range(points):
        own = shape.smooth_size + 3 * point
        rows[point, :, own : own + 3] = shape.frame.axes
    expected = np.einsum("nik,kl,nil->ni", rows, inverse[first:, first:], rows)
    assert linearised(fit).shift_variance(variances) == pytest.approx(expected, rel=1e-5)
    weights = np.random.default_rng(1).normal(0, 1, (points, 3))
    row = np.einsum("ni,nik->k", weights, rows)
    expected = row @ inverse[first:, first:] @ row
    assert linearised(fit).sum_variance(variances, weights) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("kind", "amount"), [("bow", 3e-4), ("wave", 2e-4), ("corner", 5e-4), ("stretched", 3e-3), ("jitter", 3e-5)]
)
def test_a_bent_board_is_found_with_the_camera(kind, amount) -> None:
    observations, true = seen_bent(kind, amount)
    known = refine(first_fit(prepare(replace(observations, object_points=true))), Structure("ep_even"))
    flat = refine(first_fit(prepare(observations)), Structure("ep_even"))
    rich = with_estimated_shape(refine(flat, RICH), RICH)
    fit = refine(rich, STRUCTURE, rich.sightings)
    assert fit.adjustment.converged
    points = fit.problem.shape.surface(fit.state.shape).points
    nominal = observations.object_points
    left = np.sqrt(((aligned(points, true) - true) ** 2).sum(axis=1).mean())
    before = np.sqrt(((aligned(nominal, true) - true) ** 2).sum(axis=1).mean())
    assert left < 0.55 * before
    assert np.sqrt(((points - points.mean(0)) ** 2).sum()) == pytest.approx(
        np.sqrt(((nominal - nominal.mean(0)) ** 2).sum()), rel=3e-5
    )
    assert fit.sigma_px == pytest.approx(0.1, rel=0.06)
    theta = np.radians(60)
    truth, covariance = known.state.camera.entrance_pupil(theta), uncertainty(known).covariance
    gap = abs(fit.state.camera.entrance_pupil(theta) - truth)
    assert gap < pupil_sigma(known.state.camera, covariance, theta)


def test_a_flat_board_stays_flat() -> None:
    observations, _ = seen_bent("bow", 0.0)
    flat = refine(first_fit(prepare(observations)), Structure("ep_even"))
    assert with_estimated_shape(refine(flat, RICH), RICH).problem.shape.size == 0
