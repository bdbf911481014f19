"""Reading the cells of square markers, and the numbers that a dictionary gives them."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.target.markers.aruco import aruco_dictionary, marker_bits

CELL = np.array([-0.2, 0.2])  # of a cell, off its middle: where it is looked at along each axis
LEAST_CONTRAST = 4.0  # grey values between white and black cells
MOST_WHITE = 0.2  # of the border's cells
CORRECTED = 0.6  # of the wrong cells that a dictionary can correct, those that are believed


@dataclass(frozen=True)
class Codebook:
    """A dictionary's markers. name: OpenCV's. border: black cells around. codes (n, k, k) uint8: 1 white.

    most_wrong: cells in which a marker may differ.
    """

    name: str
    border: int
    codes: np.ndarray
    most_wrong: int

    @property
    def side(self) -> int:
        """Cells along a marker, the border's among them."""
        return int(self.codes.shape[1]) + 2 * self.border

    def match(self, cells: np.ndarray, mirrored: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Number, quarter turns and wrong cells, each (q,) int, of cells (q, k, k) bool; number −1 where it is none.

        Turned by so many quarters clockwise, the marker looks like the cells. mirrored: it is seen in a mirror.
        """
        codes = self.codes[:, :, ::-1] if mirrored else self.codes
        signs = np.stack([np.rot90(codes, -turn, axes=(1, 2)) for turn in range(4)], axis=1)
        signs = signs.reshape(4 * len(codes), -1).astype(np.float32) * 2 - 1
        agree = (cells.reshape(len(cells), signs.shape[1]).astype(np.float32) * 2 - 1) @ signs.T
        best = agree.argmax(axis=1)
        wrong = np.rint((signs.shape[1] - agree[np.arange(len(cells)), best]) / 2).astype(int)
        number, turn = best // 4, best % 4
        return np.where(wrong <= self.most_wrong, number, -1), turn, wrong


def codebook(name: str, border: int, what: str) -> Codebook:
    """One of OpenCV's dictionaries. what: for the error message where OpenCV lacks them."""
    aruco_dictionary(name, what)
    return _codebook(name, border)


@functools.cache
def _codebook(name: str, border: int) -> Codebook:
    dictionary = aruco_dictionary(name, "a marker")
    bits = marker_bits(dictionary, np.arange(len(dictionary.bytesList)), border=1)[:, 1:-1, 1:-1]
    return Codebook(name, border, bits, int(CORRECTED * dictionary.maxCorrectionBits))


def read_cells(image: np.ndarray, quads: np.ndarray, inner: int, border: int) -> tuple[np.ndarray, np.ndarray]:
    """The inner cells (q, inner, inner) bool of quadrilaterals (q, 4, 2), True white; whether the border is black (q,).

    Row by row from the quadrilateral's first corner along its first side.
    """
    side = inner + 2 * border
    if len(quads) == 0:
        return np.zeros((0, inner, inner), dtype=bool), np.zeros(0, dtype=bool)
    along = ((np.arange(side) + 0.5)[:, None] + CELL).ravel() / side
    x, y = np.meshgrid(along, along)
    places = apply_homographies(from_unit_square(quads), x.ravel(), y.ravel()).astype(np.float32)
    values = cv2.remap(image, places[..., 0], places[..., 1], cv2.INTER_LINEAR).astype(np.float32)
    grey = values.reshape(len(quads), side, 2, side, 2).mean(axis=(2, 4))
    ring = np.ones((side, side), dtype=bool)
    ring[border:-border, border:-border] = False
    black = np.median(grey[:, ring], axis=1)
    inside = grey[:, ~ring]
    white = np.partition(inside, -2, axis=1)[:, -2:].mean(axis=1)
    level = (black + white) / 2
    # The white cells' own middle: the brightest may be a glare.
    light = inside > level[:, None]
    white = (inside * light).sum(axis=1) / np.maximum(light.sum(axis=1), 1)
    level = (black + white) / 2
    framed = ((grey[:, ring] > level[:, None]).mean(axis=1) <= MOST_WHITE) & (white - black > LEAST_CONTRAST)
    return (inside > level[:, None]).reshape(len(quads), inner, inner), framed


def from_unit_square(quads: np.ndarray) -> np.ndarray:
    """Homographies (q, 3, 3) that map the corners (0, 0), (1, 0), (1, 1), (0, 1) to those of quadrilaterals (q, 4, 2).

    Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), section 2.2.3.
    """
    a, b, c, d = np.moveaxis(quads, 1, 0)
    sum_, first, second = a - b + c - d, b - c, d - c
    across = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    across = np.where(np.abs(across) < 1e-9, 1e-9, across)
    g = (sum_[:, 0] * second[:, 1] - sum_[:, 1] * second[:, 0]) / across
    h = (first[:, 0] * sum_[:, 1] - first[:, 1] * sum_[:, 0]) / across
    matrix = np.empty((len(quads), 3, 3))
    matrix[:, :2, 0] = b - a + g[:, None] * b
    matrix[:, :2, 1] = d - a + h[:, None] * d
    matrix[:, :2, 2] = a
    matrix[:, 2] = np.stack([g, h, np.ones(len(quads))], axis=-1)
    return matrix


def apply_homographies(matrix: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Images (q, n, 2) of points x, y, (n,) or (q, n), under homographies (q, 3, 3)."""
    mapped = matrix @ np.stack([x, y, np.ones_like(x)], axis=-2)
    bottom = np.where(np.abs(mapped[:, 2:]) < 1e-9, 1e-9, mapped[:, 2:])
    return np.swapaxes(mapped[:, :2] / bottom, 1, 2)
