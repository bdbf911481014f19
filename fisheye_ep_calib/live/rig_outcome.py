"""What a calibration of the rig comes to: its file, Kalibr's file and the figures that are told about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.rig import RigCalibration, RigCamera, calibrate_rig
from fisheye_ep_calib.storage.rig_file import kalibr_camchain, quaternion, rig_yaml


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
    """yaml: the rig's file. camchain: the same in Kalibr's layout. figures: JSON-ready."""

    yaml: str
    camchain: str
    figures: dict[str, Any]

    @property
    def summary(self) -> str:
        """One line with the numbers."""
        placed = [
            f"{name} at ({', '.join(f'{1e3 * value:.2f}' for value in one['position_m'])}) mm "
            f"± {1e3 * float(np.linalg.norm(one['position_sigma_m'])):.2g} mm"
            for name, one in self.figures["cameras"].items()
            if name != self.figures["reference"]
        ]
        return "{moments} common views, RMS {rms_px:.3f} px, ".format(**self.figures) + ", ".join(placed)


def calibrate_members(members: Sequence[RigMember], tolerance: float, unmistakable: bool) -> RigOutcome:
    """Calibrate the rig; what a worker process runs. tolerance: seconds. Raises CalibrationError."""
    cameras = [
        RigCamera(one.name, one.calibration.camera, one.observations, one.stamps_ns, one.calibration.covariance)
        for one in members
    ]
    rig = calibrate_rig(cameras, tolerance, unmistakable)
    if not rig.converged:
        raise CalibrationError("the fit did not converge; more common views, tilted and at several distances, help")
    topics = {one.name: one.topic for one in members}
    return RigOutcome(
        yaml=rig_yaml(rig, {one.name: one.camera_file for one in members}, topics),
        camchain=kalibr_camchain(rig, [one.calibration.stand_in for one in members], topics),
        figures=_figures(rig),
    )


def _figures(rig: RigCalibration) -> dict[str, Any]:
    return {
        "reference": rig.names[0],
        "moments": rig.moments,
        "rms_px": round(rig.rms_px, 4),
        "cameras": {
            name: {
                "position_m": _rounded(rig.reference_from_camera[number, :3, 3]),
                "position_sigma_m": _rounded(rig.position_sigma[number]),
                "quaternion_xyzw": _rounded(quaternion(rig.reference_from_camera[number, :3, :3])),
                "rotation_sigma_rad": _rounded(rig.rotation_sigma[number]),
                "views": rig.views[number],
                "rms_px": round(rig.camera_rms_px[number], 4),
                "joined_through": [rig.names[step] for step in rig.paths[number]],
            }
            for number, name in enumerate(rig.names)
        },
        "not_used": len(rig.left_out),
    }


def _rounded(values: np.ndarray) -> list[float]:
    """Micrometres, microradians and a little more."""
    return [round(float(value), 8) for value in values]
