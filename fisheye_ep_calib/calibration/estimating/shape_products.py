"""What the sightings say of a target's shape, gathered point by point."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration.estimating.shape_equations import ShapeEquations
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.target.shape.model import LOCAL, ShapeModel


class ShapeProducts:
    """Collects the products of every point's local deformation (L = 3, or 9 of a disc) with the other columns.

    All fields act through the deformation of the points, so that a view costs 6 × L numbers a point, however many
    fields there are; they are multiplied in once the views are summed.
    """

    def __init__(self, shape: ShapeModel, views: int, shared_size: int, has_discs: bool) -> None:
        self._shape = shape
        count, local = len(shape.nominal), LOCAL if has_discs else 3
        self._pose = np.zeros((views, 6, count, local))
        self._shared = np.zeros((shared_size + 1, count, local))
        self._own = np.zeros((count, local, local))

    def add(self, block: ViewBlock, parts: list[np.ndarray], d_local: np.ndarray, weights: np.ndarray) -> None:
        """parts (2, Q, B, N): columns of pose, shared parameters and residual; d_local (2, L, B, N); weights (B, N)."""
        both = np.concatenate([*parts, d_local], axis=1)
        weighted = d_local * weights**2
        products = both[0, :, None] * weighted[0] + both[1, :, None] * weighted[1]
        shared = self._shared.shape[0]
        whole = block.real.all() and (block.points == block.points[0]).all()
        if whole:  # every view shows the same points: sums need no sorting
            points = block.points[0]
            self._pose[block.views[:, None], :, points] = np.moveaxis(products[:6], (2, 3), (0, 1))
            total = products[6:].sum(axis=2)
        else:
            count = len(self._own)
            place = np.where(block.real, block.points, count)  # padding goes to a row of its own
            spread = np.zeros((len(block.views), count + 1, 6, products.shape[1]))
            spread[np.arange(len(block.views))[:, None], place] = np.moveaxis(products[:6], (2, 3), (0, 1))
            self._pose[block.views] = np.moveaxis(spread[:, :count], 1, 2)
            points = np.arange(count)
            flat = products[6:].reshape(-1, place.size)
            total = np.stack([np.bincount(place.reshape(-1), row, count + 1)[:count] for row in flat])
            total = total.reshape(*products[6:].shape[:2], count)
        self._shared[:, points] += np.moveaxis(total[:shared], 1, 2)
        self._own[points] += np.moveaxis(total[shared:], 2, 0)

    def equations(self) -> ShapeEquations:
        local = self._own.shape[1]
        fields, axes = self._shape.fields[:, :local], self._shape.frame.axes
        flat = fields.reshape(fields.shape[0] * local, fields.shape[-1])
        is_rough = self._shape.rough_size > 0

        def by_unknown(products: np.ndarray) -> np.ndarray:
            """Products (..., n, L) with the local deformations as those with the shape's unknowns (..., K)."""
            smooth = products.reshape(*products.shape[:-2], len(flat)) @ flat
            if not is_rough:
                return smooth
            rough = products[..., :3] @ axes
            return np.concatenate([smooth, rough.reshape(*rough.shape[:-2], rough.shape[-2] * 3)], axis=-1)

        shared = by_unknown(self._shared)
        own_smooth = np.einsum("nlk,nlm->knm", fields, self._own, optimize=True)
        rough = axes.T @ self._own[:, :3, :3] @ axes if is_rough else np.zeros((0, 3, 3))
        return ShapeEquations(by_unknown(self._pose), shared[:-1], by_unknown(own_smooth), rough, shared[-1])
