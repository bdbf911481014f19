"""What a calibration comes to: the camera, its file, its CameraInfo and the figures that are told about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations, calibrate
from fisheye_ep_calib.calibration.assessing.uncertainty import projection_uncertainty
from fisheye_ep_calib.calibration.content import calibration_content
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import entrance_pupil_band
from fisheye_ep_calib.camera.camera_info import PlainCameraInfo, plain_camera_info
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.live.advice import GOAL_ANGLE, Advice, advise
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board, Sight
from fisheye_ep_calib.planning.guidance import Suggestion
from fisheye_ep_calib.storage.camera_file import camera_text, camera_yaml, read_camera_file
from fisheye_ep_calib.target.shape.measured import BoardShape

PUPIL_ANGLES = (30, 60, 80)  # degrees at which E(θ) and its band are told
# What is told of a calibration, by the names that every JSON of the package has for it (calibration/content.py).
TOLD = (
    "model",
    "rms_px",
    "views",
    "points",
    "rejected_points",
    "entrance_pupil_supported",
    "entrance_pupil",
    "converged",
    "noise_px",
    "svp_loss_px",
    "findings",
)
DISTANCES = (0.15, 10.0)  # metres at which the projection's uncertainty is taken


@dataclass(frozen=True)
class Outcome:
    """stand_in: the camera of CameraInfo. yaml: the camera's file.

    figures: JSON-ready; those of a calibration have more than those of a file.

    advice: what is still lacking; None where nothing is known about it.
    uncertainty_px: RMS over the field of the projection's standard deviation, px per axis; NaN where unknown.
    covariance (P, P): of the camera's parameters; zero, or None, where unknown.
    board: the target's shape as it was found.
    """

    camera: FisheyeCamera
    stand_in: FisheyeCamera
    yaml: str
    info: PlainCameraInfo
    figures: dict[str, Any]
    advice: Advice | None = None
    uncertainty_px: float = np.nan
    covariance: np.ndarray | None = None
    board: BoardShape | None = None

    @property
    def pupil_band_mm(self) -> float:
        """Standard deviation of E at GOAL_ANGLE; infinite where the model has no pupil or was not seen so far out."""
        if not self.camera.coefficients:
            return np.inf
        result: float = self.figures.get("entrance_pupil_mm", {}).get(str(GOAL_ANGLE), (0.0, np.inf))[1]
        return result

    def worse_than(self, other: Outcome) -> bool:
        """Whether a calibration from more views knows clearly less than an earlier one of the same model.

        Of another model it is taken: what more views decide about the model weighs more.
        """
        return self.camera.model == other.camera.model and self.uncertainty_px > 1.1 * other.uncertainty_px


def calibrate_views(
    observations: Observations,
    model: str,
    name: str,
    source: str,
    board: Board,
    sight: Sight = EVERYWHERE,
    tried: tuple[Suggestion, ...] = (),
    options: Mapping[str, Any] | None = None,
) -> Outcome:
    """Calibrate camera ``name``; what a worker process runs. board, sight, tried: for the advice. options: of
    ``calibrate``.

    Raises CalibrationError.
    """
    result = calibrate(observations, model=model, **(options or {}))
    spread = uncertainty_px(result)
    return Outcome(
        camera=result.camera,
        stand_in=result.stand_in.camera,
        yaml=camera_yaml(result, name, source),
        info=plain_camera_info(result.stand_in.camera),
        figures=_figures(result, spread),
        advice=advise(result, observations, board, sight, tried),
        uncertainty_px=spread,
        covariance=result.uncertainty.covariance,
        board=result.board,
    )


def outcome_of_file(path: Path) -> Outcome:
    """An existing camera file, to publish as it is; another program's as a file of this package. Raises InputError."""
    file = read_camera_file(path)
    facts = {name: file.calibration[name] for name in TOLD if name in file.calibration}
    figures = {"model": file.camera.model, "camera_file": str(path), **facts, **_curves(file.camera, file.covariance)}
    return Outcome(
        camera=file.camera,
        stand_in=file.stand_in,
        yaml=camera_yaml(file.camera, file.name) if file.origin else camera_text(path),
        info=plain_camera_info(file.stand_in),
        figures=figures,
        covariance=file.covariance,
        board=file.board,
    )


def uncertainty_px(result: CalibrationResult) -> float:
    """RMS of the projection's standard deviation, px per axis, over the field that was seen, near and far."""
    theta, azimuth = np.meshgrid(
        np.linspace(0.05, 0.95, 10) * result.camera.theta_max, np.linspace(0, 2 * np.pi, 8, endpoint=False)
    )
    directions = direction(theta, azimuth).reshape(-1, 3)
    points = np.concatenate([distance * directions for distance in DISTANCES])
    sigma = projection_uncertainty(result.camera, result.uncertainty, result.fit.problem.free, points)
    return float(np.sqrt(np.mean(sigma[np.isfinite(sigma)] ** 2)))


def _figures(result: CalibrationResult, spread: float) -> dict[str, Any]:
    return {
        **calibration_content(result, TOLD),
        "views_used": result.views,  # what ``views`` was called here before
        "uncertainty_px": round(spread, 4) if np.isfinite(spread) else None,
        **_curves(result.camera, result.uncertainty.covariance),
    }


def _curves(camera: FisheyeCamera, covariance: np.ndarray) -> dict[str, Any]:
    """E and its band at some angles, of the field that was seen, as ``show`` tells them."""
    angles = np.array([angle for angle in PUPIL_ANGLES if np.radians(angle) <= camera.theta_max])
    shift, sigma, whose = entrance_pupil_band(camera, covariance, np.radians(angles))
    return {
        "theta_max_deg": round(float(np.degrees(camera.theta_max)), 1),
        "entrance_pupil_mm": {
            str(angle): [round(1e3 * float(value), 4), round(1e3 * float(band), 4)]
            for angle, value, band in zip(angles, shift, sigma, strict=True)
        },
        "E_from": whose,
    }
