"""What was seen in a recording's images."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.target.detection import Detection

_REASONS = 3  # that are told of many
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_STRAYS = 5  # one image in so many may be of another size than the rest


@dataclass(frozen=True)
class FrameResult:
    """One image that was looked at.

    topic, index: which image, counted from 0 in the order of time. image_size: (width, height); None where it
    could not be read. error: why it could not be, or why it is of no use; empty where it is. read_seconds covers
    decoding. stray: its size is another than nearly all others have.
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
    stray: bool = False

    @property
    def is_view(self) -> bool:
        return len(self.detection) > 0

    @property
    def reason(self) -> str:
        """Why the image is no view; empty where it is one."""
        return self.error or ("" if self.is_view else self.detection.reason or "the target was not found")


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
        return tuple(frame for frame in self.frames if frame.is_view)

    @property
    def unused(self) -> dict[str, str]:
        """Name of each image that was looked at and is no view → why; namesakes are numbered."""
        reasons: dict[str, str] = {}
        for frame in self.frames:
            if frame.is_view:
                continue
            name, number = frame.name, 1
            while name in reasons:
                number += 1
                name = f"{frame.name} ({number})"
            reasons[name] = frame.reason
        return reasons

    @property
    def points_given_up(self) -> dict[str, int]:
        """Why the second look gave up points of the first one → how many, the commonest first."""
        reasons = Counter(why for frame in self.views for why in frame.detection.given_up.values())
        return dict(reasons.most_common())

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
        strays = [frame for frame in self.frames if frame.stray]
        unreadable = [frame for frame in self.frames if frame.error and not frame.stray]
        if unreadable:
            parts.append(f"{len(unreadable)} unreadable ({unreadable[0].error})")
        if strays:
            parts.append(f"{len(strays)} left out ({strays[0].name}: {strays[0].error})")
        if self.views and (reasons := [frame.reason for frame in self.frames if not frame.is_view and not frame.error]):
            parts.append(f"in {len(reasons)} not ({counted(reasons)})")
        if self.available > len(self.frames):
            parts.append(f"{self.available - len(self.frames)} of {self.available} not looked at")
        if self.interrupted:
            parts.append("interrupted")
        remarks = [frame.detection.remark for frame in self.views if frame.detection.remark]
        also = [counted(remarks)] if remarks else []
        if given_up := self.points_given_up:
            told = ", ".join(f"{count} {why}" for why, count in given_up.items())
            also.append(f"{sum(given_up.values())} points of the first look given up: {told}")
        return "; ".join([", ".join(parts), *also])

    def observations(self, object_points: np.ndarray, disc_radius: float | None = None) -> Observations:
        """Every view's points, for a target of ``object_points`` (n, 3) m.

        Raises InputError where no image could be read or their sizes differ, CalibrationError where the target is in
        none.
        """
        differ = sizes_differ(self.frames)
        if differ is not None:
            raise InputError(f"{self.topic}: {differ}")
        views = self.views
        if not views:
            raise self._nothing_found()
        size = views[0].image_size
        assert size is not None  # of every image that was read
        return Observations.create(
            object_points=object_points,
            image_index=np.concatenate([np.full(len(view.detection), i) for i, view in enumerate(views)]),
            point_index=np.concatenate([view.detection.point_index for view in views]),
            pixels=np.concatenate([view.detection.pixels for view in views]),
            image_size=size,
            image_names=[view.name for view in views],
            disc_radius=disc_radius,
        )

    def _nothing_found(self) -> CalibrationError:
        if not self.frames:
            return CalibrationError(f"{self.topic}: no image was looked at")
        if self.bad_frames == len(self.frames):
            return InputError(f"{self.topic}: none of {self.bad_frames} images can be read: {self.frames[0].error}")
        reasons = counted([frame.reason for frame in self.frames])
        left = self.available - len(self.frames)
        others = ", or look at more images (`max_views`, `every`)" if left else ""
        which = f"{len(self.frames)} images" + (f" looked at, of {self.available}" if left else "")
        return CalibrationError(
            f"{self.topic}: the target was found in none of {which} ({reasons}); "
            f"check that the target file describes the printed target{others}"
        )


def counted(reasons: Sequence[str]) -> str:
    """The commonest reasons and how often each was given; those that differ in their numbers alone are one."""
    alike: dict[str, list[str]] = {}
    for reason in reasons:
        alike.setdefault(_NUMBER.sub("#", reason), []).append(reason)
    common = sorted(alike.values(), key=len, reverse=True)
    told = [f"{len(same)} ×: {Counter(same).most_common(1)[0][0]}" for same in common[:_REASONS]]
    rest = sum(map(len, common[_REASONS:]))
    return ", ".join([*told, *([f"{rest} × otherwise"] if rest else [])])


def sizes_differ(frames: Sequence[FrameResult]) -> str | None:
    """What is wrong with images of several sizes, none of which nearly all have; None where one has."""
    first: dict[tuple[int, int], FrameResult] = {}
    counts = _sizes(frames)
    if usual_size(frames) is not None or not counts:
        return None
    for frame in frames:
        if frame.image_size is not None:
            first.setdefault(frame.image_size, frame)
    listed = [f"{first[size].name} is {_times(size)} ({count} of that size)" for size, count in counts.most_common(2)]
    return (
        f"its images differ in size: {', '.join(listed)}; are they of two cameras? Give images of one size, "
        "or each camera's in a folder of its own"
    )


def usual_size(frames: Sequence[FrameResult]) -> tuple[int, int] | None:
    """The size (width, height) that all images have, or all but a few; None where none is."""
    counts = _sizes(frames)
    if not counts:
        return None
    size, count = counts.most_common(1)[0]
    others = sum(counts.values()) - count
    return size if _STRAYS * others <= count + others else None


def without_strays(frames: Sequence[FrameResult]) -> tuple[FrameResult, ...]:
    """The frames, those of another size than the usual one as images that cannot be used."""
    usual = usual_size(frames)
    return tuple(
        frame
        if usual is None or frame.image_size in (None, usual)
        else replace(
            frame,
            image_size=None,
            detection=Detection(),
            error=f"it is {_times(frame.image_size)}, the others are {_times(usual)}",
            stray=True,
        )
        for frame in frames
    )


def _sizes(frames: Sequence[FrameResult]) -> Counter[tuple[int, int]]:
    return Counter(frame.image_size for frame in frames if frame.image_size is not None)


def _times(size: tuple[int, int] | None) -> str:
    return "of no size" if size is None else f"{size[0]} × {size[1]}"
