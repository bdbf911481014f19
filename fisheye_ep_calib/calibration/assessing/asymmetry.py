"""Whether residuals turn with the azimuth: what a camera that is symmetric about its axis cannot hold.

Three ways of not being so, each a few further columns beside those of the fit, s = θ/θ_max, (e_θ, e_φ) the directions
across the ray, d the distance:

    decentred element      δp = d s² (e_θ, e_φ) × (cos φ, sin φ)          a tilted window or lens group
    astigmatic field       δp = d s² (e_θ, e_φ) × (cos 2φ, sin 2φ)
    pupil off the axis     δp = s² (e_x, e_y)                             it does not grow with the distance

Rao's score test from one step (Math. Proc. Cambridge Phil. Soc. 44, 1948): two must agree, F on the cost, which takes
residuals to be independent, and Wald's on what scatters from view to view (nested_tests.py). What the board's shape
takes up stays where the fit has it: the test then finds a little less, never more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.adjustment import shared_jacobian
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.normal_equations import (
    ALMOST_UNDAMPED,
    NormalEquations,
    solve_damped,
    unbiased_view_robust_covariance,
)
from fisheye_ep_calib.calibration.estimating.prediction import predict
from fisheye_ep_calib.calibration.selecting.nested_tests import CLUSTERS_BEYOND_TERMS, f_tail, f_test
from fisheye_ep_calib.calibration.selecting.pupil_verdict import FEWEST_FOR_MODELS
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD

_SIGNIFICANCE = 0.001  # of each of the three
_SHARE = 0.2  # of the RMS, below which it is not worth a word

Columns = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def not_symmetric(fit: Fit) -> list[Finding]:
    """A finding where what a view leaves over turns with the azimuth; none where the fit cannot be asked."""
    if fit.structure.target_axis or fit.problem.loss.kind != "linear":
        return []
    told = []
    for name, columns in _WAYS.items():
        try:
            chance, gain = score_test(fit, columns)
        except np.linalg.LinAlgError:  # the fit holds it already, or the views say nothing of it
            continue
        told.append((chance, np.sqrt(2 * gain / fit.sightings.point_count), name))
    if not told:
        return []
    chance, effect, name = min(told, key=lambda each: (each[0], -each[1]))
    values = {"p_value": chance, "effect_px": effect}
    if len(fit.sightings.images) < FEWEST_FOR_MODELS:
        sentence = f"fewer than {FEWEST_FOR_MODELS} views do not tell whether the residuals turn with the azimuth"
        return [Finding("not_symmetric", values, False, sentence)]
    if chance >= _SIGNIFICANCE or effect < _SHARE * fit.rms_px:
        return [Finding("not_symmetric", values, False, "the residuals do not turn with the azimuth")]
    sentence = (
        f"the camera is not symmetric about its axis, by {effect:.2f} px RMS of the residuals (p = {chance:.1g}, best "
        f"told by {name}): a decentred element, a window in front of the lens, or a pupil off the axis; {_option(fit)}"
        "take a window away, or expect as much at other distances too"
    )
    return [Finding("not_symmetric", values, True, sentence)]


def _option(fit: Fit) -> str:
    tried = LENS_FIELD.name in fit.structure.extras
    return "no model here holds that: " if tried else "--lens-field holds part of it; "


def score_test(fit: Fit, columns: Columns) -> tuple[float, float]:
    """p-value of further columns, the larger of two tests, and what they would lower the cost by, px².

    columns: of points (3, B, N), camera frame, their angles and azimuths (B, N); δp (3, K, B, N). Raises
    numpy.linalg.LinAlgError where nothing is known about them.
    """
    equations = _with_columns(fit, columns)
    step = solve_damped(equations, ALMOST_UNDAMPED)
    extra = len(step.shared) - fit.problem.shared_size
    views = len(fit.sightings.images)
    gain = max(step.predicted_decrease, 0.0)
    if views < extra + CLUSTERS_BEYOND_TERMS:
        return f_test(fit, gain, extra, fit.clustering), gain
    change = np.concatenate([step.pose, np.broadcast_to(step.shared, (views, len(step.shared)))], axis=1)
    by_view = equations.by_view.copy()
    by_view[:, :-1, -1] += np.einsum("vij,vj->vi", by_view[:, :-1, :-1], change)
    by_view[:, -1, :-1] = by_view[:, :-1, -1]
    covariance = unbiased_view_robust_covariance(NormalEquations(by_view, 0.0, True))[-extra:, -extra:]
    value = step.shared[-extra:]
    statistic = float(value @ np.linalg.solve(covariance, value)) / extra
    chance = f_tail(extra, views - extra, statistic) if np.isfinite(statistic) else 1.0
    return max(f_test(fit, gain, extra), chance), gain


def _with_columns(fit: Fit, columns: Columns) -> NormalEquations:
    """The fit's normal equations with further shared columns; a free shape of the target is held."""
    problem, state = fit.problem, fit.state
    surface = problem.shape.surface(state.shape)
    by_view = None
    for block in problem.blocks:
        poses = state.camera_from_target[block.views]
        bow = problem.bow_size > 0
        prediction = predict(state.camera, problem.features, surface, poses, block, problem.theta_limit, True, bow)
        points = _in_camera(poses, surface.points, block.points)
        theta = np.arctan2(np.hypot(points[0], points[1]), points[2])
        moved = columns(points, theta / fit.largest_angle, np.arctan2(points[1], points[0]))
        extra = np.einsum("rpbn,pkbn->rkbn", prediction.d_pose[:, 3:], moved, optimize=True)
        error = (prediction.pixels - block.pixels)[:, None]
        weighted = np.concatenate(
            [prediction.d_pose, shared_jacobian(problem, block, prediction), extra, error], axis=1
        )
        weighted = np.where(block.weights > 0, weighted * block.weights, 0.0)
        if by_view is None:
            by_view = np.zeros((problem.view_count, weighted.shape[1], weighted.shape[1]))
        by_view[block.views] = np.einsum("rabn,rcbn->bac", weighted, weighted, optimize=True)
    assert by_view is not None
    prior, gradient = fit.adjustment.equations.known_beforehand
    more = by_view.shape[1] - 7 - len(gradient)
    equations = NormalEquations(by_view, fit.adjustment.equations.cost, True)
    return replace(equations, prior=np.pad(prior, (0, more)), prior_gradient=np.pad(gradient, (0, more)))


def _in_camera(poses: np.ndarray, points: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Points (3, B, N), camera frame, of points (n, 3) of the target through poses (B, 4, 4); which (B, N)."""
    in_camera: FloatArray = np.einsum("bij,bnj->ibn", poses[:, :3, :3], points[which]) + poses[:, :3, 3].T[..., None]
    return in_camera


def _across(points: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """d e_θ and d e_φ (3, B, N) of points at the distance d."""
    distance = np.linalg.norm(points, axis=0)
    rho, z = np.hypot(points[0], points[1]), points[2]
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    return np.stack([z * cos, z * sin, -rho]), distance * np.stack([-sin, cos, np.zeros_like(cos)])


def _field(order: int) -> Columns:
    def columns(points: np.ndarray, share: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        out, around = (share**2 * each for each in _across(points, azimuth))
        cos, sin = np.cos(order * azimuth), np.sin(order * azimuth)
        return np.stack([out * cos, out * sin, around * cos, around * sin], axis=1)

    return columns


def _pupil_off_axis(points: np.ndarray, share: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    zero = np.zeros_like(share)
    return np.stack([np.stack([share**2, zero, zero]), np.stack([zero, share**2, zero])], axis=1)


_WAYS: dict[str, Columns] = {
    "a decentred element": _field(1),
    "an astigmatic field": _field(2),
    "a pupil off the axis": _pupil_off_axis,
}
