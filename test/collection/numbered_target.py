"""A target whose place is written in the image's first pixels, so that a detector need not be trusted."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.target.base import Target, rectangular_grid
from fisheye_ep_calib.target.detection import Detection

ABSENT, PRESENT, CRASHES, KILLS, INTERRUPTS, SLOW, ENDLESS = range(7)


@dataclass(frozen=True, eq=False)
class NumberedTarget(Target):
    def detector(self):
        return NumberedDetector(self.object_points)


@dataclass(frozen=True)
class NumberedDetector:
    object_points: np.ndarray

    def detect(self, image):
        kind, x, y, size = (int(value) for value in image[0, :4])
        if kind == ABSENT:
            return Detection(reason="no target here")
        if kind == CRASHES:
            raise ValueError("strange\nimage")
        if kind == KILLS:
            os._exit(9)
        if kind == INTERRUPTS:
            raise KeyboardInterrupt
        if kind == SLOW:
            time.sleep(0.2)
        while kind == ENDLESS:
            pass
        pixels = np.array([x, y]) + size * (self.object_points[:, :2] + [[0.1, 0.2]])
        return Detection(np.arange(len(pixels)), pixels)

    def detect_guided(self, image, camera, camera_from_target):
        first = self.detect(image)
        if camera == "nothing":
            return Detection(reason="not there")
        return Detection(first.point_index, first.pixels + camera_from_target[:2, 3])


TARGET = NumberedTarget("numbered", rectangular_grid(4, 3, 1.0, 1.0), None)


def picture(kind=PRESENT, x=20, y=20, size=5, shape=(60, 80)) -> np.ndarray:
    image = np.zeros(shape, np.uint8)
    image[0, :4] = kind, x, y, size
    return image
