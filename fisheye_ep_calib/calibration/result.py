"""What a calibration gives back: the camera, what was used, how well it is known, and the verdict.

Only the fit is made by the calibration itself. Everything that judges it is worked out when it is first looked at.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fisheye_ep_calib.calibration.assessing.board import board_shape
from fisheye_ep_calib.calibration.assessing.diagnosis import Diagnosis, diagnose
from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget, error_budget
from fisheye_ep_calib.calibration.assessing.family_spread import with_family_spread
from fisheye_ep_calib.calibration.assessing.left_open import LeftOpen, pupil_left_open, with_pupil_sigma
from fisheye_ep_calib.calibration.assessing.stand_in import StandIn, single_viewpoint
from fisheye_ep_calib.calibration.assessing.uncertainty import (
    ProjectionTable,
    Uncertainty,
    projection_table,
    uncertainty,
)
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.selecting.candidates import Candidate
from fisheye_ep_calib.calibration.selecting.model_selection import Choice
from fisheye_ep_calib.calibration.selecting.outliers import RejectedPoint
from fisheye_ep_calib.calibration.selecting.pupil_choice import beside_named, pupil_verdict, side_by_side
from fisheye_ep_calib.calibration.selecting.pupil_verdict import SUPPORTED, PupilVerdict
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import BOW


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
    seconds: spent in "initialize" and "adjust" (the first fit of the model), "screen" (wrong sightings) and
    "compare" (the other models, cross-validation; 0 for a named model, which is compared when that is looked at).
    choice: what "auto" compared and took; None for a named model.
    svp_distance: metres, for which the single-viewpoint stand-in is fitted.
    refused: why the camera must not be used, where it was made all the same.
    same_place: image number of a view → the images that it stands for, where it is more than one: copies, and images
    between which the board rested.
    """

    fit: Fit
    rejected: tuple[RejectedPoint, ...]
    wrong_views: tuple[int, ...]
    seconds: dict[str, float]
    choice: Choice | None = None
    svp_distance: float = np.inf
    same_place: dict[int, tuple[int, ...]] = field(default_factory=dict)
    refused: str | None = None

    @cached_property
    def camera(self) -> FisheyeCamera:
        """The camera, valid to the largest angle of incidence that the fit rests on."""
        camera = replace(self.fit.state.camera, theta_max=self.fit.largest_angle)
        if self.choice is None or self.left_open is None:
            return camera
        return replace(camera, pupil_left_open=self.left_open.pupil)

    @property
    def model(self) -> str:
        return self.fit.structure.name

    @property
    def reasons(self) -> tuple[str, ...]:
        """What "auto" chose and why, a line each."""
        return self.choice.reasons if self.choice else ()

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """Of the fit; after a choice with what the choice of the pupil's family, and the verdict on it, leave open.

        Of a camera without a pupil it is what the fullest model beside it leaves open.
        """
        own = uncertainty(self.fit)
        if self.choice is None:
            return own
        if self.left_open is not None:
            return self.left_open.uncertainty_of(self.fit, own)
        verdict = self.choice.verdict
        if self.fit.structure.pupil_prior is None:
            families = [each.fit for each in self.choice.candidates.values() if each.structure.pupil_terms]
            own = with_family_spread(own, self.fit, families)
        return with_pupil_sigma(own, self.fit, verdict.theta, verdict.sigma)

    @cached_property
    def left_open(self) -> LeftOpen | None:
        """The pupil that the data leave open, where the model has none."""
        if self.fit.structure.pupil_terms:
            return None
        verdict, judged = self._judged
        return pupil_left_open(judged, verdict.theta, verdict.sigma)

    @cached_property
    def stand_in(self) -> StandIn:
        """The single-viewpoint camera of CameraInfo. Raises CalibrationError where ``svp_distance`` is too near.

        What it loses is what it may lose where a pupil is left open.
        """
        own = single_viewpoint(self.camera, self.svp_distance)
        if self.choice is None or self.left_open is None:
            return own
        return replace(own, loss_px=self.left_open.largest_loss_px(self.svp_distance))

    @cached_property
    def candidates(self) -> dict[str, Candidate]:
        """The models compared: those of the choice, or a named model beside the single-viewpoint camera."""
        return self.choice.candidates if self.choice else side_by_side(self.fit)

    @cached_property
    def comparison(self) -> dict[str, Comparison]:
        """Other models side by side, by name."""
        compared = {name: _comparison(each) for name, each in self.candidates.items()}
        if self.model in compared:
            compared[self.model] = replace(compared[self.model], covariance=self.uncertainty.covariance)
        return compared

    @cached_property
    def entrance_pupil_supported(self) -> bool:
        """Whether the data support a pupil that moves, whatever model was named."""
        return self.pupil_verdict.answer == SUPPORTED

    @property
    def pupil_verdict(self) -> PupilVerdict:
        """Whether the data support a pupil that moves, with all numbers that decided."""
        return self._judged[0]

    @cached_property
    def _judged(self) -> tuple[PupilVerdict, Fit]:
        """The verdict on the pupil and the fit that it is about."""
        if self.choice is not None:
            return self.choice.verdict, self.choice.judged
        return pupil_verdict(beside_named(self.candidates), self.fit.structure.terms is None)

    @property
    def observations(self) -> Observations:
        """What was fitted: each place once, wrong sightings with weight 0."""
        return self.fit.sightings.observations

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
        """The target's bow (w_x, w_y, w_xy), metres, or the one nearest to its shape; zero where none was estimated."""
        if self.fit.structure.board_shape == BOW:
            return self.fit.state.shape.smooth
        return self.board.bow

    @cached_property
    def board(self) -> BoardShape:
        """The target's shape as it was found, and whether it is bent."""
        return board_shape(self.fit)

    @cached_property
    def error_budget(self) -> ErrorBudget | None:
        """Where the residuals come from; None where the sightings leave too much open to tell."""
        try:
            return error_budget(self.fit)
        except np.linalg.LinAlgError:
            return None

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
        names, chosen = self.observations.image_names, self.choice is not None
        return diagnose(self.fit, self.camera, names, self.same_place, self.board, chosen)

    @cached_property
    def projection_table(self) -> ProjectionTable:
        """Projection uncertainty by angle and distance."""
        return projection_table(self.camera, self.uncertainty, self.fit.problem.free)

    @property
    def reprojection_error(self) -> np.ndarray:
        """Predicted minus measured pixels (M, 2), by row of ``observations``; NaN in images left out."""
        return self.fit.residuals[0]


def _comparison(candidate: Candidate) -> Comparison:
    camera = candidate.fit.state.camera
    try:
        covariance = uncertainty(candidate.fit).covariance
    except np.linalg.LinAlgError:
        covariance = np.full((len(camera.parameters),) * 2, np.nan)
    return Comparison(
        candidate.structure.name,
        candidate.fit.rms_px,
        candidate.validation.rms_px,
        candidate.structure.parameter_count,
        camera,
        covariance,
    )
