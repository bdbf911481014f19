"""Colour maps, and what a number's place in one is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.arrays import FloatArray

# Cynthia Brewer's red–yellow–blue (colorbrewer2.org, 11 classes), from low to high.
_BLUE_RED = (
    ((49, 54, 149), (69, 117, 180), (116, 173, 209), (171, 217, 233), (224, 243, 248), (255, 255, 191))
    + ((254, 224, 144), (253, 174, 97), (244, 109, 67), (215, 48, 39), (165, 0, 38))
)  # fmt: skip


@dataclass(frozen=True)
class Colouring:
    """Numbers as colours. name: "viridis", "RdYlBu_r", or one colour "#rrggbb". logarithmic: as log₁₀ of them.

    levels: where colours change, of a map in steps; the last step is of all that is more.
    """

    name: str
    low: float
    high: float
    logarithmic: bool = False
    levels: tuple[float, ...] = ()

    def rgb(self, values: np.ndarray) -> np.ndarray:
        """(..., 3) uint8, whatever there is at NaN."""
        table = colour_table(self.name)
        with np.errstate(invalid="ignore", divide="ignore"):
            if self.levels:
                step = np.searchsorted(np.array(self.levels), values, side="right") - 1
                share = np.clip(step, 0, len(self.levels) - 1) / max(len(self.levels) - 1, 1)
            elif self.logarithmic:
                share = np.log(values / self.low) / np.log(self.high / self.low)
            else:
                share = (values - self.low) / max(self.high - self.low, 1e-300)
        index = np.clip(np.nan_to_num(np.asarray(share)) * 256, 0, 255).astype(int)
        return np.asarray(table[index])


def colour_table(name: str) -> np.ndarray:
    """(256, 3) uint8, RGB."""
    if name.startswith("#"):
        return np.tile(rgb_of(name), (256, 1))
    if name == "viridis":
        ramp = np.arange(256, dtype=np.uint8)[:, None]
        return np.asarray(cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS)[:, 0, ::-1])
    colours: FloatArray = np.array(_BLUE_RED, float)
    at, place = np.linspace(0, len(colours) - 1, 256), np.arange(len(colours))
    return np.stack([np.interp(at, place, colours[:, channel]) for channel in range(3)], axis=-1).astype(np.uint8)


def rgb_of(colour: str) -> np.ndarray:
    """(3,) uint8 of "#rrggbb"."""
    return np.array([int(colour[start : start + 2], 16) for start in (1, 3, 5)], np.uint8)
