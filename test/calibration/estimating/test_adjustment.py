"""The normal equations, their solution by Schur complement and their statistics, against dense linear algebra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA, poses_of, seen, seen_board, with_gross_errors
from scipy.optimize import least_squares

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.calibration.estimating.adjustment import evaluate, residuals, stepped
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.normal_equations import (
    Step,
    reduced_information,
    solve_damped,
    view_robust_covariance,
)
from fisheye_ep_calib.calibration.estimating.robust import LINEAR, Loss
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.selecting.cross_validation import cross_validate, fold_of_view
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.rotation import motion_jacobian, moved_poses, rotation_from_vector, vector_from_rotation
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target

pytestmark = pytest.mark.filterwarnings("error")


def discs() -> Observations:
    return observe(paper_camera(), paper_target(), paper_poses(paper_target())[::5], noise=0.5)


def solid() -> Observations:
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (30, 3))
    return seen(CAMERA, points, poses_of(6), noise=0.5)


PROBLEMS = {
    "central": (lambda: seen_board(views=6, noise=0.5), Structure("kannala"), LINEAR),
    "everything": (
        lambda: seen_board(views=8, noise=0.5),
        Structure("ep_even", extras=("tangential", "tilt"), board_shape="bow"),
        LINEAR,
    ),
    "double sphere, huber": (
        lambda: seen_board(views=6, noise=0.5),
        Structure("gennery", lens="double_sphere", skew=False),
        Loss("huber", 0.6),
    ),
    "cauchy": (lambda: seen_board(views=6, noise=0.5), Structure("ep_odd", terms=2), Loss("cauchy", 0.6)),
    "solid": (solid, Structure("ep_odd", terms=1), LINEAR),
    "discs": (discs, Structure("ep_odd", board_shape="bow"), LINEAR),
    "the paper's printed equation": (discs, Structure("ep_odd", target_axis=True), LINEAR),
}


def somewhere(name: str) -> Fit:
    """A problem at a state that is not its minimum, with parameters that are not zero, and uneven weights."""
    observations, structure, loss = PROBLEMS[name]
    observations = observations()
    rng = np.random.default_rng(2)
    observations = replace(observations, weights=rng.choice([0.0, 0.5, 1.0, 2.0], len(observations.pixels)))
    sightings = prepare(observations)
    fit = refine(first_fit(sightings), structure, replace(sightings, loss=loss))
    problem = replace(fit.problem, loss=loss)
    step = Step(rng.normal(0, 1e-4, (len(sightings.images), 6)), np.zeros(problem.shared_size), 0.0)
    state = stepped(problem, fit.state, step)
    assert state is not None
    return replace(fit, problem=problem, adjustment=replace(fit.adjustment, state=state))


def dense_system(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (2M,) and their Jacobian (2M, 6V + S) by central differences, robust weights applied."""
    views, size = len(fit.sightings.images), fit.problem.shared_size
    observations = fit.sightings.observations
    weights = np.where(np.isin(observations.image_index, fit.sightings.images), observations.weights, 0.0)

    def residual(step: np.ndarray) -> np.ndarray:
        moved = stepped(fit.problem, fit.state, Step(step[: 6 * views].reshape(views, 6), step[6 * views :], 0.0))
        error, _, _ = residuals(fit.problem, moved, len(observations.pixels))
        return np.where(weights[:, None] > 0, error * weights[:, None], 0.0)

    names, _ = fit.shared_parameters
    scale = [1e-2 if name in ("fx", "fy", "cx", "cy") else 1e-7 if name[0] in "ew" else 1e-5 for name in names]
    steps = np.concatenate([np.full(6 * views, 1e-6), scale])
    columns = []
    for unit, step in zip(np.eye(6 * views + size), steps, strict=True):
        columns.append(((residual(step * unit) - residual(-step * unit)) / (2 * step)).ravel())
    value = residual(np.zeros(6 * views + size))
    square = (value**2).sum(axis=1)
    _, factor = fit.problem.loss.evaluate(square)
    factor = np.repeat(factor, 2)
    return value.ravel() * factor, np.stack(columns, axis=-1) * factor[:, None]


@pytest.mark.parametrize("name", PROBLEMS)
def test_normal_equations_step_and_information_are_those_of_the_dense_problem(name) -> None:
    fit = somewhere(name)
    equations = evaluate(fit.problem, fit.state)
    value, jacobian = dense_system(fit)
    views, size = len(fit.sightings.images), fit.problem.shared_size
    poses = slice(0, 6 * views)
    shared = slice(6 * views, None)

    hessian, gradient = jacobian.T @ jacobian, jacobian.T @ value
    scale = np.sqrt(np.diag(hessian))
    tolerance = 1e-6 * np.linalg.norm(value) * scale
    assert (np.abs(equations.pose_gradient.ravel() - gradient[poses]) < tolerance[poses]).all()
    assert (np.abs(equations.shared_gradient - gradient[shared]) < tolerance[shared]).all()
    found = np.zeros_like(hessian)
    for view in range(views):
        own = slice(6 * view, 6 * view + 6)
        found[own, own] = equations.pose[view]
        found[own, shared], found[shared, own] = equations.mixed[view], equations.mixed[view].T
    found[shared, shared] = equations.shared
    own_gradient = np.concatenate([equations.pose_gradient.ravel(), equations.shared_gradient])
    assert np.abs((found - hessian) / scale / scale[:, None]).max() < 1e-6

    for damping in (1e-6, 1e-2, 10.0):
        expected = -np.linalg.solve(found + damping * np.diag(np.diag(found)), own_gradient)
        step = solve_damped(equations, damping)
        both = np.concatenate([step.pose.ravel(), step.shared])
        assert np.abs((both - expected) * scale).max() < 1e-4 * np.abs(expected * scale).max()
        predicted = -(own_gradient @ both + 0.5 * both @ found @ both)
        assert step.predicted_decrease == pytest.approx(predicted, rel=1e-4)

    inverse = np.linalg.inv(found / scale / scale[:, None])[shared, shared] / scale[shared] / scale[shared, None]
    information = reduced_information(equations)
    unit = np.sqrt(np.diag(information))
    assert np.abs(information @ inverse * unit[:, None] ** -1 * unit - np.eye(size)).max() < 1e-4


@pytest.mark.parametrize("name", ["everything", "discs", "cauchy"])
def test_view_robust_covariance_is_the_dense_sandwich(name) -> None:
    fit = somewhere(name)
    fit = refine(fit, fit.structure, replace(fit.sightings, loss=fit.problem.loss))
    value, jacobian = dense_system(fit)
    views = len(fit.sightings.images)
    row_view = np.repeat(np.searchsorted(fit.sightings.images, fit.sightings.observations.image_index), 2)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / scale
    bread = np.linalg.inv(jacobian.T @ jacobian)
    scores = np.stack([jacobian[row_view == view].T @ value[row_view == view] for view in range(views)])
    expected = (bread @ scores.T @ scores @ bread)[6 * views :, 6 * views :] * views / (views - 1)
    unit = scale[6 * views :]
    expected = expected / unit / unit[:, None]
    found = view_robust_covariance(evaluate(fit.problem, fit.state))
    sigma = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / sigma / sigma[:, None]).max() < 1e-2


def test_the_minimum_is_scipys() -> None:
    """Camera and poses by a dense solver that shares only ``project`` with the adjustment."""
    observations = seen_board(views=6, noise=0.3)
    result = calibrate(observations, "ep_even")
    count = len(result.camera.parameters)
    points = observations.object_points[observations.point_index]
    view = observations.image_index
    scale = np.concatenate([np.full(5, 1.0), np.full(4, 1e-3), np.full(2, 1e-5), np.full(36, 1e-3)])

    def error(values):
        values = values * scale
        camera = replace(result.camera.with_parameters(result.camera.parameters + values[:count]), theta_max=np.pi)
        poses = moved_poses(result.camera_from_target, values[count:].reshape(6, 6))
        in_camera = np.einsum("nij,nj->ni", poses[view, :3, :3], points) + poses[view, :3, 3]
        return (camera.project(in_camera)[0] - observations.pixels).ravel()

    start = np.random.default_rng(3).normal(0, 1, count + 36) * 0.3
    best = least_squares(error, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    assert best.cost < 0.5 * (error(start) ** 2).sum()
    assert 2 * best.cost == pytest.approx((error(np.zeros(count + 36)) ** 2).sum(), rel=1e-7)
    assert np.sqrt(2 * best.cost / len(points)) == pytest.approx(result.rms_px, rel=1e-7)


@pytest.mark.parametrize("shift", [(10.0, -10.0, 0.0), (0.0, 0.0, 100.0)])
def test_where_a_targets_origin_lies_does_not_matter(shift) -> None:
    """Points surveyed in a hall's coordinates give the same camera, in as many steps."""
    observations = seen_board(views=12, noise=0.05)
    near = calibrate(observations, "ep_even")
    far = calibrate(replace(observations, object_points=observations.object_points + np.array(shift)), "ep_even")
    assert far.iterations == near.iterations
    sigma = np.sqrt(np.diag(near.uncertainty.covariance))
    assert (np.abs(far.camera.parameters - near.camera.parameters) <= 1e-3 * sigma).all()


def test_cross_validation_is_refitting_without_the_fold() -> None:
    observations = seen_board(views=15, noise=0.3)
    fit = refine(first_fit(prepare(observations)), Structure("ep_even"))
    found = cross_validate(fit)
    number = fold_of_view(np.arange(15))
    assert sorted(np.bincount(number)) == [3, 3, 3, 3, 3]
    for fold in range(5):
        trained = calibrate(observations.select_images(np.flatnonzero(number != fold)), "ep_even")
        held_out = evaluate_camera(trained.camera, observations.select_images(np.flatnonzero(number == fold)))
        assert found.count[fold] == held_out.points
        assert found.square[fold] == pytest.approx(held_out.rms_px**2 * held_out.points, rel=2e-3)


def test_robust_losses_are_their_formulas() -> None:
    """√ρ′ by differences of ρ."""
    square = np.geomspace(1e-6, 1e4, 200)
    for loss in (LINEAR, Loss("huber", 0.7), Loss("cauchy", 0.7)):
        value, factor = loss.evaluate(square)
        slope = (loss.evaluate(square * (1 + 1e-6))[0] - loss.evaluate(square * (1 - 1e-6))[0]) / (2e-6 * square)
        assert np.allclose(factor**2, slope, rtol=1e-4)
        assert np.all(np.diff(value) > 0) and value[0] == pytest.approx(square[0], rel=1e-5)
    assert Loss("huber", 0.5).evaluate(np.array([4.0]))[0] == pytest.approx(2 * 0.5 * 2 - 0.25)


def test_huber_keeps_every_sighting_and_is_not_dragged_off() -> None:
    observations, wrong = with_gross_errors(seen_board(), 0.05)
    result = calibrate(observations, "ep_even", loss="huber")
    assert not result.rejected and result.points == len(observations.pixels) and wrong.any()
    assert abs(result.camera.fx / CAMERA.fx - 1) < 5e-3
    theta = np.radians([30, 60, 85])
    assert np.abs(result.camera.entrance_pupil(theta) - CAMERA.entrance_pupil(theta)).max() < 1e-3


def test_noise_and_held_out_error_mean_the_same_under_either_loss() -> None:
    ratios = []
    for seed in range(6):
        observations = seen_board(noise=0.2, seed=seed)
        cut, huber = (calibrate(observations, "ep_even", loss=loss) for loss in ("cut", "huber"))
        assert huber.uncertainty.sigma_px == pytest.approx(0.2, rel=0.05)
        sigma, sigma_huber = (np.sqrt(np.diag(one.uncertainty.shared)) for one in (cut, huber))
        ratios.append(sigma_huber / sigma)
        for one in (cut, huber):
            chosen = one.comparison["ep_even"]
            assert chosen.cross_validated_rms_px > chosen.rms_px == pytest.approx(one.rms_px, rel=1e-6)
    # Huber's estimate at 1.345 σ of what is Gaussian in the plane: 1 − e^−k²/2 over its square-rooted slope.
    assert np.abs(np.mean(ratios, axis=0) / 1.034 - 1).max() < 0.02


def test_rotations() -> None:
    """Rodrigues against the matrix exponential's own series, near zero too; and back again."""
    rng = np.random.default_rng(4)
    for angle in (0.0, 1e-9, 1e-5, 0.99e-4, 1.01e-4, 0.5, 3.1, 6.0):
        axis = rng.normal(size=3)
        vector = angle * axis / np.linalg.norm(axis)
        cross = np.array([[0, -vector[2], vector[1]], [vector[2], 0, -vector[0]], [-vector[1], vector[0], 0]])
        series, term = np.eye(3), np.eye(3)
        for power in range(1, 40):
            term = term @ cross / power
            series = series + term
        found = rotation_from_vector(np.tile(vector, (2, 4, 1)))
        assert np.abs(found - series).max() < 1e-13
        if angle < np.pi:
            assert np.abs(vector_from_rotation(found) - vector).max() < 1e-12
    poses = poses_of(3)
    moved = moved_poses(poses, np.full((3, 6), 0.1))
    assert np.allclose(moved[:, :3, 3], poses[:, :3, 3] + 0.1)
    assert np.allclose(moved[:, :3, :3], rotation_from_vector(np.full(3, 0.1)) @ poses[:, :3, :3])
    arms = rng.normal(size=(4, 3, 3))
    step = 1e-6 * rng.normal(size=6)
    turned = arms @ rotation_from_vector(step[:3]).T + step[3:]
    assert np.allclose(turned - arms, motion_jacobian(arms) @ step, atol=1e-11)
