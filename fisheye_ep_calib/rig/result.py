"""What a rig calibration gives back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.calibration.assessing.evaluated_board import EvaluatedBoard
from fisheye_ep_calib.camera import FisheyeCamera


@dataclass(frozen=True)
class RigPair:
    """Two cameras, by number, that see the target together in ``views`` moments.

    disagreement: RMS between their own poses of the target before the adjustment, as a fraction of its distance.
    """

    a: int
    b: int
    views: int
    disagreement: float


@dataclass(frozen=True)
class RigCalibration:
    """Cameras in the frame of the first, the reference.

    reference_from_camera (C, 4, 4): metres. covariance (C, 6, 6): of the steps (ω, δ) of R ← exp(ω) R, t ← t + δ,
    rad and metres; zero for the reference. paths: the chain of overlaps from the reference to each camera.
    moments: times at which two cameras or more saw the target (one, where the cameras were refined too).
    views, camera_rms_px: by camera. left_out: (camera, image name) that fit no one position of the target.
    board_warp (3,): metres. clock_offsets_ns: each camera's clock less the first one's, zeros where not compared.
    board: what shape the target was given, and why; None where it was not compared.
    """

    names: tuple[str, ...]
    cameras: tuple[FisheyeCamera, ...]
    reference_from_camera: FloatArray
    covariance: FloatArray
    paths: tuple[tuple[int, ...], ...]
    pairs: tuple[RigPair, ...]
    moments: int
    views: tuple[int, ...]
    rms_px: float
    camera_rms_px: tuple[float, ...]
    left_out: tuple[tuple[int, str], ...]
    board_warp: np.ndarray
    converged: bool
    clock_offsets_ns: tuple[int, ...]
    board: EvaluatedBoard | None = None

    @property
    def rotation_sigma(self) -> np.ndarray:
        """1σ (C, 3) of each camera's orientation about the reference's axes, rad."""
        sigma: FloatArray = np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2)[:, :3], 0))
        return sigma

    @property
    def position_sigma(self) -> np.ndarray:
        """1σ (C, 3) of each camera's position, metres."""
        sigma: FloatArray = np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2)[:, 3:], 0))
        return sigma

    @property
    def quaternion_xyzw(self) -> np.ndarray:
        """Each camera's orientation (C, 4) in the reference's frame, w ≥ 0, as tf has it."""
        from scipy.spatial.transform import Rotation

        quaternions: FloatArray = Rotation.from_matrix(self.reference_from_camera[:, :3, :3]).as_quat(canonical=True)
        return quaternions

    def to_dict(self) -> dict[str, Any]:
        """What was found, JSON-ready: metres, rad, pixels; cameras by name."""
        return {
            "reference": self.names[0],
            "rms_px": self.rms_px,
            "moments": self.moments,
            "converged": self.converged,
            "cameras": {name: self._camera_dict(number) for number, name in enumerate(self.names)},
            "clock_offsets_s": {name: 1e-9 * ns for name, ns in zip(self.names, self.clock_offsets_ns, strict=True)},
            "overlaps": [
                {"cameras": [self.names[pair.a], self.names[pair.b]], "views": pair.views} for pair in self.pairs
            ],
            "board_warp_m": self.board_warp.tolist(),
            "board": None if self.board is None else {"words": self.board.sentence, **self.board.to_dict()},
            "not_used": [{"camera": self.names[camera], "view": image} for camera, image in self.left_out],
        }

    def _camera_dict(self, number: int) -> dict[str, Any]:
        return {
            "reference_from_camera": self.reference_from_camera[number].tolist(),
            "position_m": self.reference_from_camera[number, :3, 3].tolist(),
            "quaternion_xyzw": self.quaternion_xyzw[number].tolist(),
            "position_sigma_m": self.position_sigma[number].tolist(),
            "rotation_sigma_rad": self.rotation_sigma[number].tolist(),
            "views": self.views[number],
            "rms_px": self.camera_rms_px[number],
            "joined_through": [self.names[step] for step in self.paths[number]],
        }
