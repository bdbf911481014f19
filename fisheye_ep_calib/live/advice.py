"""What a calibration still lacks, for the person who holds the target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations
from fisheye_ep_calib.calibration.assessing.diagnosis import RING_DEGREES
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.guidance import next_view
from fisheye_ep_calib.rotation import placed
from fisheye_ep_calib.target.shape.frame import board_middle

REACH = (0.7, 1.0, 1.5)  # distances that are suggested, as multiples of the least, median and largest so far


@dataclass(frozen=True)
class Advice:
    """sentence: where to hold the target next. outline (k, 2): there, its edge in the image, pixels.

    figures: coverage and concerns, JSON-ready.
    """

    sentence: str
    outline: np.ndarray
    figures: dict[str, Any]


def advise(result: CalibrationResult, observations: Observations) -> Advice:
    """From a calibration and what it was made from."""
    diagnosis = result.diagnosis
    covered = (diagnosis.counts > 0)[diagnosis.reachable]
    figures = {
        "coverage": round(float(covered.mean()), 3) if covered.size else 0.0,
        "coverage_ring_deg": RING_DEGREES,
        "coverage_counts": diagnosis.counts.tolist(),
        "concerns": [finding.sentence for finding in diagnosis.findings if finding.concern],
    }
    camera = _with_pupil(result.camera)
    poses, points = result.camera_from_target, observations.object_points
    away = np.linalg.norm(placed(poses, board_middle(points)), axis=-1)
    distances = tuple(float(part) for part in np.array([away.min(), np.median(away), away.max()]) * REACH)
    wanted = next_view(camera, points, poses, distances)
    outline = _outline(result.camera, points, wanted.camera_from_target)
    return Advice(wanted.sentence, outline, {**figures, "gain": round(wanted.gain, 3)})


def _with_pupil(camera: FisheyeCamera) -> FisheyeCamera:
    """A camera whose pupil is not supported yet still wants views that would tell."""
    if camera.coefficients:
        return camera
    return replace(camera, model="ep_even", coefficients=(0.0, 0.0))


def _outline(camera: FisheyeCamera, points: np.ndarray, camera_from_target: np.ndarray) -> np.ndarray:
    """The rectangle around the target's points as the camera would see it, pixels (k, 2), in order."""
    (left, top), (right, bottom) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
    part = np.linspace(0, 1, 12, endpoint=False)[:, None]
    edge = np.concatenate([a + part * (b - a) for a, b in zip(corners, corners[1:], strict=False)])
    in_camera = np.column_stack([edge, np.zeros(len(edge))]) @ camera_from_target[:3, :3].T
    pixels, valid = replace(camera, theta_max=np.pi).project(in_camera + camera_from_target[:3, 3])
    result: np.ndarray = pixels[valid]
    return result
