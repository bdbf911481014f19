"""What every target has in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fisheye_ep_calib.target.detection import Detector
from fisheye_ep_calib.target.schema import Keys
from fisheye_ep_calib.target.shape.measured import BoardShape


def _no_discs() -> np.ndarray:
    return np.empty((0, 3))


def _no_quads() -> np.ndarray:
    return np.empty((0, 4, 2))


@dataclass(frozen=True)
class Artwork:
    """What is printed, in the plane z = 0 of the target frame (metres), black on white, in painter's order.

    low, high (2,): corners of the white board. quads (q, 4, 2): black quadrilaterals. discs (d, 3): black x,
    y, radius. holes (h, 3): white x, y, radius, on top of the discs.
    """

    low: np.ndarray
    high: np.ndarray
    quads: np.ndarray = field(default_factory=_no_quads)
    discs: np.ndarray = field(default_factory=_no_discs)
    holes: np.ndarray = field(default_factory=_no_discs)


@dataclass(frozen=True, eq=False)
class Target:
    """A flat calibration target.

    name: the file's name, or what the file says. object_points (n, 3): metres, z = 0; x to the right and y
    down as one looks at the print, or up where ``y_up``. disc_radius: metres where the
    features are the centres of gravity of projected discs, else None. shape: as it was measured before, where the
    file says so. keys: of the file that the target was read from, without its shape.
    """

    name: str
    object_points: np.ndarray
    disc_radius: float | None
    shape: BoardShape | None = field(default=None, kw_only=True)
    keys: Mapping[str, Any] = field(default_factory=dict, kw_only=True)

    kind = "target"  # the file's ``type``
    y_up = False  # as one looks at the print
    least_feature_px = 5.5  # across, of ``smallest_feature`` in a sharp image: with less, points are lost
    kalibr_kind = ""  # Kalibr's ``target_type``; empty where Kalibr has no such target

    @staticmethod
    def from_keys(keys: Keys, name: str) -> Target:
        """The target of this project's keys. Raises InputError."""
        raise NotImplementedError

    @staticmethod
    def from_kalibr(keys: Keys, name: str) -> Target:
        """The target of Kalibr's keys, where it has a ``kalibr_kind``. Raises InputError."""
        raise NotImplementedError

    @property
    def unmistakable(self) -> bool:
        """Whether no detector can take the target for itself turned."""
        return False

    @property
    def smallest_feature(self) -> float:
        """Metres across of what a detector must see of each point: a square between two corners, a disc, a marker."""
        points = self.object_points[:200]  # of a large board, part of it
        apart = np.linalg.norm(points[:, None] - points, axis=-1)
        return float(apart[apart > 0].min())

    def detector(self) -> Detector:
        """A detector for this target; raises InputError where the machine lacks what it needs."""
        raise NotImplementedError

    def artwork(self) -> Artwork:
        """What to print."""
        raise NotImplementedError


def bounding_board(points: np.ndarray, margin: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,), (2,) of the board around points (n, 2 or 3) with a margin, metres (one, or x and y)."""
    return points[:, :2].min(axis=0) - margin, points[:, :2].max(axis=0) + margin


def rectangular_grid(columns: int, rows: int, step_x: float, step_y: float) -> np.ndarray:
    """Points (rows·columns, 3): index = row·columns + column, x = column·step_x, y = row·step_y."""
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    points = np.stack([column * step_x, row * step_y, np.zeros_like(column, dtype=float)], axis=-1)
    return points.reshape(-1, 3).astype(float)
