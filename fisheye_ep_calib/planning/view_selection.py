"""Which views of a target are worth keeping: those that add a new position, size or tilt.

Nothing is known about the camera yet, so a view is described by what its pixels alone say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# A quadratic surface has six coefficients; more points are wanted than that, spread over the board.
MINIMUM_POINTS = 8


@dataclass(frozen=True)
class ViewSignature:
    """How a target appears in one image; independent of how its points are numbered and turned.

    position (2,): centre of the visible points, in fractions of the image's width and height.
    size: log2 of the local scale in image heights a metre; one more is a board at half the distance.
    tilt (4,): foreshortening as an axis (log2 of the ratio of the scales along and across it,
        in doubled-angle form) and as a direction (log2 of the scale's change over the board: the near side).
    """

    position: np.ndarray
    size: float
    tilt: np.ndarray


@dataclass(frozen=True)
class Novelty:
    """Least differences at which a view counts as new."""

    position: float = 0.08
    size: float = 0.3
    tilt: float = 0.3


def view_signature(object_points: np.ndarray, pixels: np.ndarray, image_size: tuple[int, int]) -> ViewSignature | None:
    """Signature of a view from its visible points (n, 2 or 3) m, of a flat board, and their pixels (n, 2).

    A quadratic map  pixel(x) = a + A x + [x^T Q_u x, x^T Q_v x]  is fitted about the visible points' centre
    by linear least squares. With the singular values s1 >= s2 of A and the unit image axis w of s2:
    size = log2 sqrt(s1 s2), foreshortening = log2(s1/s2) along w. The direction is the gradient of
    log2 |det dpixel/dx| by image position, A^-T d/dx, times the board's extent in pixels.
    None where the points are too few or lie on a line.
    """
    if len(pixels) < MINIMUM_POINTS:
        return None
    board = object_points[:, :2] - object_points[:, :2].mean(axis=0)
    extent = float(np.sqrt((board**2).sum(axis=1).mean()))
    if extent <= 0:
        return None
    x, y = (board / extent).T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    coefficients, _, rank, _ = np.linalg.lstsq(terms, pixels, rcond=1e-6)
    if rank < terms.shape[1]:
        return None
    linear = coefficients[1:3].T  # (2 pixel axes, 2 board axes), pixels per board extent
    axes, scales, _ = np.linalg.svd(linear)
    if scales[1] <= 1e-6 * scales[0]:
        return None
    size = float(np.log2(np.sqrt(scales[0] * scales[1]) / extent / image_size[1]))
    angle = 2 * np.arctan2(axes[1, 1], axes[0, 1])
    foreshortening = np.log2(scales[0] / scales[1]) * np.array([np.cos(angle), np.sin(angle)])
    along_x = np.stack([2 * coefficients[3], coefficients[4]], axis=1)  # d linear / dx
    along_y = np.stack([coefficients[4], 2 * coefficients[5]], axis=1)  # d linear / dy
    inverse = np.linalg.inv(linear)
    change = np.array([np.trace(inverse @ along_x), np.trace(inverse @ along_y)]) / np.log(2)
    direction = inverse.T @ change * np.sqrt(scales[0] * scales[1])
    position = pixels.mean(axis=0) / np.asarray(image_size, dtype=float)
    return ViewSignature(position, size, np.concatenate([foreshortening, direction]))


def is_new(candidate: ViewSignature, kept: Sequence[ViewSignature], least: Novelty | None = None) -> bool:
    """Whether no kept view resembles the candidate in position, size and tilt at once."""
    least = least or Novelty()
    return not any(_resembles(candidate, view, least) for view in kept)


def _resembles(first: ViewSignature, second: ViewSignature, least: Novelty) -> bool:
    return bool(
        np.linalg.norm(first.position - second.position) < least.position
        and abs(first.size - second.size) < least.size
        and np.linalg.norm(first.tilt - second.tilt) < least.tilt
    )
