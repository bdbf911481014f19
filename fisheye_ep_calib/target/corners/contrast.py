"""Dark and faint images, with their grey values spread over the whole range.

The detectors of corners and markers, and the fits, ask for some grey values of contrast; fewer do where there is little
noise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fisheye_ep_calib.target.detection import Detection

SMALL_RANGE = 128.0  # grey values: an image that spans no more is stretched
LOW, HIGH = 0.5, 99.5  # percentiles: lamps and dead pixels are no part of the range
ROOM = 0.1  # of the range, left at both ends: light that varies over the board must not saturate
LEAST_RANGE = 4.0  # grey values: the rounding of less is no picture
SAMPLES = 512  # pixels a side to tell the range from


def stretched(image: np.ndarray, part: np.ndarray | None = None) -> np.ndarray:
    """A grey image (h, w), uint8 or float32, with the range of its part (all of it if None) spread over 0 to 255.

    The image itself where its range is not small, or nothing.
    """
    part = image if part is None else part
    sample = part[:: max(1, part.shape[0] // SAMPLES), :: max(1, part.shape[1] // SAMPLES)]
    low, high = np.percentile(sample, (LOW, HIGH)) if sample.size else (0.0, 0.0)
    if not LEAST_RANGE <= high - low < SMALL_RANGE:
        return image
    low, high = low - ROOM * (high - low), high + ROOM * (high - low)
    if image.dtype == np.float32:
        wide: np.ndarray = ((image - np.float32(low)) * np.float32(255 / (high - low))).clip(0, 255)
        return wide
    table = np.rint((np.arange(256) - low) * (255 / (high - low))).clip(0, 255).astype(np.uint8)
    result: np.ndarray = table[image]
    return result


def detect_stretched(detect: Callable[[np.ndarray], Detection], image: np.ndarray) -> Detection:
    """What ``detect`` finds in the stretched image or, where it is nothing, in the image itself.

    A board that is small and brighter than all else lies beyond the percentiles, and is saturated when stretched.
    """
    wide = stretched(image)
    detection = Detection() if wide is image else detect(wide)
    return detection if len(detection) else detect(image)
