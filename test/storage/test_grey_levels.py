"""Deep images get the range of the scene: no hot pixel, line of data, dark surrounding or lamp takes it away."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.storage.grey_levels import to_eight_bits

HEIGHT, WIDTH = 480, 640
BLACK, WHITE = 900, 2600


def board() -> tuple[np.ndarray, np.ndarray]:
    """A chessboard of 30-pixel squares in the middle of a fisheye's circle, 12 bits; and where the board is."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    image = np.full((HEIGHT, WIDTH), 100.0)
    inside = np.hypot(u - 320, v - 240) < 150
    image[inside] = 1500
    where = (abs(u - 320) < 90) & (abs(v - 240) < 90)
    image[where] = np.where((u // 30 + v // 30) % 2, WHITE, BLACK)[where]
    noise = np.random.default_rng(0).normal(0, 10, image.shape)
    return np.rint(image + noise).astype(np.uint16), where


def contrast(image: np.ndarray, where: np.ndarray, original: np.ndarray) -> float:
    """Grey levels between the white and the black squares."""
    levels = to_eight_bits(image)[where].astype(float)
    return levels[original[where] > 1750].mean() - levels[original[where] < 1750].mean()


def hot_pixels(image):
    rng = np.random.default_rng(1)
    image[rng.integers(0, HEIGHT, 30), rng.integers(0, WIDTH, 30)] = 65535


def data_lines(image):
    image[:4] = np.random.default_rng(1).integers(0, 65536, (4, WIDTH))
    image[-4:] = 65535


def lamp(image):
    image[100:130, 300:330] = 65535


@pytest.mark.parametrize("fault", [lambda image: None, hot_pixels, data_lines, lamp])
def test_the_board_keeps_its_contrast(fault):
    image, where = board()
    original = image.copy()
    fault(image)
    assert contrast(image, where, original) > 100


def test_dots_of_light_are_not_cut_off():
    image = np.random.default_rng(0).normal(200, 10, (HEIGHT, WIDTH))
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    for x in range(200, 450, 30):
        for y in range(150, 350, 30):
            image += 30000 * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * 3.0**2))
    levels = to_eight_bits(np.rint(image).astype(np.uint16))
    assert levels[150, 200] > 200 and levels[165, 215] < 40
    assert levels[150, 200] > levels[150, 203] > levels[150, 206]  # a slope, no plateau


def test_noise_is_not_spread_over_all_levels():
    flat = np.random.default_rng(0).normal(30000, 20, (HEIGHT, WIDTH))
    assert to_eight_bits(np.rint(flat).astype(np.uint16)).std() < 20
    assert np.ptp(to_eight_bits(np.full((40, 40), 7, np.uint16))) == 0


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (15, 40), (17, 17)])
@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_small_images_never_crash(size, kind):
    image = np.arange(np.prod(size)).reshape(size).astype(kind)
    assert to_eight_bits(image).shape == size
