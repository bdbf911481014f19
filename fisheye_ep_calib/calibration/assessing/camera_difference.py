"""How two cameras differ in the image, once an orientation, which is no property of a camera, is taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rotation import motion_jacobian, rotation_from_vector, vector_from_rotation

ALIGNMENTS = ("rotation", "rigid", "none")
SAME_PIXEL = 1e-3  # px
_GRID = 25  # pixels a side at which the cameras are compared
_ITERATIONS = 20
_SETTLED = 1e-10  # rad and metres


@dataclass(frozen=True)
class CameraDifference:
    """What the second camera makes of the points that the first one sees in n of its pixels.

    pixels (n, 2), theta (n,): pixels of the first camera and their incidence angles there, rad.
    distance_m (d,): of the points from the first camera's origin. difference_px (d, n, 2): second minus first.
    sigma_px (d, n): what the length of the difference is expected to be from both cameras' uncertainties alone,
    √trace of its covariance. Both are NaN where a camera has no projection.
    covariances_given (2,): whether each camera brought its uncertainty; sigma_px holds that of those which did.
    rotation (3,): rotation vector, rad, that turns the first camera's frame into the second's; shift (3,): metres.
    """

    pixels: np.ndarray
    theta: np.ndarray
    distance_m: np.ndarray
    difference_px: np.ndarray
    sigma_px: np.ndarray
    covariances_given: tuple[bool, bool]
    rotation: np.ndarray
    shift: np.ndarray

    @property
    def length_px(self) -> np.ndarray:
        """(d, n): length of the difference."""
        length: FloatArray = np.linalg.norm(self.difference_px, axis=-1)
        return length


def camera_difference(
    first: FisheyeCamera,
    second: FisheyeCamera,
    distance_m: Sequence[float],
    covariances: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
    alignment: str = "rotation",
    grid: int = _GRID,
) -> CameraDifference:
    """Compare two cameras of the same image size over the field that both know.

    covariances: (P, P) of each camera's parameters, taken as independent of each other; None where unknown.
    alignment: "rotation" turns the first camera's points to agree best, "rigid" shifts them too; one motion for all
    distances. The expected difference has the same alignment taken out: with C = ∂pixels/∂motion stacked over all
    points and Q = I − C C⁺ it is that of Q (J₂ δ₂ − J₁ δ₁), J the cameras' derivatives by their parameters.
    """
    if first.image_size != second.image_size:
        raise InputError(
            f"the cameras have {first.image_size[0]}×{first.image_size[1]} and "
            f"{second.image_size[0]}×{second.image_size[1]} pixels and cannot be compared"
        )
    both = min(first.theta_max, second.theta_max)
    pixels, theta, points, visible = points_over_image(replace(first, theta_max=both), distance_m, grid)
    back, own, _, d_first = replace(first, theta_max=np.pi).project_with_jacobian(points)
    # Very near, a point may lie on the rays of several pixels.
    visible &= own & (np.abs(np.where(own[..., None], back, np.inf) - pixels).max(axis=-1) < SAME_PIXEL)
    # A point may lie at a slightly larger angle for the second camera: the field was limited above.
    second = replace(second, theta_max=min(np.pi, both + 0.05))
    columns = {"none": 0, "rotation": 3, "rigid": 6}[alignment]
    if alignment == "rigid" and np.isinf(np.asarray(distance_m)).all():
        columns = 3  # a shift has no effect on points at infinity
    turn, shift = _alignment(second, points, pixels, visible, columns)
    rotation = rotation_from_vector(turn)
    moved = points @ rotation.T + shift
    projected, reached, d_point, d_second = second.project_with_jacobian(moved)
    used = visible & reached
    difference = np.where(used[..., None], projected - pixels, np.nan)
    gauge = (d_point @ motion_jacobian(moved))[used].reshape(-1, 6)[:, :columns]
    variance = np.zeros(int(used.sum()))
    for d_parameters, covariance in ((d_first, covariances[0]), (d_second, covariances[1])):
        if covariance is not None:
            variance += _variance(d_parameters[used], covariance, gauge)
    sigma = np.full(used.shape, np.nan)
    sigma[used] = np.sqrt(variance)
    given = (covariances[0] is not None, covariances[1] is not None)
    return CameraDifference(
        pixels, theta, np.array(distance_m, dtype=float), difference, sigma, given, turn, np.asarray(shift)
    )


def points_over_image(
    camera: FisheyeCamera, distance_m: Sequence[float], grid: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels (n, 2) on a grid over the known field, their angles (n,), the points seen there (d, n, 3) and validity."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, grid), np.linspace(0, height - 1, grid))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    origins, directions, valid = camera.unproject(pixels)
    pixels, origins, directions = pixels[valid], origins[valid], directions[valid]
    points, visible = points_on_rays(origins, directions, np.asarray(distance_m, dtype=float)[:, None])
    theta = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    return pixels, theta, points, visible


def points_on_rays(
    origins: np.ndarray, directions: np.ndarray, distance_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points (..., 3) of rays (..., 3) at distances (...) from the frame's origin, and whether there is one.

    |o + t d| = D with t > 0; infinity is taken as very far.
    """
    distance = np.minimum(distance_m, FAR)
    along = (origins * directions).sum(axis=-1)
    square = along**2 + distance**2 - (origins**2).sum(axis=-1)
    reach = np.sqrt(np.maximum(square, 0)) - along
    return origins + reach[..., None] * directions, (square > 0) & (reach > 0)


def _alignment(
    camera: FisheyeCamera, points: np.ndarray, pixels: np.ndarray, visible: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector and shift of points (d, n, 3) by which a camera's pixels come nearest to those given."""
    rotation, shift = np.eye(3), np.zeros(3)
    for _ in range(_ITERATIONS if columns else 0):
        moved = points @ rotation.T + shift
        projected, reached, d_point, _ = camera.project_with_jacobian(moved)
        used = visible & reached
        if 2 * used.sum() <= columns:
            break
        derivative = (d_point @ motion_jacobian(moved))[used].reshape(-1, 6)[:, :columns]
        step = np.zeros(6)
        step[:columns] = np.linalg.lstsq(derivative, (pixels - projected)[used].ravel(), rcond=None)[0]
        turn = rotation_from_vector(step[:3])
        rotation, shift = turn @ rotation, turn @ shift + step[3:]
        if np.abs(step).max() < _SETTLED:
            break
    return vector_from_rotation(rotation), shift


def _variance(d_parameters: np.ndarray, covariance: np.ndarray, gauge: np.ndarray) -> np.ndarray:
    """Variance (m,), px², of the length at m pixels from ∂pixels/∂parameters (m, 2, P), gauge (2m, columns) removed."""
    rows = d_parameters.reshape(-1, d_parameters.shape[-1])
    if gauge.shape[1]:
        rows = rows - gauge @ np.linalg.lstsq(gauge, rows, rcond=None)[0]
    variance = np.einsum("ki,ij,kj->k", rows, covariance, rows, optimize=True)
    total: FloatArray = np.maximum(variance, 0).reshape(-1, 2).sum(axis=-1)
    return total
