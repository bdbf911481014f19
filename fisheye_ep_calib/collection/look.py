"""One look at one image: read, decoded, searched; and how long that may take."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.detection import Detection, Detector
from fisheye_ep_calib.target.second_look import look_again

# Seconds of processor time for one image: to read it, and to look at it, the latter and so much for each pixel.
READ_SECONDS, LOOK_SECONDS, SECONDS_A_PIXEL = 15.0, 8.0, 3e-7
ENDLESS = "looking at it takes without end; left out"


def limits() -> tuple[float, float]:
    """Seconds of processor time to read an image, and to look at it but for its pixels."""
    return READ_SECONDS, LOOK_SECONDS


@dataclass(frozen=True)
class Job:
    """One image to look at; with ``camera`` and ``camera_from_target`` (4, 4), where they say to look again.

    first: what was found before, then.
    """

    topic: str
    index: int
    camera: Any = None
    camera_from_target: np.ndarray | None = None
    first: Detection = field(default_factory=Detection)


def look(
    recording: Recording,
    detector: Detector,
    job: Job,
    seconds: tuple[float, float] = (READ_SECONDS, LOOK_SECONDS),
    allow: Callable[[float], None] = lambda seconds: None,
) -> FrameResult:
    """Read, decode and search one image; a bad image is a result too.

    seconds: for reading and for looking, of which ``allow`` is told as each begins.
    """
    frame = recording.frame(job.topic, job.index)
    started = time.perf_counter()
    allow(seconds[0])
    try:
        image = frame.image() if job.camera_from_target is None else frame.levels()
    except InputError as error:
        return failed_on(recording, job, str(error), time.perf_counter() - started)
    read = time.perf_counter()
    allow(seconds[1] + SECONDS_A_PIXEL * image.size)
    try:
        if job.camera_from_target is None:
            detection = detector.detect(image)
        else:
            detection = look_again(detector, image, job.camera, job.camera_from_target, job.first)
    except Exception as error:  # one strange image must not cost the others
        message = f"{type(error).__name__}: {first_line(error)}"
        return failed_on(recording, job, f"the detector failed on it ({message})")
    size = (image.shape[1], image.shape[0])
    return FrameResult(
        job.topic,
        job.index,
        frame.stamp_ns,
        frame.name,
        size,
        detection,
        read_seconds=read - started,
        detect_seconds=time.perf_counter() - read,
    )


def failed_on(recording: Recording, job: Job, error: str, seconds: float = 0.0) -> FrameResult:
    frame = recording.frame(job.topic, job.index)
    return FrameResult(job.topic, job.index, frame.stamp_ns, frame.name, None, Detection(), error, read_seconds=seconds)
