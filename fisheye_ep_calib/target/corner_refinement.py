"""Sub-pixel saddle corners: where two black and two white quadrants meet."""

from __future__ import annotations

import cv2
import numpy as np

WINDOWS = np.array([2, 3, 4, 5, 7, 9, 12])
CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.002)


def refine_corners(image: np.ndarray, pixels: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move corners (k, 2) onto the saddle point near them (cv2.cornerSubPix).

    reach (k,): how far, in pixels, the pattern around each corner consists of nothing but its four quadrants;
    the window stays inside. Returns the positions (k, 2) and whether each stayed near its start (k,).
    """
    refined = np.array(pixels, dtype=np.float32).reshape(-1, 1, 2)
    height, width = image.shape
    choice = np.clip(np.searchsorted(WINDOWS, reach, side="right") - 1, 0, len(WINDOWS) - 1)
    inside = ((pixels >= 0) & (pixels <= [width - 1, height - 1])).all(axis=1)
    for number in np.unique(choice[inside]):
        chosen = np.flatnonzero(inside & (choice == number))
        window = int(min(WINDOWS[number], (min(height, width) - 6) // 2))
        if window < 1:
            continue
        refined[chosen] = cv2.cornerSubPix(
            image, np.ascontiguousarray(refined[chosen]), (window, window), (-1, -1), CRITERIA
        ).reshape(-1, 1, 2)
    refined = refined.reshape(-1, 2).astype(float)
    moved = np.hypot(*(refined - pixels).T)
    return refined, inside & (moved <= np.maximum(1.0, 0.5 * reach))
