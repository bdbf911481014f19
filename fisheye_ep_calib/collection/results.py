"""What was seen in a recording's images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.target.detection import Detection


@dataclass(frozen=True)
class FrameResult:
    """One image that was looked at.

    topic, index: which image, counted from 0 in the order of time. image_size: (width, height); None where it
    could not be read. error: why it could not be; empty where it could. read_seconds covers decoding.
    """

    topic: str
    index: int
    stamp_ns: int
    name: str
    image_size: tuple[int, int] | None
    detection: Detection
    error: str = ""
    read_seconds: float = field(default=0.0, compare=False)
    detect_seconds: float = field(default=0.0, compare=False)

    @property
    def found(self) -> bool:
        return len(self.detection) > 0

    @property
    def reason(self) -> str:
        """Why the image is no view; empty where it is one."""
        return self.error or ("" if self.found else self.detection.reason or "the target was not found")


@dataclass(frozen=True)
class DetectionRun:
    """What was seen by one camera.

    frames: the images that were looked at, in the order of time. available: how many images the topic has.
    interrupted: the user stopped before all that were to be looked at had been.
    """

    topic: str
    available: int
    frames: tuple[FrameResult, ...]
    interrupted: bool = False

    @property
    def views(self) -> tuple[FrameResult, ...]:
        """The images in which the target was found; their order numbers the images of ``observations``."""
        return tuple(frame for frame in self.frames if frame.found)

    @property
    def unused(self) -> dict[str, str]:
        """Name of each image that was looked at and is no view → why; namesakes are numbered."""
        reasons: dict[str, str] = {}
        for frame in self.frames:
            if frame.found:
                continue
            name, number = frame.name, 1
            while name in reasons:
                number += 1
                name = f"{frame.name} ({number})"
            reasons[name] = frame.reason
        return reasons

    @property
    def bad_frames(self) -> int:
        """How many images could not be read."""
        return sum(bool(frame.error) for frame in self.frames)

    @property
    def image_size(self) -> tuple[int, int] | None:
        return next((frame.image_size for frame in self.frames if frame.image_size), None)

    @property
    def read_seconds(self) -> float:
        return sum(frame.read_seconds for frame in self.frames)

    @property
    def detect_seconds(self) -> float:
        return sum(frame.detect_seconds for frame in self.frames)

    def summary(self) -> str:
        """One line for the user: what was looked at, found, unreadable and passed over."""
        parts = [f"{self.topic}: target found in {len(self.views)} of {len(self.frames)} images"]
        if self.bad_frames:
            first = next(frame.error for frame in self.frames if frame.error)
            parts.append(f"{self.bad_frames} unreadable ({first})")
        if self.available > len(self.frames):
            parts.append(f"{self.available - len(self.frames)} of {self.available} not looked at")
        if self.interrupted:
            parts.append("interrupted")
        return ", ".join(parts)

    def observations(self, object_points: np.ndarray, disc_radius: float | None = None) -> Observations:
        """Every view's points, for a target of ``object_points`` (n, 3) m.

        Raises InputError where no image could be read or their sizes differ, CalibrationError where the target is in
        none.
        """
        differ = sizes_differ(self.frames)
        if differ is not None:
            one, other = ("{} is {}×{}".format(frame.name, *(frame.image_size or (0, 0))) for frame in differ)
            raise InputError(f"{self.topic}: its images differ in size: {one}, {other}; give images of one size")
        views = self.views
        if not views:
            raise self._nothing_found()
        return Observations.create(
            object_points=object_points,
            image_index=np.concatenate([np.full(len(view.detection), i) for i, view in enumerate(views)]),
            point_index=np.concatenate([view.detection.point_index for view in views]),
            pixels=np.concatenate([view.detection.pixels for view in views]),
            image_size=views[0].image_size,
            image_names=[view.name for view in views],
            disc_radius=disc_radius,
        )

    def _nothing_found(self) -> CalibrationError:
        if not self.frames:
            return CalibrationError(f"{self.topic}: no image was looked at")
        if self.bad_frames == len(self.frames):
            return InputError(f"{self.topic}: none of {self.bad_frames} images can be read: {self.frames[0].error}")
        reasons = Counter(frame.reason for frame in self.frames)
        reason, count = reasons.most_common(1)[0]
        return CalibrationError(
            f"{self.topic}: the target was found in none of {len(self.frames)} images ({count} ×: {reason}); "
            "check that the target file describes the printed target"
        )


def sizes_differ(frames: Sequence[FrameResult]) -> tuple[FrameResult, FrameResult] | None:
    """The first image, and the first that has another size; None where all are alike."""
    sized = [frame for frame in frames if frame.image_size is not None]
    return next(((sized[0], frame) for frame in sized if frame.image_size != sized[0].image_size), None)
