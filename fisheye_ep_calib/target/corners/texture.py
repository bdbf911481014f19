"""Whether an image is full of corners: a texture, in which looking for a board takes without end."""

from __future__ import annotations

import cv2
import numpy as np

MOST_CORNERS = 60_000  # of an image; boards have some hundreds
LEAST_SADDLE = 500.0  # of −det H by Sobel's operators: a corner with 30 grey values of contrast; above noise of 10
_ROWS, _MARGIN = 512, 4  # of a strip, so that memory does not grow with the image


def has_corners_everywhere(image: np.ndarray) -> bool:
    """Whether a grey image (h, w) has more saddle points than any board has corners.

    A saddle is a local minimum of det H = I_xx I_yy − I_xy², which is negative there (Beaudet, "Rotationally invariant
    image operators", 1978); the derivatives are Sobel's, of the image smoothed by σ = 1 px.
    """
    found = 0
    for top in range(0, image.shape[0], _ROWS):
        first = max(0, top - _MARGIN)
        smooth = cv2.GaussianBlur(image[first : top + _ROWS + _MARGIN], (5, 5), 1.0)
        xx, yy, xy = (cv2.Sobel(smooth, cv2.CV_32F, *order) for order in ((2, 0), (0, 2), (1, 1)))
        determinant = xx * yy - xy * xy
        lowest = cv2.erode(determinant, np.ones((5, 5), np.uint8))
        saddles = (determinant == lowest) & (determinant < -LEAST_SADDLE)
        found += int(np.count_nonzero(saddles[top - first : top - first + _ROWS]))
        if found > MOST_CORNERS:
            return True
    return False
