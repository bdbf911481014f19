"""Measuring saddle corners whose surroundings in the print are known."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.target.corners.refinement import (
    LEAST_CONTRAST,
    corner_contrast,
    looks_like_corner,
    reach_of,
    refine_corners,
)
from fisheye_ep_calib.target.corners.saddle_fit import fit_saddles


@dataclass(frozen=True)
class Surroundings:
    """What is printed around n corners, metres along the target's x and y.

    half (n,): within it, along both edges, there are the corner's two edges and no others but those of depth.
    bright (n,): +1 where the quadrants (+, +) and (−, −) are white, −1 where they are black. depth (n, 2):
    how far from both edges the quadrants (+, +) and (−, −), and the other two, are plain; a marker may begin
    there. end (n,): how long the corner's edges are.
    """

    half: np.ndarray
    bright: np.ndarray
    depth: np.ndarray
    end: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> Surroundings:
        return Surroundings(self.half[chosen], self.bright[chosen], self.depth[chosen], self.end[chosen])

    def coloured_as(self, image: np.ndarray, pixels: np.ndarray, jacobian: np.ndarray) -> Surroundings:
        """These surroundings with black and white exchanged where most corners look so about pixels (n, 2).

        jacobian (n, 2, 2): pixels per metre.
        """
        clear = np.minimum(self.half, self.depth.min(axis=1))
        contrast = corner_contrast(image, pixels, clear[:, None, None] * jacobian) * self.bright
        exchanged = (contrast > LEAST_CONTRAST).sum() < (contrast < -LEAST_CONTRAST).sum()
        return replace(self, bright=-self.bright) if exchanged else self

    @staticmethod
    def plain(half: np.ndarray, bright: np.ndarray) -> Surroundings:
        """Quadrants with nothing in them, of squares half of whose side is half."""
        return Surroundings(half, bright, np.repeat(half[:, None], 2, axis=1), 2 * half)


def measure_corners(
    image: np.ndarray, start: np.ndarray, jacobian: np.ndarray, bend: np.ndarray, around: Surroundings
) -> tuple[np.ndarray, np.ndarray]:
    """Corners near start (k, 2): their pixels (k, 2), and whether each is one, of the right colours (k,).

    jacobian (k, 2, 2): pixels per metre. bend (k, 2, 3): second derivatives of the pixel for steps of
    around.half.
    """
    axes = around.half[:, None, None] * jacobian
    clear = np.minimum(around.half, around.depth.min(axis=1))
    clear_axes = clear[:, None, None] * jacobian
    coarse, good = refine_corners(image, start, reach_of(clear_axes))
    coarse = np.where(good[:, None], coarse, start)
    depth, end = around.depth / around.half[:, None], around.end / around.half
    fit = fit_saddles(image, coarse, axes, bend, depth, end)
    good = fit.good(around.bright) & looks_like_corner(image, fit.pixels, clear_axes, around.bright)
    return fit.pixels, good & (np.hypot(*(fit.pixels - start).T) < np.maximum(0.6 * reach_of(axes), 1.5))
