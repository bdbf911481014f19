"""What a detector is and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera


def _no_pixels() -> np.ndarray:
    return np.empty((0, 2))


@dataclass(frozen=True)
class Detection:
    """The target's features found in one image.

    point_index (k,) int: rows of ``Target.object_points``, each at most once.
    pixels (k, 2) float: measured positions; the centre of the top-left pixel is (0, 0).
    reason: why nothing was found, in words a user understands; empty when something was found.
    rejected (m, 2): candidates that were looked at and refused, for the overlay.
    remark: what is to be told although something was found, such as that the file was read in another way.
    given_up: of a second look, points of the first one that their image contradicts → why.
    """

    point_index: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    pixels: np.ndarray = field(default_factory=_no_pixels)
    reason: str = ""
    rejected: np.ndarray = field(default_factory=_no_pixels)
    remark: str = ""
    given_up: Mapping[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.point_index)


class RowsOfPoints(Protocol):
    """What is asked of every target whose points stand in columns and rows: points (n, 3), metres, and their counts."""

    @property
    def object_points(self) -> np.ndarray: ...
    @property
    def columns(self) -> int: ...
    @property
    def rows(self) -> int: ...


class Detector(Protocol):
    """Finds one target. Stateless between images, so that workers can share it."""

    def detect(self, image: np.ndarray) -> Detection:
        """Find the target in a grey image (h, w) uint8 with nothing known about the camera."""
        ...

    def detect_guided(
        self,
        image: np.ndarray,
        camera: FisheyeCamera,
        camera_from_target: np.ndarray,
        first: Detection | None = None,
    ) -> Detection:
        """Find it again where a first calibration, a FisheyeCamera and a pose (4, 4), says it is.

        image: grey (h, w), uint8 or, of a deeper image, float32 in the same grey levels. first: what was found with
        nothing known; its points are measured where they were seen, and ``given_up`` says which the image contradicts.
        """
        ...


SHORTEST_SIDE, LONGEST_SIDE = 16, 20000  # pixels; the latter bounds the memory of a search
NARROWEST = 64  # longer sides over shorter: of what is more, nothing is left once it is reduced to be searched


def check_image(image: np.ndarray) -> str:
    """Why nothing can be found in this image, or an empty string. Spends nothing on an image that holds
    nothing.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.float32):
        return "not a grey image of 8 bits or in grey levels"
    if min(image.shape) < SHORTEST_SIDE:
        return "image too small"
    if max(image.shape) > NARROWEST * min(image.shape):
        return "image too narrow"
    if max(image.shape) > LONGEST_SIDE:
        return "image too large"
    sample = image[:: max(1, image.shape[0] // 256), :: max(1, image.shape[1] // 256)]
    if int(sample.max()) - int(sample.min()) < 8:
        return "image without contrast"
    return ""
