"""A camera measured on other observations, with its words, figures and page at hand."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.evaluated_board import EvaluatedBoard, evaluated_board
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation, evaluate_camera
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.evaluation_words import (
    BEYOND_EVIDENCE,
    camera_variance,
    evaluation_content,
    evaluation_findings,
    evaluation_verdict,
    expected_rms,
)
from fisheye_ep_calib.calibration.words import Verdict
from fisheye_ep_calib.pipeline.camera_source import CameraSource, source_of_observations
from fisheye_ep_calib.pipeline.known_camera import AnyCamera, known_camera
from fisheye_ep_calib.pipeline.page_of_words import words_html
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.target.shape.measured import BoardShape

if TYPE_CHECKING:
    from fisheye_ep_calib.report.data import CameraReport
    from fisheye_ep_calib.report.plots import CameraPlots


@dataclass(frozen=True, repr=False, kw_only=True)
class EvaluatedCamera(Evaluation):
    """camera_file: the camera that was measured. camera_source: on what. flat: the target was taken as its
    file has it. board: the shape that it was given instead; chosen: among which, and why. path: of the camera file.
    """

    camera_file: CameraFile
    camera_source: CameraSource
    flat: bool = True
    path: str = ""
    board: BoardShape | None = None
    chosen: EvaluatedBoard | None = None

    @property
    def observations(self) -> Observations:
        return self.camera_source.observations

    @cached_property
    def expected_rms_px(self) -> float | None:
        """What the noise of the points and the camera's own σ lead to expect; None where it is not known."""
        camera_file = self.camera_file
        variance = camera_variance(self, self.observations, camera_file.camera, camera_file.covariance)
        return expected_rms(self, camera_file.calibration.get("noise_px"), variance)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What stands out by angle, distance and view, and of the board."""
        findings = evaluation_findings(self, self.observations, self.camera_file.camera.theta_max)
        if self.camera_file.origin:  # where its calibration saw points is not known either
            findings = (*(finding for finding in findings if finding.name != BEYOND_EVIDENCE), self._of_another_program)
        of_board = None if self.chosen is None else self.chosen.finding
        return findings if of_board is None else (*findings, of_board)

    @property
    def _of_another_program(self) -> Finding:
        told = (
            f"the camera is read as {self.camera_file.origin}; the file says nothing of its uncertainty, so what is to "
            "be expected is not known: calibrate this recording, evaluate that camera on it too, and compare the two"
        )
        return Finding("another_program", {"rms_px": self.rms_px}, False, told)

    @property
    def board_words(self) -> str:
        """What shape the target was given, and where that came from."""
        if not self.flat and self.board is None:
            measured = self.camera_file.board
            aside = "; the shape that it measured is left aside" if measured is not None and measured.bends else ""
            return f"the board has the bow alone that the calibration found, as was asked{aside}"
        if self.chosen is None:
            return "the board is taken as its file has it"
        board = self.camera_file.board
        if board is None and self.flat and self.camera_file.board_warp.any():
            return "the board is taken as its file has it, the calibration found it bent: `board_warp` takes its bow"
        another = board is not None and board.bends and not board.same_target(self.observations.object_points)
        return f"another board than the calibration's: {self.chosen.sentence}" if another else self.chosen.sentence

    @property
    def verdict(self) -> Verdict:
        """Whether the camera holds on these observations, and why."""
        return evaluation_verdict(self, self.expected_rms_px, self.findings, self.camera_file.camera.image_size)

    def to_dict(self) -> dict[str, Any]:
        """What ``evaluate --json`` prints."""
        content = evaluation_content(self, self.observations, self.expected_rms_px, self.verdict, self.findings)
        shape = {} if self.chosen is None else {"board_shape": self.chosen.to_dict()}
        return {**content, "board": self.board_words, **shape}

    def report(self, path: str | PathLike[str]) -> None:
        """Write one HTML page with all figures, and the images as far as they can still be read."""
        from fisheye_ep_calib.report.html import write_report

        title = f"{self.camera_file.name} measured on {self.camera_source.source}" if self.camera_source.source else ""
        write_report(path, [self._report(pictures=True)], title)

    def _report(self, pictures: bool = False) -> CameraReport:
        from fisheye_ep_calib.report.from_evaluation import evaluation_report
        from fisheye_ep_calib.report.record import inputs_in_words
        from fisheye_ep_calib.storage.camera_content import fact_in_words

        inputs = {"camera file": self.path} if self.path else {}
        inputs |= inputs_in_words(self.camera_source.inputs())
        inputs["target's shape"] = self.board_words
        inputs |= {f"calibration: {key}": fact_in_words(value) for key, value in self.camera_file.calibration.items()}
        return evaluation_report(
            self.camera_file.name,
            self.camera_file,
            self.observations,
            self,
            board=self.board,
            expected_px=self.expected_rms_px,
            inputs=inputs,
            image=self.camera_source.image if pictures else None,
        )

    @property
    def plot(self) -> CameraPlots:
        """The report's figures one by one, on matplotlib's axes: ``judged.plot.residuals(ax)``."""
        from fisheye_ep_calib.report.plots import CameraPlots

        return CameraPlots(self._report())

    def __repr__(self) -> str:
        expected = self.expected_rms_px
        than = "" if expected is None else f", {expected:.3f} px expected"
        failed = f"; {len(self.failed)} views without a pose" if self.failed else ""
        return (
            f"{self.camera_file.name} on {self.points} points in {len(self.images)} views: "
            f"RMS {self.rms_px:.3f} px{than}, "
            f"median {self.median_px:.3f} px, 95 % below {self.p95_px:.3f} px{failed}\n  {self.verdict.headline}"
        )

    def _repr_html_(self) -> str:
        return words_html(repr(self), self.verdict, self.findings)


def evaluate(
    camera: AnyCamera,
    observations: Observations | CameraSource,
    *,
    board_warp: bool = False,
    disc_centers: str = "unbiased",
) -> EvaluatedCamera:
    """Measure a camera on observations: every view's pose is refitted, the camera stays as it is.

    Args:
        camera: A camera alone, a calibration, a camera file or its path; what the last three know of their noise tells
            what is to be expected.
        observations: What the camera saw, best at other distances than it was calibrated at. The target has the shape
            that predicts views left out best: as its file has it, as the calibration measured it, or estimated here
            (assessing/evaluated_board.py).
        board_warp: Give the target the bow alone that the calibration found.
        disc_centers: "unbiased" predicts the centre of gravity of each projected disc, "naive" the image of its centre.

    Returns:
        What is left: ``rms_px`` against ``expected_rms_px``, a verdict in words, findings.

    Raises:
        InputError: The camera has another image size, or its file cannot be used.
        CalibrationError: No view fits the camera.
    """
    camera_file = known_camera(camera)
    source = source_of_observations("camera", observations)
    warp = camera_file.board_warp if board_warp else None
    chosen = None
    if not board_warp:
        chosen = evaluated_board(camera_file.camera, source.observations, camera_file.board, disc_centers)
    board = None if chosen is None else chosen.board
    evaluation = evaluate_camera(camera_file.camera, source.observations, warp, disc_centers, board)
    values = {field.name: getattr(evaluation, field.name) for field in fields(evaluation)}
    return EvaluatedCamera(
        **values,
        camera_file=camera_file,
        camera_source=source,
        flat=board is None and not board_warp,
        path=str(camera) if isinstance(camera, str | PathLike) else "",
        board=board,
        chosen=chosen,
    )
