"""A target's shape as it was measured: by how much its points depart from its file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.target.shape.basis import smooth_fields
from fisheye_ep_calib.target.shape.bow import nearest_bow
from fisheye_ep_calib.target.shape.faces import faces_of
from fisheye_ep_calib.target.shape.frame import BoardFrame, board_frame
from fisheye_ep_calib.target.shape.model import FLAT, LOCAL

_LOCAL_DEGREE = 4  # of the smooth fields that say how discs of a shape given by its points are tilted
_SAME = 1e-6  # metres: targets whose points agree to this are one
_TOLD = 0.005  # mm and %: what is less is not worth a word


def known_board(boards: Iterable[BoardShape | None], object_points: np.ndarray | None = None) -> BoardShape | None:
    """Of what several calibrations found of one target the shape that is known best; None where none is known.

    object_points (n, 3): of the target's file; shapes of other targets are passed over.
    """
    candidates = [
        board
        for board in boards
        if board is not None and board.bends and (object_points is None or board.same_target(object_points))
    ]
    return min(candidates, key=lambda board: np.inf if board.sigma is None else float(board.sigma.mean()), default=None)


@dataclass(frozen=True)
class BoardShape:
    """object_points (n, 3): as the file has them, metres. deviation (n, 3): what is to be added to them, metres.

    kind: "flat", "bow" or "free". sigma (n, 3): its standard deviations, metres; None where they are not known.
    bent: whether the data demand a height that varies over the board. scatter (3,): what single points are off by
    themselves along the board's x, y and normal, τ in metres. groups: τ of the smooth fields by name, metres.
    slopes (n, 6): derivatives of the smooth deviation along the board's x, then y; worked out where they are None.
    discs: whether the points are the centres of discs. aspect_sigma_percent: of ``aspect_percent``; 0 where it is not
    known.
    """

    kind: str
    object_points: FloatArray
    deviation: FloatArray
    sigma: np.ndarray | None = None
    bent: bool = False
    scatter: tuple[float, float, float] = (0.0, 0.0, 0.0)
    groups: Mapping[str, float] = field(default_factory=dict)
    slopes: np.ndarray | None = None
    discs: bool = False
    aspect_sigma_percent: float = 0.0

    @staticmethod
    def flat(object_points: np.ndarray) -> BoardShape:
        return BoardShape(FLAT, object_points, np.zeros_like(object_points))

    @property
    def points(self) -> np.ndarray:
        """Where the points are (n, 3), metres."""
        return self.object_points + self.deviation

    @property
    def bends(self) -> bool:
        """Whether any point departs from its file."""
        return bool(np.any(self.deviation))

    def same_target(self, object_points: np.ndarray) -> bool:
        """Whether points (n, 3) of a file are those of this target's file."""
        return self.object_points.shape == object_points.shape and bool(
            np.abs(self.object_points - object_points).max() < _SAME
        )

    @cached_property
    def frame(self) -> BoardFrame:
        return board_frame(self.object_points)

    @cached_property
    def in_board_axes(self) -> np.ndarray:
        """deviation (n, 3) along the x, y and normal of each point's face, metres."""
        turned = self.deviation @ self.frame.axes
        if not self.frame.planar:
            for face in faces_of(self.object_points):
                turned[face] = self.deviation[face] @ board_frame(self.object_points[face]).axes
        return turned

    @property
    def local(self) -> np.ndarray:
        """Shift of every point and its derivatives along x and y, (n, LOCAL), target frame (model.py)."""
        slopes = self._fitted_slopes() if self.slopes is None else self.slopes
        return np.concatenate([self.deviation, slopes], axis=1)

    def _fitted_slopes(self) -> np.ndarray:
        """Slopes (n, 6) of the smooth fields of low degree that come nearest to the deviation."""
        if not self.bends or not self.frame.planar:
            return np.zeros((len(self.deviation), LOCAL - 3))
        fields = smooth_fields(self.frame, self.object_points, np.ones(len(self.deviation), bool), _LOCAL_DEGREE)
        flat = fields.value.reshape(-1, fields.value.shape[-1])
        coefficients = np.linalg.lstsq(flat, self.in_board_axes.reshape(-1), rcond=None)[0]
        slopes: FloatArray = ((fields.slope @ coefficients) @ self.frame.axes.T).reshape(-1, LOCAL - 3)
        return slopes

    @property
    def bow(self) -> np.ndarray:
        """w_x, w_y, w_xy (3,), metres, of the nearest bow (bow.py)."""
        if not self.bends or not self.frame.planar:
            return np.zeros(3)
        return nearest_bow(self.frame, self.object_points, self.in_board_axes[:, 2])

    @property
    def height_rms_mm(self) -> float:
        return 1e3 * float(np.sqrt((self.in_board_axes[:, 2] ** 2).mean()))

    @property
    def in_plane_rms_mm(self) -> float:
        return 1e3 * float(np.sqrt((self.in_board_axes[:, :2] ** 2).sum(axis=1).mean()))

    @property
    def rough_rms_mm(self) -> float:
        """Root mean square of what single points are off by themselves."""
        return 1e3 * float(np.linalg.norm(self.scatter))

    @property
    def rough_in_plane_mm(self) -> float:
        """The same of the shifts in the plane."""
        return 1e3 * float(np.hypot(*self.scatter[:2]))

    @property
    def distortion_rms_mm(self) -> float:
        """Root mean square of the shifts in the plane once the aspect is taken out: shear, and what is not linear."""
        if not self.frame.planar:
            return 0.0
        position, stretch = self._stretch
        left = self.in_board_axes[:, :2] - stretch * position
        return 1e3 * float(np.sqrt((left**2).sum(axis=1).mean()))

    @property
    def bow_mm(self) -> float:
        """Height from the lowest to the highest point."""
        return 1e3 * float(np.ptp(self.in_board_axes[:, 2]))

    @property
    def aspect_percent(self) -> float:
        """By how much the board is longer along its x than along its y, against its file."""
        if not self.frame.planar:
            return 0.0
        _, stretch = self._stretch
        return 100 * float(stretch[0] - stretch[1])

    @property
    def aspect_weights(self) -> np.ndarray:
        """w (n, 3), 1/m, target frame: ``aspect_percent`` is 100 Σ w · deviation."""
        position, square = self._arms
        weights: FloatArray = (position / square * [1.0, -1.0]) @ self.frame.axes[:, :2].T
        return weights

    @property
    def _arms(self) -> tuple[np.ndarray, np.ndarray]:
        """The file's points (n, 2) about their mean, metres, and the sum of their squares (2,)."""
        position = self.frame.local(self.object_points)[:, :2]
        position = position - position.mean(axis=0)
        return position, np.maximum((position**2).sum(axis=0), 1e-300)

    @property
    def _stretch(self) -> tuple[np.ndarray, np.ndarray]:
        """``_arms``' points (n, 2), and the share (2,) by which the board is longer along x and y, by least squares."""
        position, square = self._arms
        return position, (position * self.in_board_axes[:, :2]).sum(axis=0) / square

    @property
    def sentence(self) -> str:
        """What a person should know of it."""
        if self.kind == FLAT:
            return "the board is taken as its file has it"
        told = []
        aspect = self.aspect_percent
        if abs(aspect) >= max(_TOLD, 2 * self.aspect_sigma_percent):
            first, second = ("x", "y") if aspect > 0 else ("y", "x")
            told.append(f"against its file the paper is {abs(aspect):.2f} % longer in {first} than in {second}")
        doubt = 0.0 if self.sigma is None else 2e3 * float(np.sqrt((self.sigma**2).mean()))
        if self.distortion_rms_mm >= max(_TOLD, self.rough_in_plane_mm, doubt):
            told.append(f"distorted in its plane by {self.distortion_rms_mm:.2f} mm RMS")
        if self.bow_mm >= _TOLD:
            told.append(f"{'bent' if self.bent else 'not flat, if at all,'} by {self.bow_mm:.2f} mm")
        if self.rough_rms_mm >= _TOLD:
            told.append(f"{'discs' if self.discs else 'corners'} scatter by {self.rough_rms_mm:.2f} mm")
        return "; ".join(told) or "the board is as its file has it"

    def to_dict(self) -> dict[str, Any]:
        """The numbers that programs read."""
        return {
            "shape": self.kind,
            "bent": self.bent,
            "height_rms_mm": self.height_rms_mm,
            "in_plane_rms_mm": self.in_plane_rms_mm,
            "rough_rms_mm": self.rough_rms_mm,
            "aspect_percent": self.aspect_percent,
        }
