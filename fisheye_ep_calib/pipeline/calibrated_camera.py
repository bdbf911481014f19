"""A calibration's result together with what it was made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from fisheye_ep_calib.calibration import CalibrationResult, Observations
from fisheye_ep_calib.pipeline.camera_source import CameraSource


@dataclass(frozen=True, repr=False, kw_only=True)
class CalibratedCamera(CalibrationResult):
    """seen: what the camera saw, and where that came from."""

    seen: CameraSource

    @staticmethod
    def of(
        result: CalibrationResult, seen: CameraSource, earlier: Sequence[Mapping[str, float]] = ()
    ) -> CalibratedCamera:
        """earlier: seconds by step that an earlier pass has taken."""
        values = {field.name: getattr(result, field.name) for field in fields(result) if field.init}
        spent = (*earlier, seen.seconds, result.seconds)
        values["seconds"] = {step: sum(one.get(step, 0.0) for one in spent) for one in spent for step in one}
        return CalibratedCamera(**values, seen=seen)

    @property
    def name(self) -> str:
        return self.seen.name

    @property
    def observations(self) -> Observations:
        """What was calibrated, wrong points included."""
        return self.seen.observations
