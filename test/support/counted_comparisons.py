"""Image numbers that count how many of them are compared with ==, to tell work that goes with images × sightings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations


class Counted(np.ndarray):
    """compared: elements that were compared since the class was reset."""

    compared = 0

    def __eq__(self, other: object) -> Any:
        Counted.compared += self.size
        return np.asarray(self) == np.asarray(other)

    __hash__ = None  # type: ignore[assignment]


def counted(observations: Observations) -> Observations:
    """The same sightings; ``Counted.compared`` starts from 0."""
    Counted.compared = 0
    return replace(observations, image_index=observations.image_index.view(Counted))
