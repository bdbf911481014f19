"""Images in which there is no target, but much that resembles one: what a detector must not fall for."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np


def clutter_image(seed: int, size: tuple[int, int] = (1024, 1024)) -> np.ndarray:
    """A grey image (h, w) uint8 without a target; size is (width, height). Reproducible by seed.

    A smooth background with one to four kinds of things on it: scattered discs and ellipses, boxes, lines, lettering,
    stripes, tiles of random grey; then blur and noise.
    """
    rng = np.random.default_rng([seed, 7])
    width, height = size
    coarse = rng.uniform(40, 220, (6, 6)).astype(np.float32)
    image = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
    kinds = rng.permutation(len(_KINDS))[: rng.integers(1, 5)]
    for kind in kinds:
        _KINDS[kind](image, rng)
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 2.0))
    image = image + rng.uniform(0, 8) * rng.standard_normal((height, width), np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _place(image: np.ndarray, rng: np.random.Generator) -> tuple[int, int]:
    height, width = image.shape
    return int(rng.integers(width)), int(rng.integers(height))


def _ellipses(image: np.ndarray, rng: np.random.Generator) -> None:
    """Scattered dark and bright ellipses, many of them round."""
    largest = rng.uniform(6, 60)
    for _ in range(rng.integers(10, 120)):
        radius = rng.uniform(3, largest)
        axes = int(np.ceil(radius)), int(np.ceil(radius * rng.uniform(0.5, 1)))
        angle = rng.uniform(0, 180)
        cv2.ellipse(image, _place(image, rng), axes, angle, 0, 360, rng.uniform(0, 255), -1, cv2.LINE_AA)


def _boxes(image: np.ndarray, rng: np.random.Generator) -> None:
    """Scattered quadrilaterals."""
    for _ in range(rng.integers(5, 80)):
        corners = np.array(_place(image, rng)) + rng.uniform(-60, 60, (4, 2))
        cv2.fillConvexPoly(image, cv2.convexHull(corners.astype(np.int32)), rng.uniform(0, 255), cv2.LINE_AA)


def _lines(image: np.ndarray, rng: np.random.Generator) -> None:
    for _ in range(rng.integers(10, 100)):
        thickness = int(rng.integers(1, 8))
        cv2.line(image, _place(image, rng), _place(image, rng), rng.uniform(0, 255), thickness, cv2.LINE_AA)


def _lettering(image: np.ndarray, rng: np.random.Generator) -> None:
    """Lines of text: rows of alike blobs at even distances."""
    letters = np.array(list("oO0.:iI8BQ# "))
    for _ in range(rng.integers(5, 40)):
        text = "".join(rng.choice(letters, rng.integers(3, 30)))
        mask = np.zeros(image.shape, np.uint8)  # OpenCV 5 writes into 8-bit images only
        scale, thickness = rng.uniform(0.4, 3), int(rng.integers(1, 6))
        cv2.putText(mask, text, _place(image, rng), 0, scale, 255, thickness, cv2.LINE_AA)
        image[mask > 127] = rng.uniform(0, 255)


def _stripes(image: np.ndarray, rng: np.random.Generator) -> None:
    """A grating over part of the image: a fence, a radiator, blinds."""
    (left, top), (right, bottom) = np.sort([_place(image, rng), _place(image, rng)], axis=0)
    area = image[top : bottom + 1, left : right + 1]
    x = np.arange(area.shape[1], dtype=np.float32)
    area += rng.uniform(20, 90) * np.sign(np.sin(2 * np.pi * x / rng.uniform(6, 60)))


def _tiles(image: np.ndarray, rng: np.random.Generator) -> None:
    """A wall of tiles, each with a grey level of its own."""
    side, levels = int(rng.integers(12, 60)), (30, 60)
    tiles = rng.uniform(20, 235, levels).astype(np.float32)
    wall = np.kron(tiles, np.ones((side, side), np.float32))
    left, top = _place(image, rng)
    height, width = (min(a, b) for a, b in zip(wall.shape, (image.shape[0] - top, image.shape[1] - left), strict=True))
    image[top : top + height, left : left + width] = wall[:height, :width]


_KINDS: tuple[Callable[[np.ndarray, np.random.Generator], None], ...] = (
    _ellipses,
    _boxes,
    _lines,
    _lettering,
    _stripes,
    _tiles,
)
