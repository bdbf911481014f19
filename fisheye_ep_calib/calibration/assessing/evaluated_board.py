"""What shape the target has where a known camera is measured: as its file has it, as measured before, or of its own.

Another board of the same file is not bent like the first. So the shapes are compared by what they make of views that
they were not estimated from, with the camera held: as the file has it, as a calibration measured it, and estimated from
these views. A shape that is estimated must not pass for what is wrong with the camera: it is taken only where it also
predicts better than another camera would, fitted to these views with the board as it is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.board import board_shape
from fisheye_ep_calib.calibration.assessing.evaluation import posed_views
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.estimating.shape_estimate import with_estimated_shape
from fisheye_ep_calib.calibration.estimating.sightings import MIN_VIEWS
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.selecting.cross_validation import CrossValidation, cross_validate
from fisheye_ep_calib.calibration.selecting.outliers import DRAGGED, without_gross_errors
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.target.shape.faces import faces_of
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.target.shape.model import FLAT, FREE, flat_model

AS_FILE, MEASURED, ESTIMATED, OTHER_CAMERA = "file", "measured", "estimated", "other camera"
_TOLD = {
    AS_FILE: "the board is taken as its file has it",
    MEASURED: "the board has the shape that the calibration measured",
    ESTIMATED: "the board's shape is estimated from these views, the camera held",
}
_HOW = {
    AS_FILE: "with the board as its file has it",
    MEASURED: "with the shape that the calibration measured",
    ESTIMATED: "with a shape estimated here",
    OTHER_CAMERA: "with a camera fitted here",
}
_SUSPICIOUS = 0.5  # % that a board is longer one way; printers do less
_WORTH = 0.02  # of ln(RMS ratio): a shape that gains less is not worth a word


@dataclass(frozen=True)
class EvaluatedBoard:
    """source: AS_FILE, MEASURED or ESTIMATED. board: None as the file has it.

    held_out_px: RMS on views left out, of each that was compared, and of a camera fitted to these views (OTHER_CAMERA).
    ambiguous: a shape of its own would explain the views, but so would another camera.
    """

    source: str
    board: BoardShape | None
    held_out_px: Mapping[str, float]
    ambiguous: bool = False

    @property
    def sentence(self) -> str:
        """What shape the board has here, and why."""
        compared = ", ".join(f"{px:.3f} px {_HOW[source]}" for source, px in self.held_out_px.items())
        why = f" (views left out err by {compared})" if len(self.held_out_px) > 1 else ""
        told = _TOLD[self.source]
        if self.source == AS_FILE and MEASURED in self.held_out_px:
            told = "the board is not bent as the calibration's was: it is taken as its file has it"
        elif self.source == AS_FILE and self.board is not None:
            told = "the board has the shape that its own file brings"
        shape = "" if self.board is None else f": {self.board.sentence}"
        also = "; a shape of its own would explain these views, but so would another camera" if self.ambiguous else ""
        return f"{told}{shape}{why}{also}"

    @property
    def finding(self) -> Finding | None:
        """Where what is told of the board may be the camera's fault."""
        aspect = 0.0 if self.board is None or self.source != ESTIMATED else self.board.aspect_percent
        if not self.ambiguous and abs(aspect) < _SUSPICIOUS:
            return None
        values = {f"{source.replace(' ', '_')}_px": px for source, px in self.held_out_px.items()}
        told = "a board of another shape would explain these views, and so would another camera"
        if not self.ambiguous:
            first, second = ("x", "y") if aspect > 0 else ("y", "x")
            told = (
                f"with the camera held the board is {abs(aspect):.2f} % longer in {first} than in {second}, or the "
                "camera's fx and fy are off by as much"
            )
        return Finding("board_or_camera", values, True, f"{told}: measure the print, and turn the board between views")

    def to_dict(self) -> dict[str, Any]:
        """What programs read."""
        shape = {} if self.board is None else self.board.to_dict()
        return {"source": self.source, **shape, "held_out_px": dict(self.held_out_px), "ambiguous": self.ambiguous}


def evaluated_board(
    camera: FisheyeCamera,
    observations: Observations,
    measured: BoardShape | None,
    disc_centers: str = "unbiased",
) -> EvaluatedBoard:
    """measured: the shape that a calibration found; of another target it is passed over.

    Observations that bring a shape have it as their file's.
    """
    boards = {AS_FILE: observations.board}
    if measured is not None and measured.bends and measured.same_target(observations.object_points):
        boards[MEASURED] = measured
    fit, _ = posed_views(camera, observations, disc_centers=disc_centers)
    start = without_gross_errors(refine(fit, replace(fit.structure, board_shape=FLAT)))
    fits = {source: start if source == AS_FILE else _with_board(start, board) for source, board in boards.items()}
    if len(start.sightings.images) < MIN_VIEWS:
        best = min(fits, key=lambda source: fits[source].rms_px)
        return EvaluatedBoard(best, boards[best], {})
    return _compared(fits, boards)


def held_out_px(camera: FisheyeCamera, observations: Observations, board: BoardShape) -> float:
    """RMS with a board of this shape, each view's pose refitted; infinite where no view has one."""
    try:
        fit, _ = posed_views(camera, observations)
        return _with_board(without_gross_errors(refine(fit, replace(fit.structure, board_shape=FLAT))), board).rms_px
    except CalibrationError:
        return np.inf


def _compared(fits: dict[str, Fit], boards: dict[str, BoardShape | None]) -> EvaluatedBoard:
    """The best of known shapes by views left out, and one estimated from them where it is clearly better."""
    shaped = _with_own_shape(fits[AS_FILE])
    validations = {source: cross_validate(fit) for source, fit in fits.items()}
    best = min(validations, key=lambda source: validations[source].mean_loss)
    held_out = {source: each.rms_px for source, each in validations.items()}
    if shaped is None:
        return EvaluatedBoard(best, boards[best], held_out)
    own = cross_validate(shaped)
    held_out[ESTIMATED] = own.rms_px
    if not _clearly_better(own, validations[best]):
        return EvaluatedBoard(best, boards[best], held_out)
    try:
        other = refine(fits[best], fits[best].structure.estimated)
        validation = cross_validate(other) if other.adjustment.converged else None
    except (CalibrationError, np.linalg.LinAlgError):
        return EvaluatedBoard(ESTIMATED, board_shape(shaped), held_out)
    if validation is not None:
        held_out[OTHER_CAMERA] = validation.rms_px
    # Where another camera's fit finds no end, the camera may be to blame as well.
    if validation is None or not _clearly_better(own, validation):
        return EvaluatedBoard(best, boards[best], held_out, ambiguous=True)
    return EvaluatedBoard(ESTIMATED, board_shape(shaped), held_out)


def _with_board(fit: Fit, board: BoardShape | None) -> Fit:
    """The same views with another known shape of the target."""
    observations = replace(fit.sightings.observations, board=board)
    target = flat_model(observations.object_points, None if board is None else board.local)
    return refine(fit, fit.structure, replace(fit.sightings, observations=observations, target=target))


def _with_own_shape(fit: Fit) -> Fit | None:
    """With the target's shape estimated, the camera held; None where the views say nothing of one."""
    if fit.rms_px > DRAGGED * fit.sightings.usual_weight or not faces_of(fit.sightings.observations.object_points):
        return None
    try:
        shaped = with_estimated_shape(fit, replace(fit.structure, board_shape=FREE))
    except (CalibrationError, np.linalg.LinAlgError):
        return None
    return shaped if shaped.problem.shape_size else None


def _clearly_better(first: CrossValidation, second: CrossValidation) -> bool:
    gain, error = first.log_ratio(second)
    return -gain > max(error, _WORTH)
