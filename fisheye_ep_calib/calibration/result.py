"""What a calibration gives back: the camera, what was used, how well it is known, and the verdict."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fisheye_ep_calib.calibration.assessing.diagnosis import Diagnosis, diagnose
from fisheye_ep_calib.calibration.assessing.stand_in import StandIn
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable, Uncertainty, projection_table
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.selecting.outliers import RejectedPoint
from fisheye_ep_calib.camera import FisheyeCamera


@dataclass(frozen=True)
class Comparison:
    """One model on the same sightings. cross_validated_rms_px: on views that it was not fitted to.

    covariance (P, P): of camera.parameters; NaN where the sightings leave some of them open.
    """

    model: str
    rms_px: float
    cross_validated_rms_px: float
    parameters: int
    camera: FisheyeCamera
    covariance: np.ndarray


@dataclass(frozen=True)
class CalibrationResult:
    """A calibrated camera and what is to be known about it.

    fit: the chosen fit. rejected: sightings left out as wrong; wrong_views: images left out whole.
    comparison: other models side by side. reasons: what was chosen and why, a line each.
    seconds: spent in "initialize" and "adjust" (the first fit of the model), "screen" (wrong sightings) and
    "compare" (the other models, cross-validation).
    """

    camera: FisheyeCamera
    fit: Fit
    uncertainty: Uncertainty
    stand_in: StandIn
    rejected: tuple[RejectedPoint, ...]
    wrong_views: tuple[int, ...]
    entrance_pupil_supported: bool
    comparison: dict[str, Comparison]
    reasons: tuple[str, ...]
    seconds: dict[str, float]

    @property
    def model(self) -> str:
        return self.fit.structure.name

    @property
    def camera_from_target(self) -> np.ndarray:
        """Poses (V, 4, 4), metres."""
        return self.fit.state.camera_from_target

    @property
    def view_images(self) -> np.ndarray:
        """Image numbers (V,) of the poses."""
        return self.fit.sightings.images

    @property
    def board_warp(self) -> np.ndarray:
        """The target's bow (w_x, w_y, w_xy), metres; zero where it was not estimated."""
        return self.fit.state.board_warp

    @property
    def rms_px(self) -> float:
        """√ mean(dx² + dy²) of the weighted residuals over the points used."""
        return self.fit.rms_px

    @property
    def views(self) -> int:
        return len(self.fit.sightings.images)

    @property
    def points(self) -> int:
        return self.fit.sightings.point_count

    @property
    def iterations(self) -> int:
        return self.fit.adjustment.iterations

    @property
    def converged(self) -> bool:
        return self.fit.adjustment.converged

    @cached_property
    def diagnosis(self) -> Diagnosis:
        """What the recording could and could not tell, and what to record more of."""
        return diagnose(self.fit, self.camera, self.fit.sightings.observations.image_names)

    @cached_property
    def projection_table(self) -> ProjectionTable:
        """Projection uncertainty by angle and distance."""
        return projection_table(self.camera, self.uncertainty, self.fit.problem.free)

    @property
    def reprojection_error(self) -> np.ndarray:
        """Predicted minus measured pixels (M, 2), by observation row; NaN in images left out."""
        return self.fit.residuals[0]
