"""Smooth deformations of a flat target: polynomials of its plane, by degree, free of what no camera can see.

    X_i = nominal_i + Σ_k a_k φ_k(i)

φ_k are products of Legendre polynomials P_p(x/h_x) P_q(y/h_y), made orthonormal over the target's points, degree by
degree, after the seven similarities: a shift along the normal and two tilts out of the plane; two shifts, a turn and a
change of size in it. A pose takes the first six up, and the size of everything that a camera sees is not in its images.
With the mean square of each |φ_k| over the points equal to 1, a_k is the root mean square of what it does to the
points, in metres. Height and in-plane fields come in groups of one degree: z2 … z8, and xy1 (x against y, and shear),
xy2 … xy6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from fisheye_ep_calib.target.shape.frame import BoardFrame

HEIGHT_DEGREES = range(2, 9)
IN_PLANE_DEGREES = range(1, 7)
HEIGHT_GROUPS = tuple(f"z{degree}" for degree in HEIGHT_DEGREES)
SMOOTH_GROUPS = (*HEIGHT_GROUPS, *(f"xy{degree}" for degree in IN_PLANE_DEGREES))
_DEPENDENT = 1e-6  # of a field's own size: what is left of one that the points cannot tell from others


@dataclass(frozen=True)
class Fields:
    """K deformations of n points. group (K,): index into SMOOTH_GROUPS.

    value (n, 3, K): metres a metre of coefficient, along the frame's x, y and normal. slope (n, 2, 3, K): its
    derivative along x and y, 1/metre.
    """

    group: np.ndarray
    value: np.ndarray
    slope: np.ndarray


def smooth_fields(frame: BoardFrame, points: np.ndarray, measured: np.ndarray, highest: int = 8) -> Fields:
    """The fields up to a degree at points (n, 3) of the target frame, orthonormal over those measured (n,) bool."""
    height_group, height, height_slope = _height(frame, points, measured, min(highest, HEIGHT_DEGREES[-1]))
    plane_group, plane, plane_slope = _in_plane(frame, points, measured, min(highest, IN_PLANE_DEGREES[-1]))
    count = height.shape[-1]
    value = np.zeros((len(points), 3, count + plane.shape[-1]))
    slope = np.zeros((len(points), 2, 3, value.shape[-1]))
    value[:, 2, :count], value[:, :2, count:] = height, plane
    slope[:, :, 2, :count], slope[:, :, :2, count:] = height_slope, plane_slope
    return Fields(np.concatenate([height_group, plane_group]), value, slope)


def _polynomials(frame: BoardFrame, points: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """P_p(x) P_q(y) of total degree p + q at points, (n, degree + 1), and derivatives (n, 2, degree + 1), 1/metre."""
    x, y = frame.plane_coordinates(points).T
    identity = np.eye(degree + 1)
    along_x, along_y = (legendre.legval(u, identity) for u in (x, y))
    d_x, d_y = (
        legendre.legval(u, legendre.legder(identity, axis=0)) if degree else np.zeros((1, len(u))) for u in (x, y)
    )
    p = np.arange(degree + 1)
    value = along_x[p] * along_y[degree - p]
    slope = np.stack(
        [d_x[p] * along_y[degree - p] / frame.half_extent[0], along_x[p] * d_y[degree - p] / frame.half_extent[1]]
    )
    return value.T, np.moveaxis(slope, -1, 0)


def _height(
    frame: BoardFrame, points: np.ndarray, measured: np.ndarray, highest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group (K,), value (n, K) and slope (n, 2, K) of the heights above the plane."""
    parts = [_polynomials(frame, points, degree) for degree in range(highest + 1)]
    value = np.concatenate([part[0] for part in parts], axis=-1)
    slope = np.concatenate([part[1] for part in parts], axis=-1)
    degrees = np.repeat(np.arange(highest + 1), np.arange(highest + 1) + 1)
    kept, mixing = _orthonormal(value[measured], first=3, scale=np.sqrt(measured.sum()))
    return degrees[kept] - HEIGHT_DEGREES.start, value @ mixing, slope @ mixing


def _in_plane(
    frame: BoardFrame, points: np.ndarray, measured: np.ndarray, highest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group (K,), value (n, 2, K) and slope (n, 2, 2, K) of the shifts along x and y."""
    position = frame.local(points)[:, :2]
    similarity = np.zeros((len(points), 2, 4))
    similarity[:, 0, 0] = similarity[:, 1, 1] = 1.0
    similarity[:, :, 2] = np.stack([-position[:, 1], position[:, 0]], axis=-1)
    similarity[:, :, 3] = position
    size = max(float(np.abs(position).max()), 1e-12)
    similarity[:, :, 2:] /= size
    values, slopes, degrees = [similarity], [_similarity_slope(len(points), size)], [np.zeros(4, dtype=int)]
    for degree in range(IN_PLANE_DEGREES.start, highest + 1):
        value, slope = _polynomials(frame, points, degree)
        both = np.zeros((len(points), 2, 2, degree + 1))
        both[:, 0, 0] = both[:, 1, 1] = value
        both_slope = np.zeros((len(points), 2, 2, 2, degree + 1))
        both_slope[:, :, 0, 0] = both_slope[:, :, 1, 1] = slope
        values.append(both.reshape(len(points), 2, -1))
        slopes.append(both_slope.reshape(len(points), 2, 2, -1))
        degrees.append(np.full(2 * (degree + 1), degree))
    value, slope, group = np.concatenate(values, -1), np.concatenate(slopes, -1), np.concatenate(degrees)
    kept, mixing = _orthonormal(value[measured].reshape(-1, value.shape[-1]), first=4, scale=np.sqrt(measured.sum()))
    return group[kept] - IN_PLANE_DEGREES.start + len(HEIGHT_DEGREES), value @ mixing, slope @ mixing


def _similarity_slope(count: int, size: float) -> np.ndarray:
    """Derivatives (n, 2, 2, 4) of two shifts, a turn and a change of size along x and y."""
    slope = np.zeros((count, 2, 2, 4))
    slope[:, 0, 1, 2], slope[:, 1, 0, 2] = 1 / size, -1 / size
    slope[:, 0, 0, 3] = slope[:, 1, 1, 3] = 1 / size
    return slope


def _orthonormal(columns: np.ndarray, first: int, scale: float) -> tuple[np.ndarray, np.ndarray]:
    """Which columns (r, C) are kept and the mixing (C, K) that makes them orthonormal in their order, times scale.

    The first ones are only projected out. What depends on earlier columns on these points is left out
    (Gram–Schmidt, twice for accuracy; Golub and Van Loan, Matrix Computations, 5.2).
    """
    rows, count = columns.shape
    basis, mixing = np.zeros((rows, count)), np.zeros((count, count))
    rank, kept = 0, []
    for index in range(count):
        column, mixed = columns[:, index].copy(), np.eye(count)[index]
        size = np.linalg.norm(column)
        for _ in range(2):
            share = column @ basis[:, :rank]
            column -= basis[:, :rank] @ share
            mixed -= mixing[:, :rank] @ share
        left = np.linalg.norm(column)
        if left <= _DEPENDENT * size or size == 0:
            continue
        basis[:, rank], mixing[:, rank] = column / left, mixed / left
        rank += 1
        if index >= first:
            kept.append(index)
    return np.array(kept, dtype=int), scale * mixing[:, rank - len(kept) : rank]
