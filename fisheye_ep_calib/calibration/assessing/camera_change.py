"""What has changed since an earlier calibration of the same camera, against what both leave open.

The field is taken in two parts, inside and outside of two thirds of the angle that both cameras know. In each part the
RMS of the difference is held against the RMS of its σ, which is of both cameras' covariances. What is no property of a
camera is taken out of both: how its frame is turned and, where pupils are of two families, where its origin lies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference, camera_difference
from fisheye_ep_calib.camera import FisheyeCamera

_MIDDLE = 2 / 3  # of the largest angle
_CHANGED = 3.0  # σ
_LEAST_PX = 0.01  # less is of no account to anybody


@dataclass(frozen=True)
class CameraChange:
    """previous: the earlier camera's file. middle_px, rim_px: RMS difference in both parts of the field; middle_sigma,
    rim_sigma: the same over what is expected of an unchanged camera, NaN where a file brings no uncertainty.
    distance_m: of the points that were compared. reason: why nothing could be compared; empty where it could.
    """

    previous: str
    distance_m: float = float("nan")
    middle_px: float = float("nan")
    rim_px: float = float("nan")
    middle_sigma: float = float("nan")
    rim_sigma: float = float("nan")
    reason: str = ""

    @property
    def changed(self) -> bool:
        """Whether the difference is clear, somewhere in the field."""
        parts = ((self.middle_px, self.middle_sigma), (self.rim_px, self.rim_sigma))
        return any(px > _LEAST_PX and sigma > _CHANGED for px, sigma in parts)

    @property
    def sentence(self) -> str:
        if self.reason:
            return f"not compared with {self.previous}: {self.reason}"
        parts = [("at the rim", self.rim_px, self.rim_sigma), ("in the middle", self.middle_px, self.middle_sigma)]
        parts = [part for part in parts if np.isfinite(part[1])]
        if not any(np.isfinite(sigma) for _, _, sigma in parts):
            where, px, _ = parts[0]
            return f"against {self.previous}: {px:.2g} px {where}; neither says what is to be expected"
        where, px, sigma = max(parts, key=lambda part: part[2])
        told = f"{px:.2g} px {where}, {sigma:.1f} σ" if sigma < 10 else f"{px:.2g} px {where}, {sigma:.0f} σ"
        if self.changed:
            return f"changed against {self.previous}: {told}: was the focus or the lens touched?"
        return f"unchanged against {self.previous}: {told}"

    def to_dict(self) -> dict[str, Any]:
        """What programs read; ``changed`` is None where nothing could be compared."""
        numbers = {
            name: value if np.isfinite(value) else None
            for name in ("distance_m", "middle_px", "rim_px", "middle_sigma", "rim_sigma")
            if (value := float(getattr(self, name))) is not None
        }
        changed = None if self.reason or numbers["rim_sigma"] is None else self.changed
        return {"file": self.previous, "changed": changed, **numbers, "text": self.sentence}


def camera_change(
    previous: tuple[FisheyeCamera, np.ndarray | None],
    now: tuple[FisheyeCamera, np.ndarray | None],
    distance_m: float,
    name: str,
) -> CameraChange:
    """Two cameras, each with the covariance of its parameters or None, compared at a distance."""
    (first, first_covariance), (second, second_covariance) = previous, now
    if first.image_size != second.image_size:
        (width, height), (other_width, other_height) = first.image_size, second.image_size
        return CameraChange(name, reason=f"its images have {width}×{height} pixels, these {other_width}×{other_height}")
    # Another family puts the frame's origin elsewhere; of the same one a shift would hide a change of the focus.
    alignment = "rotation" if first.model == second.model else "rigid"
    difference = camera_difference(first, second, [distance_m], (first_covariance, second_covariance), alignment)
    if not np.isfinite(difference.length_px).any():
        return CameraChange(name, reason="the two share no part of the field")
    rim = difference.theta > _MIDDLE * min(first.theta_max, second.theta_max)
    (middle_px, middle_sigma), (rim_px, rim_sigma) = (_part(difference, part) for part in (~rim, rim))
    return CameraChange(name, distance_m, middle_px, rim_px, middle_sigma, rim_sigma)


def _part(difference: CameraDifference, chosen: np.ndarray) -> tuple[float, float]:
    """RMS length over pixels chosen (n,), px, and over its expectation."""
    length, sigma = difference.length_px[:, chosen], difference.sigma_px[:, chosen]
    there = np.isfinite(length)
    if not there.any():
        return float("nan"), float("nan")
    px = float(np.sqrt(np.mean(length[there] ** 2)))
    expected = float(np.sqrt(np.mean(sigma[there] ** 2)))
    return px, px / expected if any(difference.covariances_given) and expected > 0 else float("nan")
