"""What a camera's frames have shown of its images: how far light reaches, how sharp the target is."""

from __future__ import annotations

import threading
from collections import deque

import numpy as np

from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.planning.detectability import Sight

_DARK = 0.12  # of the brightest parts: what stays darker than that in all frames is outside of the image circle
_BRIGHT = 0.9  # quantile that counts as the brightest parts
_BLURS = 25  # sightings whose median blur counts


class Seeing:
    """Gathered from every frame that was searched; safe to use from several threads."""

    def __init__(self) -> None:
        self._light: np.ndarray | None = None
        self._blurs: deque[float] = deque(maxlen=_BLURS)
        self._image_size: tuple[int, int] | None = None
        self._lock = threading.Lock()

    @property
    def image_size(self) -> tuple[int, int] | None:
        """Of the last frame."""
        return self._image_size

    def take(self, sighting: Sighting) -> None:
        with self._lock:
            self._image_size = sighting.image_size
            if np.isfinite(sighting.blur):
                self._blurs.append(sighting.blur)
            light = sighting.light
            if light is None:
                return
            if self._light is None or self._light.shape != light.shape:
                self._light = light
            else:
                self._light = np.maximum(self._light, light)

    def sight(self) -> Sight:
        """As far as it is known by now; where nothing is, all of the image is lit and sharp."""
        with self._lock:
            light = np.ones((1, 1), dtype=np.uint8) if self._light is None else self._light
            blur = float(np.median(self._blurs)) if self._blurs else 1.0
        return Sight(light > _DARK * np.quantile(light, _BRIGHT), blur)

    def forget(self) -> None:
        with self._lock:
            self._light = None
            self._blurs.clear()
