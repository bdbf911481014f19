"""A calibration's result with what it was made from, and with its words, figures, page and files at hand.

Figures and pages are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations, calibrate
from fisheye_ep_calib.calibration.assessing.camera_change import CameraChange
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.content import calibration_content
from fisheye_ep_calib.calibration.options import AUTO
from fisheye_ep_calib.calibration.words import Verdict, calibration_verdict
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.pipeline.camera_source import CameraSource, source_of_observations
from fisheye_ep_calib.pipeline.known_camera import AnyCamera
from fisheye_ep_calib.pipeline.options import fit_options, refuse_unknown_options
from fisheye_ep_calib.pipeline.page_of_words import words_html
from fisheye_ep_calib.pipeline.previous_camera import change_since
from fisheye_ep_calib.pipeline.writing import write_cameras

if TYPE_CHECKING:
    from fisheye_ep_calib.report.data import CameraReport
    from fisheye_ep_calib.report.plots import CameraPlots

_PUPIL_DEGREES = 60.0


@dataclass(frozen=True, repr=False, kw_only=True)
class CalibratedCamera(CalibrationResult):
    """camera_source: what the camera saw, and where that came from. change: since an earlier calibration of it, where
    there is one.
    """

    camera_source: CameraSource
    change: CameraChange | None = None

    @staticmethod
    def of(
        result: CalibrationResult, camera_source: CameraSource, earlier: Sequence[Mapping[str, float]] = ()
    ) -> CalibratedCamera:
        """earlier: seconds by step that an earlier pass has taken."""
        values = {field.name: getattr(result, field.name) for field in fields(result) if field.init}
        spent = (*earlier, camera_source.seconds, result.seconds)
        values["seconds"] = {step: sum(took.get(step, 0.0) for took in spent) for took in spent for step in took}
        return CalibratedCamera(**values, camera_source=camera_source)

    @property
    def name(self) -> str:
        return self.camera_source.name

    @property
    def observations(self) -> Observations:
        """What was calibrated, wrong points included."""
        return self.camera_source.observations

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the recording could and could not tell; those raised limit the calibration."""
        return self.diagnosis.findings

    @cached_property
    def verdict(self) -> Verdict:
        """How good the camera is, why, and what to record next."""
        return calibration_verdict(self)

    def since(self, previous: AnyCamera) -> CalibratedCamera:
        """This, held against an earlier calibration of the same camera: a camera, its file or its path."""
        return replace(self, change=change_since(previous, self))

    def to_dict(self) -> dict[str, Any]:
        """Everything that programs read of a calibration, as ``calibrate --json`` prints it of a camera."""
        previous = None if self.change is None else self.change.to_dict()
        unused = dict(self.camera_source.unused_views)
        return {**calibration_content(self), "previous": previous, "yaml": None, "unused_views": unused}

    def write(self, folder: str | PathLike[str], *, overwrite: bool = False) -> Path | None:
        """Write NAME.yaml, observations/NAME.npz and calibration.json into a folder, all or none.

        Returns the camera file; None for the paper's equation as printed, which is no camera. Raises InputError where
        files of those names are there, unless ``overwrite``.
        """
        return write_cameras(folder, [(self, self.camera_source, self.to_dict())], overwrite=overwrite)[self.name]

    def report(self, path: str | PathLike[str]) -> None:
        """Write one HTML page with all figures, and the images as far as they can still be read."""
        from fisheye_ep_calib.report.html import write_report

        write_report(path, [self.page(pictures=True)])

    def page(self, pictures: bool = False, share: int = 1) -> CameraReport:
        """What a report shows of the camera. share: number of cameras that share the page."""
        from fisheye_ep_calib.report.from_calibration import calibration_report
        from fisheye_ep_calib.report.pictures import BUDGET
        from fisheye_ep_calib.report.record import inputs_in_words

        page = calibration_report(
            self.name,
            self.observations,
            self,
            inputs=inputs_in_words(self.camera_source.inputs()),
            unused=self.camera_source.unused_views,
            image=self.camera_source.image if pictures else None,
            picture_budget=BUDGET // max(share, 1),
        )
        if self.change is None:
            return page
        return replace(page, facts={**page.facts, "since the last calibration": self.change.sentence})

    @property
    def plot(self) -> CameraPlots:
        """The report's figures one by one, on matplotlib's axes: ``result.plot.entrance_pupil(ax)``."""
        from fisheye_ep_calib.report.plots import CameraPlots

        return CameraPlots(self._page)

    @cached_property
    def _page(self) -> CameraReport:
        return self.page()

    def __repr__(self) -> str:
        width, height = self.camera.image_size
        lines = [
            f"{self.name}: {self.model}, {width}×{height} px, RMS {self.rms_px:.3f} px over {self.points} points in "
            f"{self.views} views, up to {np.degrees(self.camera.theta_max):.0f}° off the axis",
            f"  {self._pupil()}",
        ]
        if not self.converged:
            lines.append("  the fit did not converge")
        left_out = len(self.rejected)
        if left_out or self.wrong_views:
            lines.append(f"  left out as wrong: {left_out} points, {len(self.wrong_views)} views")
        return "\n".join(lines)

    def _pupil(self) -> str:
        if not self.camera.coefficients:
            return "a single viewpoint"
        angle = min(np.radians(_PUPIL_DEGREES), self.camera.theta_max)
        shift = 1e3 * float(self.camera.entrance_pupil(angle))
        sigma = 1e3 * float(pupil_sigma(self.camera, self.uncertainty.covariance, np.array(angle)))
        return f"entrance pupil E({np.degrees(angle):.0f}°) = {shift:+.3f} ± {sigma:.3f} mm"

    def _repr_html_(self) -> str:
        return words_html(repr(self), self.verdict, self.findings)


def calibrate_observations(
    observations: Observations, model: str = AUTO, *, name: str = "camera", **options: Any
) -> CalibratedCamera:
    """Calibrate one camera from its observations.

    Args:
        observations: What the camera saw.
        model: "auto" takes what the data support. A named model is fitted as it is and nothing else; what judges it is
            worked out when it is looked at.
        name: Of the camera, for what is written.
        **options: Those of ``calibration.Options.of``.

    Returns:
        The camera, judged.

    Raises:
        InputError: An option is unknown, or its value cannot be used.
        CalibrationError: The observations determine no camera.
    """
    refuse_unknown_options(options, fit_options())
    source = source_of_observations(name, observations)
    return CalibratedCamera.of(calibrate(source.observations, model, **options), source)
