"""Two calibrations of a camera side by side: in numbers, in words and as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference
from fisheye_ep_calib.calibration.words import distance_text
from fisheye_ep_calib.target.shape.measured import BoardShape

_BEYOND_NOISE = 2.5  # times what the uncertainties lead to expect
_RING_DEGREES = 10


@dataclass(frozen=True)
class DistanceSummary:
    """At one distance, px over the field; expected_px: the RMS that the uncertainties alone lead to expect."""

    distance_m: float
    rms_px: float
    median_px: float
    p95_px: float
    largest_px: float
    expected_px: float

    @property
    def beyond_noise(self) -> bool:
        return self.rms_px > _BEYOND_NOISE * self.expected_px


def summaries(difference: CameraDifference) -> tuple[DistanceSummary, ...]:
    """One a distance; NaN where the cameras share no pixel."""
    rows = []
    for distance, length, sigma in zip(difference.distance_m, difference.length_px, difference.sigma_px, strict=True):
        finite = length[np.isfinite(length)]
        if len(finite) == 0:
            rows.append(DistanceSummary(float(distance), *[float("nan")] * 5))
            continue
        middle, high = np.quantile(finite, [0.5, 0.95])
        rows.append(
            DistanceSummary(
                float(distance), float(rms(length)), float(middle), float(high), float(finite.max()), float(rms(sigma))
            )
        )
    return tuple(rows)


def agreement(difference: CameraDifference, rows: tuple[DistanceSummary, ...]) -> tuple[bool | None, str]:
    """Whether the cameras agree within their uncertainties, None where neither brought one; and in words."""
    rows = tuple(row for row in rows if np.isfinite(row.rms_px))
    if not rows:
        return None, "The cameras share no part of the field at these distances."
    worst = max(rows, key=lambda row: row.rms_px)
    if not any(difference.covariances_given):
        text = f"They differ by up to {worst.rms_px:.3g} px RMS, at {distance_text(worst.distance_m)}"
        return None, f"{text}; neither file carries uncertainties to compare it with."
    partly = "" if all(difference.covariances_given) else " Only one of the files carries its uncertainty."
    clear = [row for row in rows if row.beyond_noise]
    if not clear:
        text = f"They agree within their uncertainties: {worst.rms_px:.3g} px RMS at most, at "
        return True, f"{text}{distance_text(worst.distance_m)}.{partly}"
    worst = max(clear, key=lambda row: row.rms_px)
    text = f"They differ by more than their uncertainties explain: {worst.rms_px:.3g} px RMS at "
    text += f"{distance_text(worst.distance_m)}, where {worst.expected_px:.3g} px is expected."
    return False, text + partly


def alignment_text(difference: CameraDifference, alignment: str) -> str:
    """What was taken out before the cameras were compared."""
    if alignment == "none":
        return "Nothing was aligned: the frames of both cameras are taken as they are."
    angle = np.degrees(np.linalg.norm(difference.rotation))
    text = f"B was turned by {angle:.4f}° to agree best over all of these distances: "
    text += "an orientation is no property of a camera."
    if alignment == "rotation":
        return text
    return f"{text} Its origin was shifted by {1e3 * np.linalg.norm(difference.shift):.4f} mm too."


@dataclass(frozen=True)
class ComparedBoards:
    """What shapes the boards had with which two cameras were calibrated; None where a file does not say.

    A camera bears the shape that its board was taken to have, so that a difference of the boards is one of the cameras.
    """

    first: BoardShape | None
    second: BoardShape | None

    @property
    def same_target(self) -> bool:
        """Whether both files tell of one target."""
        if self.first is None or self.second is None:
            return False
        return self.first.same_target(self.second.object_points)

    @property
    def difference_mm(self) -> float | None:
        """By how far apart the points are in both shapes, RMS; None of two targets."""
        if self.first is None or self.second is None or not self.same_target:
            return None
        square = ((self.first.deviation - self.second.deviation) ** 2).sum(axis=1)
        return 1e3 * float(np.sqrt(square.mean()))

    @property
    def sentence(self) -> str:
        if self.first is None and self.second is None:
            return "Neither file tells the shape of its board."
        told = "; ".join(
            f"{label}: {'its file does not tell the board' if board is None else board.sentence}"
            for label, board in (("A", self.first), ("B", self.second))
        )
        if self.difference_mm is not None:
            end = f"the same target, whose shapes differ by {self.difference_mm:.3f} mm RMS"
        elif self.first is not None and self.second is not None:
            end = "two targets"
        else:
            return f"Boards: {told}."
        return f"Boards: {told}; {end}."

    def to_dict(self) -> dict[str, Any]:
        """What programs read."""
        first, second = (None if board is None else board.to_dict() for board in (self.first, self.second))
        same = self.same_target if self.first is not None and self.second is not None else None
        return {"first": first, "second": second, "same_target": same, "difference_mm": self.difference_mm}


def comparison_content(cameras: CameraDifference, alignment: str) -> dict[str, Any]:
    """What there is to say of the difference, in numbers, texts and lists of them: ``compare --json``."""
    rows = summaries(cameras)
    theta, difference, expected = by_ring(cameras)
    agree, told = agreement(cameras, rows)
    expected_known = any(cameras.covariances_given)
    return {
        "alignment": alignment,
        "rotation_rad": cameras.rotation.tolist(),
        "shift_m": cameras.shift.tolist(),
        "theta_max_deg": float(np.degrees(cameras.theta.max())),
        "agree": agree,
        "verdict": told,
        "theta_deg": theta.tolist(),
        "distances": [
            {
                "distance_m": row.distance_m,
                "rms_px": row.rms_px,
                "median_px": row.median_px,
                "p95_px": row.p95_px,
                "max_px": row.largest_px,
                "expected_rms_px": row.expected_px if expected_known else None,
                "rms_by_theta_px": difference[index].tolist(),
                "expected_rms_by_theta_px": expected[index].tolist() if expected_known else None,
            }
            for index, row in enumerate(rows)
        ],
    }


def by_ring(cameras: CameraDifference) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles of rings (r,), degrees, and RMS over each of the difference and of its expectation (d, r), px."""
    ring = (np.degrees(cameras.theta) // _RING_DEGREES).astype(int)
    rings = np.unique(ring)
    columns = [ring == number for number in rings]
    difference = np.stack([rms(cameras.length_px[:, column]) for column in columns], axis=-1)
    expected = np.stack([rms(cameras.sigma_px[:, column]) for column in columns], axis=-1)
    return _RING_DEGREES * (rings + 0.5), difference, expected


def rms(values: np.ndarray) -> np.ndarray:
    """Over the last axis, NaN left out; NaN where nothing is left."""
    finite = np.isfinite(values)
    square = np.where(finite, values, 0.0) ** 2
    count = finite.sum(axis=-1)
    return np.where(count > 0, np.sqrt(square.sum(axis=-1) / np.maximum(count, 1)), np.nan)
