"""Whether an image is too blurred for a target to be found in it."""

from __future__ import annotations

import cv2
import numpy as np

LONGEST_SIDE = 1400  # pixels; a larger image is reduced
FINE, COARSE = 1.5, 3.0  # pixels: the two known blurs
STRONGEST = 0.998  # quantile of the slopes that count as edges
LEAST_CONTRAST = 3.0  # grey values a pixel
MOST_BLUR = 4.5  # pixels beyond which blur is the reason


def edge_blur(image: np.ndarray) -> float:
    """σ of the blur of the strongest edges of a grey image (h, w) uint8, pixels; 0 where there are none.

    A step blurred by σ and then by s has a slope in proportion to 1/√(σ² + s²). So the ratio q of its squared
    slopes after two known blurs s, t tells σ² = (t² − q s²) / (q − 1).
    """
    factor = max(1, -(-max(image.shape) // LONGEST_SIDE))
    size = max(1, image.shape[1] // factor), max(1, image.shape[0] // factor)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    fine, coarse = (_slope(cv2.GaussianBlur(small, (0, 0), sigma)) for sigma in (FINE, COARSE))
    strong = fine >= max(float(np.quantile(fine[::2, ::2], STRONGEST)), LEAST_CONTRAST)
    if strong.sum() < 10:
        return 0.0
    ratio = max(float(np.median(fine[strong] / coarse[strong])) ** 2, 1 + 1e-3)
    result: float = factor * float(np.sqrt(max((COARSE**2 - ratio * FINE**2) / (ratio - 1), 0.0)))
    return result


def _slope(image: np.ndarray) -> np.ndarray:
    """Length of the gradient, grey values a pixel."""
    along, down = (cv2.Sobel(image, cv2.CV_32F, x, 1 - x, scale=1 / 8) for x in (1, 0))
    return cv2.magnitude(along, down)


def why_not(image: np.ndarray, reason: str) -> str:
    """The reason for an image without a detection, with what blur has to do with it."""
    blur = edge_blur(image)
    return f"blurred by about {blur:.0f} px: {reason}" if blur > MOST_BLUR else reason
