"""The pixels around many places at once: flat arrays, one place's pixels after another's, sums over segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PixelPatches:
    """d patches with p pixels in all.

    owner (p,): which patch. x, y (p,): from the patch's centre, pixels. value (p,): grey. place (p,): index
    into the image's pixels, row after row. start (d,): each patch's first pixel. Patches are cut off at the
    image's border.
    """

    owner: np.ndarray
    x: np.ndarray
    y: np.ndarray
    value: np.ndarray
    place: np.ndarray
    start: np.ndarray

    @staticmethod
    def cut(image: np.ndarray, center: np.ndarray, half: np.ndarray, stride: np.ndarray | int = 1) -> PixelPatches:
        """Rectangles around center (d, 2), half (d, 2) their half sides in pixels; each holds at least a
        pixel.

        stride (d,) int: take every so manieth row and column.
        """
        height, width = image.shape
        limit = np.array([width - 1, height - 1])
        stride = np.broadcast_to(stride, len(center))
        low = np.clip(np.ceil(center - half), 0, limit).astype(np.int64)
        high = np.maximum(np.clip(np.floor(center + half), 0, limit).astype(np.int64), low)
        columns, rows = ((high - low) // stride[:, None] + 1).T
        size = columns * rows
        start = np.cumsum(size) - size

        def spread(values: np.ndarray, kind: type[np.generic] = np.int32) -> np.ndarray:
            return np.repeat(values.astype(kind), size)

        index = np.arange(int(size.sum()), dtype=np.int32) - spread(start)
        wide, step = spread(columns), spread(stride)
        row = index // wide
        column = (index - row * wide) * step
        row *= step
        place = spread(low[:, 1] * width + low[:, 0], np.int64) + row * width + column
        x = column + spread(low[:, 0] - center[:, 0], np.float32)
        y = row + spread(low[:, 1] - center[:, 1], np.float32)
        owner = spread(np.arange(len(center)))
        return PixelPatches(owner, x, y, image.ravel()[place].astype(np.float32), place, start)

    def __len__(self) -> int:
        return len(self.start)

    @property
    def size(self) -> np.ndarray:
        """Pixels (d,) of each patch."""
        return np.diff(np.append(self.start, len(self.x)))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values (d,) of the patches, repeated for each of their pixels (p,), float32."""
        return np.repeat(values.astype(np.float32), self.size)

    def select(self, kept: np.ndarray) -> tuple[PixelPatches, np.ndarray]:
        """The patches cut down to the pixels kept (p,) bool, and which of those are meant (q,).

        Each patch keeps its first pixel besides, so that no segment is empty; that one is then not meant.
        """
        taken = kept.copy()
        taken[self.start] = True
        size = self.sum(taken).astype(np.int64)
        index = np.flatnonzero(taken)
        columns = self.owner[index], self.x[index], self.y[index], self.value[index], self.place[index]
        return PixelPatches(*columns, np.cumsum(size) - size), kept[index]

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over each patch, (d,)."""
        return np.add.reduceat(values, self.start, dtype=np.float64) if len(self) else np.zeros(0)

    def mean(self, values: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Means over each patch's kept pixels (p,) bool, (d,); 0 where none is kept."""
        result: np.ndarray = self.sum(values * kept) / np.maximum(self.sum(kept), 1)
        return result

    def quantile(self, values: np.ndarray, kept: np.ndarray, share: float) -> np.ndarray:
        """The value (d,) that ``share`` of each patch's kept pixels (p,) bool do not reach; 0 where none is kept.

        values (p,): 0 to 255.
        """
        owner = self.owner[kept]
        count = np.bincount(owner, minlength=len(self))
        ordered = np.sort(owner + values[kept] / 1024.0)  # by patch, then by value
        place = np.cumsum(count) - count + (share * np.maximum(count - 1, 0)).astype(np.int64)
        quantiles = np.zeros(len(self))
        quantiles[count > 0] = 1024.0 * (ordered[place[count > 0]] - np.flatnonzero(count))
        return quantiles


def fit_planes(patches: PixelPatches, weight: np.ndarray, information: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Weighted least-squares planes (d, 3): value at the centre, slopes along x and y.

    information (d, 2, 2), pixels²: normal matrix N of what is known of the slopes g besides; moment (d, 2): N g.
    """
    wx, wy = weight * patches.x, weight * patches.y
    total, sx, sy = patches.sum(weight), patches.sum(wx), patches.sum(wy)
    # A patch of one pixel has no slope of its own.
    xx = patches.sum(wx * patches.x) + information[:, 0, 0] + 1e-3
    yy = patches.sum(wy * patches.y) + information[:, 1, 1] + 1e-3
    xy = patches.sum(wx * patches.y) + information[:, 0, 1]
    right = np.stack(
        [
            patches.sum(weight * patches.value),
            patches.sum(wx * patches.value) + moment[:, 0],
            patches.sum(wy * patches.value) + moment[:, 1],
        ],
        axis=-1,
    )
    left = np.stack([np.stack([total + 1e-6, sx, sy], -1), np.stack([sx, xx, xy], -1), np.stack([sy, xy, yy], -1)], -2)
    return np.linalg.solve(left, right[..., None])[..., 0]
