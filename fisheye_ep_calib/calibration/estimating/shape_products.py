"""What the sightings say of a target's shape, gathered point by point."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.estimating.shape_equations import ShapeEquations
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.target.shape.model import LOCAL, ShapeModel


class ShapeProducts:
    """Collects the products of every point's local deformation (L = 3, or 9 of a disc) with the other columns.

    All fields act through the deformation of the points, so that a view costs q × L numbers a point, however many
    fields there are; they are multiplied in once the views are summed.
    """

    def __init__(self, shape: ShapeModel, views: int, view_size: int, shared_size: int, has_discs: bool) -> None:
        self._shape = shape
        count, local = len(shape.nominal), LOCAL if has_discs else 3
        self._pose = np.zeros((views, view_size, local, count))
        self._shared = np.zeros((shared_size + 1, local, count))
        self._own = np.zeros((local, local, count))

    def add(self, block: ViewBlock, parts: list[np.ndarray], d_local: np.ndarray, weights: np.ndarray) -> None:
        """parts (2, Q, B, N): columns of the view's own, then of what is shared and of the residual, in any parts.

        d_local (2, L, B, N). weights (B, N).
        """
        weighted = d_local * weights**2
        own_columns, *shared = *parts, d_local
        count = self._own.shape[-1]
        products, seen = _products(own_columns, weighted), block.real.sum(axis=1)
        for slot, view in enumerate(block.views):
            real = slice(seen[slot])  # padding comes last
            self._pose[view][..., block.points[slot, real]] = products[:, :, slot, real]
        total = np.concatenate([_products(part, weighted) for part in shared])
        if block.real.all() and (block.points == block.points[0]).all():
            # Every view shows the same points: sums need no sorting.
            by_point = np.zeros((*total.shape[:2], count))
            by_point[..., block.points[0]] = total.sum(axis=2)
        else:
            where = np.where(block.real, block.points, count).reshape(-1)
            flat = total.reshape(-1, where.size)
            by_point = np.stack([np.bincount(where, row, count + 1)[:count] for row in flat])
            by_point = by_point.reshape(*total.shape[:2], count)
        columns = len(self._shared)
        self._shared += by_point[:columns]
        self._own += by_point[columns:]

    def equations(self) -> ShapeEquations:
        shape, (local, count) = self._shape, self._own.shape[1:]
        fields, smooth = shape.fields[:, :local], shape.smooth_size
        flat = np.ascontiguousarray(fields.transpose(1, 0, 2)).reshape(local * count, smooth)
        axes = shape.point_axes
        same_axes = bool((axes == axes[0]).all())

        def by_unknown(products: np.ndarray) -> np.ndarray:
            """Products (..., L, n) with the local deformations as those with the shape's unknowns (..., K)."""
            leading = products.shape[:-2]
            unknowns = np.empty((*leading, shape.size))
            unknowns[..., :smooth] = (products.reshape(-1, local * count) @ flat).reshape(*leading, smooth)
            if shape.rough_size:
                shifts, rough = products[..., :3, :], unknowns[..., smooth:].reshape(*leading, count, 3)
                along = (
                    axes[0].T @ shifts if same_axes else (shifts[..., None, :] * axes.transpose(1, 2, 0)).sum(axis=-3)
                )
                for axis in range(3):  # one by one: runs of three numbers are slow to copy
                    rough[..., axis] = along[..., axis, :]
            return unknowns

        shared = by_unknown(self._shared)
        own_smooth = np.einsum("nlk,lmn->kmn", fields, self._own, optimize=True)
        own = self._own[:3, :3].transpose(2, 0, 1)
        rough = np.swapaxes(axes, -1, -2) @ own @ axes if shape.rough_size else np.zeros((0, 3, 3))
        return ShapeEquations(by_unknown(self._pose), shared[:-1], by_unknown(own_smooth), rough, shared[-1])


def _products(columns: np.ndarray, weighted: np.ndarray) -> np.ndarray:
    """Columns (2, Q, B, N) times weighted local derivatives (2, L, B, N), summed over u and v: (Q, L, B, N)."""
    products: FloatArray = columns[0, :, None] * weighted[0] + columns[1, :, None] * weighted[1]
    return products
