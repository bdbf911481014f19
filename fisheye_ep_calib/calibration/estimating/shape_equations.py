"""The normal equations of a target's shape beside camera and poses, and their solution.

Three kinds of unknowns: a pose a view; the camera and the smooth fields' coefficients, which all views share; and the
rough shift of every point, which all views share but which no other point's touches. Poses and points both give block
diagonals, so either can be eliminated first (Triggs et al., "Bundle adjustment: a modern synthesis", 6.1):

    [ D   G ] [e]     [g_e]       R = C − Gᵀ D⁻¹ G,   R d = −(g_d − Gᵀ D⁻¹ g_e),   e = −D⁻¹ (g_e + G d)
    [ Gᵀ  C ] [d] = − [g_d]

with D the blocks, e their unknowns and d everything else. The poses are eliminated where the dense rest C is then the
smaller, and the points where q V < 3 N, q being the six of a pose and what else is a view's own. What is penalised,
½ λ x², adds λ to the diagonal and λ x to the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.eliminated_system import Eliminated


@dataclass(frozen=True)
class ShapeEquations:
    """Products of the shape's K = S + 3N columns (smooth, then rough by point and axis) under the squared residuals.

    pose (V, q, K), camera (P, K): with the columns of poses, and what else is a view's own, and of the camera.
    smooth (S, K): of the smooth ones with all. rough (N, 3, 3): of each point's own; N may be 0, and only some of the
    three axes be there. gradient (K,).
    """

    pose: np.ndarray
    camera: np.ndarray
    smooth: np.ndarray
    rough: np.ndarray
    gradient: np.ndarray

    @property
    def smooth_size(self) -> int:
        return len(self.smooth)

    def chosen(self, smooth: np.ndarray, axes: np.ndarray) -> ShapeEquations:
        """Of some smooth columns (S,) bool and some axes (3,) bool of the rough ones."""
        kept = np.flatnonzero(np.concatenate([smooth, np.tile(axes, len(self.rough))]))
        rough = self.rough[:, axes][:, :, axes] if axes.any() else np.zeros((0, 0, 0))
        smooth_rows = self.smooth[smooth][:, kept]
        return ShapeEquations(self.pose[..., kept], self.camera[:, kept], smooth_rows, rough, self.gradient[kept])

    def penalised(self, penalty: np.ndarray, values: np.ndarray) -> ShapeEquations:
        """With ½ Σ λ x² added, λ (K,) and x (K,): penalties and values of the shape's unknowns."""
        count = self.smooth_size
        smooth, rough = self.smooth.copy(), self.rough.copy()
        smooth[np.arange(count), np.arange(count)] += penalty[:count]
        if rough.size:
            axes = np.arange(rough.shape[-1])
            rough[:, axes, axes] += penalty[count:].reshape(-1, len(axes))
        return replace(self, smooth=smooth, rough=rough, gradient=self.gradient + penalty * values)

    def damped(self, damping: float) -> ShapeEquations:
        """With diagonal entries multiplied by 1 + damping."""
        own = self.diagonal * damping
        return self.penalised(own, np.zeros_like(own))

    @property
    def diagonal(self) -> np.ndarray:
        """(K,)."""
        return np.concatenate(
            [np.diag(self.smooth[:, : self.smooth_size]), np.einsum("nii->ni", self.rough).reshape(-1)]
        )

    def times(self, unknowns: np.ndarray) -> np.ndarray:
        """The shape's own products H_ss with unknowns (K,)."""
        count = self.smooth_size
        rough = self.smooth[:, count:].T @ unknowns[:count]
        if len(self.rough):
            rough = rough + (self.rough @ unknowns[count:].reshape(len(self.rough), -1, 1)).reshape(-1)
        return np.concatenate([self.smooth @ unknowns, rough])

    def minus(self, other: ShapeEquations, views: np.ndarray) -> ShapeEquations:
        """Without another's contribution, which is that of all views but those chosen by views (V,) bool."""
        return ShapeEquations(
            self.pose[views],
            self.camera - other.camera,
            self.smooth - other.smooth,
            self.rough - other.rough,
            self.gradient - other.gradient,
        )


@dataclass(frozen=True)
class BlockSystem:
    """blocks D (k, b, b), coupling G (k, b, d), dense C (d, d).

    places: for each kind of unknown whether it stands among the dense ones, and where.
    """

    blocks: np.ndarray
    coupling: np.ndarray
    dense: np.ndarray
    places: dict[str, tuple[bool, slice]]

    @property
    def _rows(self) -> int:
        return int(self.blocks.shape[0] * self.blocks.shape[1])

    def reduced(self) -> tuple[np.ndarray, np.ndarray]:
        """R (d, d) and D⁻¹ G (k, b, d)."""
        factor, half, reduced = self._reduced(self.blocks)
        return reduced, factor.transpose(0, 2, 1) @ half

    def _reduced(self, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """L⁻¹ (k, b, b) of D = L Lᵀ, which may have more on its diagonal; W = L⁻¹ G (k, b, d) and R (d, d).

        Gᵀ D⁻¹ G = Wᵀ W: a product of a matrix with itself costs half of another.
        """
        factor = np.linalg.inv(np.linalg.cholesky(blocks))
        half = factor @ self.coupling
        flat = half.reshape(self._rows, -1)
        return factor, half, self.dense - flat.T @ flat

    def solve(self, right: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The unknowns of each kind for right sides (unknowns of the kind, r), of the same shapes."""
        columns = next(iter(right.values())).shape[1]
        dense_right = np.zeros((len(self.dense), columns))
        for name, (is_dense, place) in self.places.items():
            if is_dense:
                dense_right[place] = right[name]
        factor, half, reduced = self._reduced(self.blocks)
        flat, shape = half.reshape(self._rows, -1), (*self.blocks.shape[:2], columns)
        own = (factor @ right[self.block_kind].reshape(shape)).reshape(self._rows, columns)
        dense = solve_scaled(reduced, dense_right - flat.T @ own)
        blocks = factor.transpose(0, 2, 1) @ (own - flat @ dense).reshape(shape)
        blocks = blocks.reshape(self._rows, columns)
        return {name: dense[place] if is_dense else blocks for name, (is_dense, place) in self.places.items()}

    @property
    def block_kind(self) -> str:
        """Of unknowns, that the blocks are of."""
        return next(name for name, (is_dense, _) in self.places.items() if not is_dense)

    def eliminated(self, gradient: dict[str, np.ndarray], penalty: np.ndarray) -> Eliminated:
        """Without the blocks' unknowns, with a gradient by kind; penalty (k · b,): on their diagonal."""
        dense = np.zeros(len(self.dense))
        for name, (is_dense, place) in self.places.items():
            if is_dense:
                dense[place] = gradient[name]
        blocks, diagonal = self.blocks.copy(), np.arange(self.blocks.shape[-1])
        blocks[:, diagonal, diagonal] += penalty.reshape(len(blocks), -1)
        factor, half, reduced = self._reduced(blocks)
        own = factor @ gradient[self.block_kind].reshape(*blocks.shape[:2], 1)
        flat = half.reshape(self._rows, -1)
        return Eliminated(self.places, factor, half, own, reduced, dense - flat.T @ own.reshape(-1))


def solve_scaled(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric positive definite system (S, S) after scaling its diagonal to one."""
    if matrix.shape[0] == 0:
        return np.zeros_like(right)
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix * scale[:, None] * scale
    weight = scale if right.ndim == 1 else scale[:, None]
    return weight * np.linalg.solve(scaled, weight * right)


def block_system(pose: np.ndarray, mixed: np.ndarray, camera: np.ndarray, shape: ShapeEquations) -> BlockSystem:
    """The system of poses (V, q, q), camera (P, P) with mixed (V, q, P), and the shape, its cheaper kind in blocks."""
    if pose.shape[0] * pose.shape[1] < shape.rough.shape[0] * shape.rough.shape[-1]:
        return _points_in_blocks(pose, mixed, camera, shape)
    count, size = len(camera), len(camera) + len(shape.gradient)
    smooth_end = count + shape.smooth_size
    dense = np.zeros((size, size))
    dense[:count, :count] = camera
    dense[:count, count:], dense[count:, :count] = shape.camera, shape.camera.T
    dense[count:smooth_end, count:] = shape.smooth
    dense[smooth_end:, count:smooth_end] = shape.smooth[:, shape.smooth_size :].T
    _put_blocks(dense, smooth_end, shape.rough)
    places = {
        "pose": (False, slice(0, pose.shape[0] * pose.shape[1])),
        "camera": (True, slice(0, count)),
        "smooth": (True, slice(count, smooth_end)),
        "rough": (True, slice(smooth_end, size)),
    }
    return BlockSystem(pose, np.concatenate([mixed, shape.pose], axis=-1), dense, places)


def _points_in_blocks(pose: np.ndarray, mixed: np.ndarray, camera: np.ndarray, shape: ShapeEquations) -> BlockSystem:
    views, count, smooth = len(pose), len(camera), shape.smooth_size
    rows = views * pose.shape[1]
    size = rows + count + smooth
    dense = np.zeros((size, size))
    _put_blocks(dense, 0, pose)
    beside = np.concatenate([mixed, shape.pose[..., :smooth]], axis=-1).reshape(rows, count + smooth)
    dense[:rows, rows:], dense[rows:, :rows] = beside, beside.T
    shared = slice(rows, rows + count)
    dense[shared, shared] = camera
    dense[shared, rows + count :], dense[rows + count :, shared] = shape.camera[:, :smooth], shape.camera[:, :smooth].T
    dense[rows + count :, rows + count :] = shape.smooth[:, :smooth]
    coupling = np.concatenate(
        [shape.pose[..., smooth:].reshape(rows, -1), shape.camera[:, smooth:], shape.smooth[:, smooth:]]
    ).T.reshape(*shape.rough.shape[:2], size)
    places = {
        "pose": (True, slice(0, rows)),
        "camera": (True, shared),
        "smooth": (True, slice(rows + count, size)),
        "rough": (False, slice(0, len(coupling) * coupling.shape[1])),
    }
    return BlockSystem(shape.rough, np.ascontiguousarray(coupling), dense, places)


def _put_blocks(matrix: np.ndarray, start: int, blocks: np.ndarray) -> None:
    """Blocks (k, b, b) along the diagonal from a place on."""
    size = blocks.shape[-1]
    where = start + size * np.arange(len(blocks))[:, None] + np.arange(size)
    matrix[where[:, :, None], where[:, None]] = blocks
