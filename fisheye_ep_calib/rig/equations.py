"""The normal equations of a rig: as one array a moment where that is small, by camera where it is not.

As in normal_equations.py, with moments in the place of views. A moment's B_m has entries for the cameras alone that see
it, B_m = Σ_c B_mc, so that

    Σ_m B_mᵀ A_m⁻¹ B_m = Σ_cd Σ_m B_mcᵀ A_m⁻¹ B_md,     m over the moments that both c and d see.

Kept by camera, memory goes with the views; as one array it goes with moments × (shared parameters)².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.normal_equations import (
    NormalEquations,
    Step,
    checked_step,
    reduced_information,
    solve_damped,
)
from fisheye_ep_calib.calibration.estimating.shape_equations import solve_scaled

MOST_DENSE = 20_000_000  # numbers in one array
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


@dataclass(frozen=True)
class EquationsByCamera(NormalEquations):
    """by_view (M, 7, 7): of the pose and the residual alone. information (S, S), gradient (S,): C and g_s."""

    information: np.ndarray | float = 0.0
    gradient: np.ndarray | float = 0.0
    cameras: tuple[CameraColumns, ...] = ()


class RigProducts:
    """Sums the products of each camera's views as they come.

    moments: of each camera (V_c,). columns: of each camera those of a moment's array, as ``add`` is given them: the
    moment's pose, what of the shared ones the camera's views depend on, the residual. size: of a moment's whole array.
    """

    def __init__(self, moments: Sequence[np.ndarray], columns: Sequence[np.ndarray], count: int, size: int) -> None:
        self._columns = columns
        self._dense = np.zeros((count, size, size)) if count * size**2 <= MOST_DENSE else None
        if self._dense is not None:
            return
        self._by_moment = np.zeros((count, _POSE + 1, _POSE + 1))
        shared = size - _POSE - 1
        self._information, self._gradient = np.zeros((shared, shared)), np.zeros(shared)
        self._cameras = []
        for seen, of_camera in zip(moments, columns, strict=True):
            row = np.full(count, -1)
            row[seen] = np.arange(len(seen))
            own = of_camera[_POSE:-1] - _POSE
            self._cameras.append(CameraColumns(seen, own, np.zeros((len(seen), _POSE, len(own))), row))

    def add(self, camera: int, moments: np.ndarray, products: np.ndarray) -> None:
        """products (B, q, q) of the camera's columns; moments (B,). A camera sees a moment once."""
        columns = self._columns[camera]
        if self._dense is not None:
            self._dense[moments[:, None, None], columns[:, None], columns] += products
            return
        ends = np.append(np.arange(_POSE), products.shape[1] - 1)
        self._by_moment[moments] += products[:, ends[:, None], ends]
        of_camera = self._cameras[camera]
        of_camera.mixed[of_camera.row[moments]] = products[:, :_POSE, _POSE:-1]
        own = of_camera.columns
        self._information[own[:, None], own] += products[:, _POSE:-1, _POSE:-1].sum(axis=0)
        self._gradient[own] += products[:, _POSE:-1, -1].sum(axis=0)

    def equations(self, cost: float, valid: bool) -> NormalEquations:
        if self._dense is not None:
            return NormalEquations(self._dense, cost, valid)
        return EquationsByCamera(
            self._by_moment,
            cost,
            valid,
            information=self._information,
            gradient=self._gradient,
            cameras=tuple(self._cameras),
        )


def solve_rig(equations: NormalEquations, damping: float) -> Step:
    """The step of ``solve_damped``. Raises numpy.linalg.LinAlgError where that does."""
    if not isinstance(equations, EquationsByCamera):
        return solve_damped(equations, damping)
    pose, shared = equations.pose.copy(), np.array(equations.information)
    diagonal, gradient = np.diag(shared).copy(), np.asarray(equations.gradient)
    pose[:, np.arange(_POSE), np.arange(_POSE)] *= 1 + damping
    shared[np.arange(len(shared)), np.arange(len(shared))] *= 1 + damping
    inverse = np.linalg.inv(pose)
    lost, lost_gradient = _eliminated(equations, inverse)
    shared_step = -solve_scaled(shared - lost, gradient - lost_gradient)
    right = equations.pose_gradient.copy()
    for camera in equations.cameras:
        right[camera.moments] += camera.mixed @ shared_step[camera.columns]
    pose_step = -(inverse @ right[..., None])[..., 0]
    return checked_step(equations, pose_step, shared_step, gradient, diagonal, damping)


def rig_information(equations: NormalEquations) -> np.ndarray:
    """(S, S): ``reduced_information``."""
    if not isinstance(equations, EquationsByCamera):
        return reduced_information(equations)
    reduced = equations.information - _eliminated(equations, np.linalg.inv(equations.pose))[0]
    symmetric: FloatArray = 0.5 * (reduced + reduced.T)
    return symmetric


def _eliminated(equations: EquationsByCamera, inverse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ_m B_mᵀ A_m⁻¹ B_m (S, S) and Σ_m B_mᵀ A_m⁻¹ g_m (S,); inverse (M, 6, 6): A_m⁻¹."""
    lost = np.zeros_like(equations.information)
    lost_gradient = np.zeros_like(equations.gradient)
    for number, first in enumerate(equations.cameras):
        solved = inverse[first.moments] @ first.mixed
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
