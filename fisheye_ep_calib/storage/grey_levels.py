"""Images of 16 bits and of real numbers → 8 bits: the range that the scene fills, not what one hot pixel says.

Cameras of 10 to 14 bits fill 16-bit images without shifting, thermal ones around an offset. A range from the least to
the greatest sample is that of a hot pixel, or of the lines of data that sensors put above and below their image; one
from percentiles over everything depends on how much of the sensor the lens leaves dark.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_BORDER = 0.02  # of the rows: where sensors put their lines of data
_SAMPLES = 1 << 16
_DARK, _BRIGHTEST = 0.5, 99.9  # percentiles of all
_FLOOR = 0.02  # of that range: what is not brighter lies outside of the image circle, or is black
_HIGHEST, _USUAL = 99.5, 95.0  # percentiles of what is brighter
_MARGIN = 0.05  # of the range, left free at each end
_LAMP = 4.0  # times as bright as what is usual is a lamp, and gets the uppermost levels
_KNEE_LEVEL = 215.0  # grey level from which on lamps lie
_LEAST_RANGE = 1 / 64  # of the highest value: less is noise, and not spread over all levels


class Range(NamedTuple):
    """low, high: values that become 0 and 255. knee: value that becomes _KNEE_LEVEL; high where there is no lamp."""

    low: float
    knee: float
    high: float


def to_eight_bits(grey: np.ndarray) -> np.ndarray:
    """Grey values (h, w) of 8 or 16 bits or real ones → uint8; 8 bits as they are.

    Linear over the range of the scene and, where there is a lamp in it, from there on linear with less slope. What is
    not finite is black.
    """
    if grey.dtype == np.uint8:
        return grey
    grey = _finite(grey)
    scene = scene_range(grey)
    if grey.dtype == np.uint16:  # a table costs less than calculating every pixel
        table = _levels(np.arange(1 << 16, dtype=np.float32), scene)
        return np.take(np.rint(table).astype(np.uint8), grey)
    result: np.ndarray = np.rint(_levels(grey, scene)).astype(np.uint8)
    return result


def to_levels(grey: np.ndarray) -> np.ndarray:
    """For measuring: what ``to_eight_bits`` gives without its rounding, float32, and with lamps beyond 255.

    Grey values of 8 bits as they are.
    """
    if grey.dtype == np.uint8:
        return grey
    grey = _finite(grey)
    scene = scene_range(grey)
    top = _KNEE_LEVEL if scene.knee < scene.high else 255.0
    slope = np.float32(top / (scene.knee - scene.low))
    levels: np.ndarray = grey.astype(np.float32)  # changed in place: large images have several copies as it is
    levels -= np.float32(scene.low)
    with np.errstate(over="ignore"):  # of a hot pixel
        levels *= slope
    return levels


def _finite(grey: np.ndarray) -> np.ndarray:
    """uint16 as it is; real numbers as float32, what is not finite among them the least or the greatest that is."""
    if grey.dtype == np.uint16:
        return grey
    grey = np.nan_to_num(grey.astype(np.float32, copy=False), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    finite = grey[np.isfinite(grey)]
    return np.clip(grey, finite.min(), finite.max()) if len(finite) else np.zeros(grey.shape, np.float32)


def _levels(values: np.ndarray, scene: Range) -> np.ndarray:
    """Grey levels from 0 to 255: of two lines the lower one, for the one beyond the knee is less steep."""
    top = _KNEE_LEVEL if scene.knee < scene.high else 255.0
    levels = (values - scene.low) * (top / (scene.knee - scene.low))
    if scene.knee < scene.high:
        beyond = top + (values - scene.knee) * ((255.0 - top) / (scene.high - scene.knee))
        levels = np.minimum(levels, beyond)
    return np.clip(levels, 0, 255)


def scene_range(grey: np.ndarray) -> Range:
    """The range of the scene in an image (h, w), uint16 or finite float32; low < knee <= high."""
    sample = _without_hot_pixels(grey)
    low, top = np.percentile(sample, (_DARK, _BRIGHTEST))
    bright = sample[sample > low + _FLOOR * (top - low)]
    usual, high = np.percentile(bright, (_USUAL, _HIGHEST)) if len(bright) else (top, top)
    least = max(_LEAST_RANGE * abs(high), 1e-12 if grey.dtype != np.uint16 else 16.0)
    if high - low < least:
        middle = 0.5 * (low + high)
        return Range(middle - 0.5 * least, middle + 0.5 * least, middle + 0.5 * least)
    margin = _MARGIN * (min(high, low + _LAMP * (usual - low)) - low)
    if high - low > _LAMP * (usual - low) > 0:
        return Range(low - margin, usual + (usual - low) * 0.25, high)
    return Range(low - margin, high + margin, high + margin)


def _without_hot_pixels(grey: np.ndarray) -> np.ndarray:
    """Medians (n,) of 3 × 3 pixels all over the image but its first and last rows: no few hot pixels show there."""
    height, width = grey.shape
    if min(height, width) < 16:
        return grey.astype(np.float64).ravel()
    border = 1 + int(_BORDER * height)
    stride = max(1, int(np.sqrt(grey.size / _SAMPLES)))
    rows, columns = np.arange(border, height - border, stride), np.arange(1, width - 1, stride)
    around = [grey[np.ix_(rows + down, columns + right)] for down in (-1, 0, 1) for right in (-1, 0, 1)]
    result: np.ndarray = np.partition(np.stack(around), 4, axis=0)[4].astype(np.float64).ravel()
    return result
