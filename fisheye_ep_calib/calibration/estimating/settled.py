"""The normal equations of poses and camera alone once the target's shape has settled.

With c the camera's columns, s those of the shape, H their information once the poses are eliminated and P the shape's
penalty, a change of the camera by δ lets the shape settle by X δ, X = −(H_ss + P)⁻¹ H_sc. Columns c + s X in place of c
then hold what every view tells of the camera beside an unknown shape, and Xᵀ P X what the penalty adds:

    H_cc − H_cs (H_ss + P)⁻¹ H_sc = (c + s X)ᵀ (c + s X) + Xᵀ P X      (poses eliminated on both sides)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, evaluate
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations
from fisheye_ep_calib.calibration.estimating.shape_equations import block_system


def settled_equations(
    problem: AdjustmentProblem, state: AdjustmentState, equations: NormalEquations
) -> NormalEquations:
    """equations: at the state, the shape with them. Those without a free shape are returned as they are."""
    if equations.shape is None:
        return equations
    response = shape_response(equations)
    penalty = problem.shape.all_penalties
    held = replace(problem, shape_free=False)
    adjustment = evaluate(held, state, follow=response)
    prior = adjustment.prior + response.T @ (penalty[:, None] * response)
    return replace(adjustment, cost=equations.cost, prior=prior)


def shape_response(equations: NormalEquations) -> np.ndarray:
    """X (K, S): how the shape settles as the shared parameters change."""
    shape, size = equations.shape, len(equations.shared)
    assert shape is not None
    nothing = replace(shape, camera=shape.camera[:0])
    system = block_system(equations.pose, equations.mixed[..., :0], np.zeros((0, 0)), nothing)
    smooth = shape.smooth_size
    solution = system.solve(
        {
            "pose": equations.mixed.reshape(-1, size),
            "camera": np.zeros((0, size)),
            "smooth": shape.camera[:, :smooth].T,
            "rough": shape.camera[:, smooth:].T,
        }
    )
    return -np.concatenate([solution["smooth"], solution["rough"]])
