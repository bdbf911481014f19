"""What a calibration of the rig comes to: its file, Kalibr's file and the figures that are told about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.rig import RigCamera, calibrate_rig
from fisheye_ep_calib.storage.rig_file import RIG, rig_files


@dataclass(frozen=True)
class RigMember:
    """One camera for the calibration of the rig. stamps_ns: when each image was taken, by image number.

    camera_file: as the rig's file names it. topic: of its images.
    """

    name: str
    calibration: Outcome
    observations: Observations
    stamps_ns: np.ndarray
    camera_file: str
    topic: str


@dataclass(frozen=True)
class RigOutcome:
    """files: what to write, by name. figures: JSON-ready."""

    files: Mapping[str, str]
    figures: dict[str, Any]

    @property
    def yaml(self) -> str:
        """The rig's file."""
        return self.files[RIG]

    @property
    def summary(self) -> str:
        """One line with the numbers."""
        placed = [
            f"{name} at ({', '.join(f'{1e3 * value:.2f}' for value in figures['position_m'])}) mm "
            f"± {1e3 * float(np.linalg.norm(figures['position_sigma_m'])):.2g} mm"
            for name, figures in self.figures["cameras"].items()
            if name != self.figures["reference"]
        ]
        return "{moments} common views, RMS {rms_px:.3f} px, ".format(**self.figures) + ", ".join(placed)


def calibrate_members(members: Sequence[RigMember], tolerance: float, unmistakable: bool) -> RigOutcome:
    """Calibrate the rig; what a worker process runs. tolerance: seconds. Raises CalibrationError."""
    cameras = [
        RigCamera(
            member.name,
            member.calibration.camera,
            member.observations,
            member.stamps_ns,
            member.calibration.covariance,
            member.calibration.board,
        )
        for member in members
    ]
    rig = calibrate_rig(cameras, tolerance, unmistakable)
    if not rig.converged:
        raise CalibrationError("the fit did not converge; more common views, tilted and at several distances, help")
    files = rig_files(
        rig,
        {member.name: member.camera_file for member in members},
        [member.calibration.stand_in for member in members],
        {member.name: member.topic for member in members},
    )
    return RigOutcome(files, rig.to_dict())
