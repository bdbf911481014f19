"""The normal equations of a rig, kept by camera.

As in normal_equations.py, with moments in the place of views. A moment's B_m has entries for the cameras alone that see
it, B_m = Σ_c B_mc, so that

    Σ_m B_mᵀ A_m⁻¹ B_m = Σ_cd Σ_m B_mcᵀ A_m⁻¹ B_md,     m over the moments that both c and d see

and memory goes with the views, not with moments × (shared parameters)².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations, Step, checked_step
from fisheye_ep_calib.calibration.estimating.shape_equations import solve_scaled

_POSE = 6


@dataclass(frozen=True)
class CameraColumns:
    """What one camera adds to B. moments (V,), columns (k,): of the shared parameters. mixed (V, 6, k): B_mc.

    row (M,): where a moment stands in ``moments``, −1 where this camera does not see it.
    """

    moments: np.ndarray
    columns: np.ndarray
    mixed: np.ndarray
    row: np.ndarray


@dataclass(frozen=True, kw_only=True)
class RigEquations(NormalEquations):
    """by_view (M, 7, 7): of the pose and the residual alone. information (S, S), gradient (S,): C and g_s."""

    information: np.ndarray
    gradient: np.ndarray
    cameras: tuple[CameraColumns, ...]


class RigProducts:
    """Sums the products of each camera's views as they come.

    moments: of each camera (V_c,), of ``count`` in all. columns: of each camera (k_c,), among the shared parameters, of
    which there are ``shared``.
    """

    def __init__(self, moments: Sequence[np.ndarray], columns: Sequence[np.ndarray], count: int, shared: int) -> None:
        self._by_moment = np.zeros((count, _POSE + 1, _POSE + 1))
        self._information, self._gradient = np.zeros((shared, shared)), np.zeros(shared)
        self._cameras = []
        for seen, of_camera in zip(moments, columns, strict=True):
            row = np.full(count, -1)
            row[seen] = np.arange(len(seen))
            mixed = np.zeros((len(seen), _POSE, len(of_camera)))
            self._cameras.append(CameraColumns(seen, of_camera, mixed, row))

    def add(self, camera: int, moments: np.ndarray, products: np.ndarray) -> None:
        """products (B, 7 + k_c, 7 + k_c): JᵀJ of pose, the camera's columns and the residual, of the moments (B,).

        A camera sees a moment once.
        """
        ends = np.append(np.arange(_POSE), products.shape[1] - 1)
        self._by_moment[moments] += products[:, ends[:, None], ends]
        of_camera = self._cameras[camera]
        of_camera.mixed[of_camera.row[moments]] = products[:, :_POSE, _POSE:-1]
        own = of_camera.columns
        self._information[own[:, None], own] += products[:, _POSE:-1, _POSE:-1].sum(axis=0)
        self._gradient[own] += products[:, _POSE:-1, -1].sum(axis=0)

    def equations(self, cost: float, valid: bool) -> RigEquations:
        return RigEquations(
            self._by_moment,
            cost,
            valid,
            information=self._information,
            gradient=self._gradient,
            cameras=tuple(self._cameras),
        )


def solve_rig(equations: RigEquations, damping: float) -> Step:
    """The step of ``solve_damped``. Raises numpy.linalg.LinAlgError where that does."""
    pose, shared = equations.pose.copy(), equations.information.copy()
    diagonal = np.diag(shared).copy()
    pose[:, np.arange(_POSE), np.arange(_POSE)] *= 1 + damping
    shared[np.arange(len(shared)), np.arange(len(shared))] *= 1 + damping
    lost, lost_gradient = _eliminated(equations, pose)
    shared_step = -solve_scaled(shared - lost, equations.gradient - lost_gradient)
    right = equations.pose_gradient.copy()
    for camera in equations.cameras:
        right[camera.moments] += camera.mixed @ shared_step[camera.columns]
    pose_step = -np.linalg.solve(pose, right[..., None])[..., 0]
    return checked_step(equations, pose_step, shared_step, equations.gradient, diagonal, damping)


def rig_information(equations: RigEquations) -> np.ndarray:
    """(S, S): ``reduced_information``."""
    reduced = equations.information - _eliminated(equations, equations.pose)[0]
    symmetric: FloatArray = 0.5 * (reduced + reduced.T)
    return symmetric


def _eliminated(equations: RigEquations, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ_m B_mᵀ A_m⁻¹ B_m (S, S) and Σ_m B_mᵀ A_m⁻¹ g_m (S,); pose (M, 6, 6): A_m."""
    lost = np.zeros_like(equations.information)
    lost_gradient = np.zeros_like(equations.gradient)
    for number, first in enumerate(equations.cameras):
        solved = np.linalg.solve(pose[first.moments], first.mixed)
        lost_gradient[first.columns] += np.einsum("vqk,vq->k", solved, equations.pose_gradient[first.moments])
        for other in equations.cameras[number:]:
            rows = other.row[first.moments]
            both = np.flatnonzero(rows >= 0)
            left = solved[both].reshape(_POSE * len(both), len(first.columns))
            right = other.mixed[rows[both]].reshape(_POSE * len(both), len(other.columns))
            product = left.T @ right
            lost[first.columns[:, None], other.columns] += product
            if other is not first:
                lost[other.columns[:, None], first.columns] += product.T
    return lost, lost_gradient
