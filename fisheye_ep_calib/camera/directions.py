"""Directions as an incidence angle and an azimuth."""

from __future__ import annotations

import numpy as np


def direction(theta: float | np.ndarray, azimuth: float | np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) = (sinθ cosφ, sinθ sinφ, cosθ), in the camera frame.

    theta: rad, from the axis; azimuth φ: rad, from x towards y.
    """
    theta, azimuth = np.broadcast_arrays(np.asarray(theta, dtype=float), azimuth)
    sine = np.sin(theta)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)], axis=-1)
