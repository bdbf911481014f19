"""A camera as it goes out to other programs: where it is, and what it is for one that knows no entrance pupil."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.version import __version__

if TYPE_CHECKING:
    from fisheye_ep_calib.calibration.assessing.stand_in import StandIn

KANNALA_BRANDT = "kannala_brandt"
_ROUNDING = 1e-6  # px
_LOSSES = (0.1, 0.3, 1.0, 10.0, np.inf)  # metres


@dataclass(frozen=True)
class PlacedCamera:
    """name: what it is called. distance: metres, for which a single viewpoint is to be right; may be infinite.

    reference_from_camera (4, 4): metres; the first camera of a rig is the reference. topic: of its images, where known.
    overlaps: numbers of the cameras of the rig that see the target together with it.
    """

    name: str
    camera: FisheyeCamera
    distance: float = np.inf
    reference_from_camera: np.ndarray = field(default_factory=lambda: np.eye(4))
    topic: str = ""
    overlaps: tuple[int, ...] = ()

    @property
    def image_topic(self) -> str:
        return self.topic or f"/{self.name}/image_raw"

    def central(self, lenses: Sequence[str] = (KANNALA_BRANDT,), extras: Sequence[str] = ()) -> StandIn:
        """The nearest camera with one viewpoint. lenses: what the reader knows, the first of them where it knows not
        the camera's own. extras: likewise, those of the camera's that the reader knows."""
        lens = self.camera.lens if self.camera.lens in lenses else lenses[0]
        return _central(self.camera, self.distance, lens, tuple(name for name in extras if name in self.camera.extras))

    @property
    def camera_from_reference(self) -> np.ndarray:
        """(4, 4), metres."""
        return np.asarray(np.linalg.inv(self.reference_from_camera))


@lru_cache(maxsize=64)
def _fit(camera: _ByIdentity, distance: float, lens: str, extras: tuple[str, ...]) -> StandIn:
    from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint

    return single_viewpoint(camera.camera, distance, lens, extras)


class _ByIdentity:
    """A camera as a key: its extras are a mapping, which has no hash."""

    def __init__(self, camera: FisheyeCamera) -> None:
        self.camera = camera
        self._key = (camera.model, camera.lens, camera.image_size, tuple(camera.extras), camera.parameters.tobytes())

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and self._key == other._key


def _central(camera: FisheyeCamera, distance: float, lens: str, extras: tuple[str, ...]) -> StandIn:
    return _fit(_ByIdentity(camera), distance, lens, extras)


def statement(cameras: Sequence[PlacedCamera], written: Sequence[FisheyeCamera]) -> tuple[str, ...]:
    """What a file says of itself, a line each: what was written in each camera's place, and what that loses.

    written: of each camera, the one that the file's reader will see, in the same frame.
    """
    from fisheye_ep_calib.calibration.assessing.stand_in import loss_px

    lines = [f"written by fisheye_ep_calib {__version__}; metres, pixels, x right, y down, z forward"]
    for placed, other in zip(cameras, written, strict=True):
        losses = loss_px(placed.camera, other, _LOSSES)
        told = ", ".join(f"{loss:.4g} px at {_distance(far)}" for far, loss in losses.items() if np.isfinite(loss))
        exact = max(losses.values()) < _ROUNDING
        what = "the full camera, to rounding" if exact else f"RMS over the image against the full camera: {told}"
        lines.append(f"{placed.name}: {what}")
        if placed.camera.coefficients and not other.coefficients:
            lines.append(f"{placed.name}: a single viewpoint, nearest for points at {_distance(placed.distance)}")
        lost = _lost(placed.camera, other)
        lines.append(f"{placed.name}: not in this file: {', '.join(lost)}")
    return tuple(lines)


def _distance(metres: float) -> str:
    return "infinity" if np.isinf(metres) else f"{metres:g} m"


def _lost(camera: FisheyeCamera, other: FisheyeCamera) -> list[str]:
    """What the camera has and the other has not."""
    lost = []
    if camera.coefficients and not other.coefficients:
        lost.append("the entrance pupil E(theta)")
    if camera.skew and not other.skew:
        lost.append(f"skew {camera.skew:.4g} px")
    lost += [name for name in camera.extras if name not in other.extras]
    if camera.lens != other.lens:
        lost.append(f"the lens {camera.lens} as it is (fitted by {other.lens})")
    return [*lost, "uncertainties", "where the calibration's evidence ends"]


def rotation_quaternion(pose: np.ndarray) -> list[float]:
    """(x, y, z, w), w ≥ 0, of the rotation of a pose (4, 4)."""
    from scipy.spatial.transform import Rotation

    return [float(value) for value in Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)]


def floats(values: Sequence[float] | np.ndarray) -> list[float]:
    return [float(value) for value in values]
