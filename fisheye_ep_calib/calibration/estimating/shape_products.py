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
        self._pose = np.zeros((views, count, view_size, local))
        self._shared = np.zeros((shared_size + 1, count, local))
        self._own = np.zeros((count, local, local))

    def add(self, block: ViewBlock, parts: list[np.ndarray], d_local: np.ndarray, weights: np.ndarray) -> None:
        """parts (2, Q, B, N): columns of the view's own, then of what is shared and of the residual, in any parts.

        d_local (2, L, B, N). weights (B, N).
        """
        weighted = d_local * weights**2
        own_columns, *shared = *parts, d_local
        count, local = self._own.shape[:2]
        size = self._pose.shape[2] * local
        whole = bool(block.real.all() and (block.points == block.points[0]).all())
        place = np.where(block.real, block.points, count)  # padding goes to a row of its own
        rows = (np.arange(len(place))[:, None] * (count + 1) + place).reshape(-1)
        spread = np.zeros((len(place) * (count + 1), size))
        spread[rows] = _products(own_columns, weighted).reshape(size, -1).T
        self._pose[block.views] = spread.reshape(len(place), count + 1, -1, local)[:, :count]
        sums = [_products(part, weighted).reshape(-1, *place.shape) for part in shared]
        total = np.concatenate(sums)
        if whole:  # every view shows the same points: sums need no sorting
            by_point = np.zeros((len(total), count))
            by_point[:, block.points[0]] = total.sum(axis=1)
        else:
            flat, where = total.reshape(len(total), -1), place.reshape(-1)
            by_point = np.stack([np.bincount(where, row, count + 1)[:count] for row in flat])
        columns, own = len(self._shared), by_point.reshape(-1, local, count)
        self._shared += np.moveaxis(own[:columns], 1, 2)
        self._own += np.moveaxis(own[columns:], 2, 0)

    def equations(self) -> ShapeEquations:
        local = self._own.shape[1]
        fields, axes = self._shape.fields[:, :local], self._shape.point_axes
        flat = fields.reshape(fields.shape[0] * local, fields.shape[-1])
        is_rough = self._shape.rough_size > 0

        def by_unknown(products: np.ndarray) -> np.ndarray:
            """Products (..., n, L) with the local deformations as those with the shape's unknowns (..., K)."""
            smooth: FloatArray = products.reshape(*products.shape[:-2], len(flat)) @ flat
            if not is_rough:
                return smooth
            rough = np.einsum("...ni,nij->...nj", products[..., :3], axes, optimize=True)
            return np.concatenate([smooth, rough.reshape(*rough.shape[:-2], rough.shape[-2] * 3)], axis=-1)

        shared = by_unknown(self._shared)
        own_smooth = np.einsum("nlk,nlm->knm", fields, self._own, optimize=True)
        rough = np.swapaxes(axes, 1, 2) @ self._own[:, :3, :3] @ axes if is_rough else np.zeros((0, 3, 3))
        return ShapeEquations(
            by_unknown(np.moveaxis(self._pose, 1, 2)), shared[:-1], by_unknown(own_smooth), rough, shared[-1]
        )


def _products(columns: np.ndarray, weighted: np.ndarray) -> np.ndarray:
    """Columns (2, Q, B, N) times weighted local derivatives (2, L, B, N), summed over u and v: (Q, L, B, N)."""
    products: FloatArray = columns[0, :, None] * weighted[0] + columns[1, :, None] * weighted[1]
    return products
