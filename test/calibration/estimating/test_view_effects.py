"""What differs from view to view in the adjustment: derivatives, and what is eliminated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import seen_bent

from fisheye_ep_calib.calibration.estimating.adjustment import evaluate, residuals, stepped
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.joint_posterior import JOINT_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.normal_equations import Step
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.estimating.view_effects import VIEW_GROUPS, view_effects
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.target.shape.variances import Variances

SCENES = {
    "points": lambda: seen_bent("wave", 2e-4, views=6, noise=0.3)[0],
    "discs": lambda: observe(paper_camera(), paper_target(), paper_poses(paper_target())[::5], noise=0.3),
}


def somewhere(name: str) -> Fit:
    """A fit with all effects under a penalty, at a state where every view has some of each."""
    sightings = prepare(SCENES[name]())
    seen = np.ones(len(sightings.target.nominal), bool)
    effects = view_effects(sightings.target, seen, sightings.observations.image_size[1])
    sightings = replace(sightings, effects=effects.with_penalty(np.full(effects.size, 1e4), 0.0))
    fit = refine(first_fit(sightings), Structure("ep_even"), sightings, tolerance=1e-2)
    step = np.random.default_rng(0).normal(0, 1e-3, (len(sightings.images), fit.problem.view_size))
    state = stepped(fit.problem, fit.state, Step(step, np.zeros(fit.problem.shared_size), 0.0))
    equations = evaluate(fit.problem, state)
    return replace(fit, adjustment=replace(fit.adjustment, state=state, equations=equations))


@pytest.mark.parametrize("name", SCENES)
def test_the_gradient_is_that_of_the_cost_by_every_coefficient(name) -> None:
    fit = somewhere(name)
    equations, problem = fit.adjustment.equations, fit.problem
    scale = 1 / np.sqrt(np.einsum("vii->vi", equations.pose))
    rng = np.random.default_rng(2)
    for column in range(problem.view_size):
        direction = np.zeros(scale.shape)
        direction[:, column] = scale[:, column] * rng.normal(size=len(scale))

        def cost(length: float, direction=direction) -> float:
            step = Step(length * direction, np.zeros(problem.shared_size), 0.0)
            return evaluate(problem, stepped(problem, fit.state, step)).cost

        slope = (cost(1e-3) - cost(-1e-3)) / 2e-3
        expected = (direction * equations.pose_gradient).sum()
        assert slope == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_the_matrix_is_that_of_the_residuals() -> None:
    fit = somewhere("points")
    equations, problem = fit.adjustment.equations, fit.problem
    count, rng = len(fit.sightings.observations.pixels), np.random.default_rng(3)
    scale = 1 / np.sqrt(np.einsum("vii->vi", equations.pose))
    penalty = np.concatenate([np.zeros(6), problem.effects.penalty])
    for _ in range(3):
        direction = scale * rng.normal(size=scale.shape)

        def error(length: float, direction=direction) -> np.ndarray:
            step = Step(length * direction, np.zeros(problem.shared_size), 0.0)
            return residuals(problem, stepped(problem, fit.state, step), count)[0]

        change = (error(1e-3) - error(-1e-3)) / 2e-3
        expected = (change**2).sum() + (penalty * direction**2).sum()
        found = np.einsum("vk,vkl,vl->", direction, equations.pose, direction)
        assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("views", [6, 30])  # few: points are eliminated first
def test_the_joint_posterior_is_that_of_all_residuals_at_once(views) -> None:
    """Against ordinary least squares with the columns of every unknown found by differences."""
    sightings = prepare(seen_bent("wave", 2e-4, views=views, noise=0.3)[0])
    fit = refine(first_fit(sightings), Structure("ep_even"))
    linearisation = joint_variances(fit).linearisation
    unit = {name: 1.0 if name.startswith("lens") else 1e-4 for name in JOINT_GROUPS}
    kept = ("z2", "xy1", "rough z", *VIEW_GROUPS, "lens order 1")
    variances = Variances(np.array([unit[name] * (name in kept) for name in JOINT_GROUPS]), 0.3)
    posterior = linearisation(variances)
    # The same from one dense matrix: poses, effects, camera, field and shape.
    equations, shape = linearisation._equations, linearisation._equations.shape
    rows = views * equations.view_size
    whole = np.zeros((rows + len(equations.shared) + len(shape.gradient),) * 2)
    camera = slice(rows, rows + len(equations.shared))
    for view in range(views):
        own = slice(view * equations.view_size, (view + 1) * equations.view_size)
        whole[own, own], whole[own, camera] = equations.pose[view], equations.mixed[view]
        whole[own, camera.stop :] = shape.pose[view]
    whole[camera, camera], whole[camera, camera.stop :] = equations.shared, shape.camera
    smooth = camera.stop + shape.smooth_size
    whole[camera.stop : smooth, camera.stop :] = shape.smooth
    for point, block in enumerate(shape.rough):
        own = slice(smooth + 3 * point, smooth + 3 * point + 3)
        whole[own, own] = block
    whole = np.triu(whole) + np.triu(whole, 1).T
    gradient = np.concatenate([equations.pose_gradient.ravel(), equations.shared_gradient, shape.gradient])
    view_group = np.concatenate([np.full(6, -1), linearisation._view_group])
    rough = JOINT_GROUPS.index("rough xy"), JOINT_GROUPS.index("rough xy"), JOINT_GROUPS.index("rough z")
    group = np.concatenate(
        [
            np.tile(view_group, views),
            np.full(len(equations.shared) - len(linearisation._lens_group), -1),
            linearisation._lens_group,
            linearisation._smooth_group,
            np.tile(rough, len(shape.rough)),
        ]
    )
    there = (group < 0) | (variances.deviation[group] > 0)
    penalty = np.where(group < 0, 0.0, variances.penalties[group])[there]
    matrix = whole[np.ix_(there, there)] + np.diag(penalty)
    scale = 1 / np.sqrt(np.diag(matrix))
    inverse = np.linalg.inv(matrix * scale[:, None] * scale) * scale[:, None] * scale
    step = -inverse @ gradient[there]
    free = np.flatnonzero(group[there] < 0)[6 * views :]
    assert posterior.change == pytest.approx(step[free], rel=1e-4, abs=1e-4 * np.abs(step[free]).min())
    assert posterior.camera == pytest.approx(inverse[np.ix_(free, free)], rel=1e-3, abs=1e-12)
    assert posterior.log_determinant == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-8)
    assert posterior.objective == pytest.approx(2 * equations.cost + gradient[there] @ step, rel=1e-7)
    for name in kept:
        index = JOINT_GROUPS.index(name)
        mine, theirs = posterior.value[posterior.group == index], step[group[there] == index]
        assert mine == pytest.approx(theirs, rel=1e-4, abs=1e-6 * np.abs(theirs).max()), name
        variance = np.diag(inverse)[group[there] == index]
        assert posterior.variance[posterior.group == index] == pytest.approx(variance, rel=1e-4), name
