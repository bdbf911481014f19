"""Which images of a recording several cameras took at the same time: by their times, their numbers, or their order."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rig.synchronisation import nearest_ns, numbers_of_names, simultaneous
from fisheye_ep_calib.storage.recording import Recording

_log = logging.getLogger(__name__)
_RECORDED_WITHIN = 50_000_000  # ns: images of one moment may be recorded this much later than others


@dataclass(frozen=True)
class Stamps:
    """of_cameras: each camera's (V,), when its images were recorded, ns; or, where they are numbered, numbers that are
    equal for images of the same time.
    """

    names: tuple[str, ...]
    of_cameras: tuple[np.ndarray, ...]
    numbered: bool


def recorded_stamps(topics: Mapping[str, str], recording: Recording) -> Stamps:
    """Of the images of these cameras (name → topic). Raises InputError where nothing tells which go together."""
    names = tuple(topics)
    timed = {recording.timed(topic) for topic in topics.values()}
    if len(timed) > 1:
        raise InputError("images with times, of bags or in names, cannot be matched with numbered ones")
    stamps = tuple(np.array(recording.stamps(topic), dtype=np.int64) for topic in topics.values())
    if timed == {True}:
        return Stamps(names, stamps, False)
    counts = [len(of_camera) for of_camera in stamps]
    called = [
        [recording.frame(topic, i).name for i in range(n)] for topic, n in zip(topics.values(), counts, strict=True)
    ]
    numbers = numbers_of_names(called)
    if numbers is not None:
        if len(set(counts)) > 1:
            _log.info("note: images are paired by the numbers in their names")
        return Stamps(names, tuple(numbers), True)
    if len(set(counts)) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in zip(names, counts, strict=True))
        raise InputError(
            f"which images are of the same time? Their names hold neither times nor numbers that go together, and "
            f"their counts differ ({listed}): name them by time or number"
        )
    _log.info("note: images have no times: they are paired by their order")
    return Stamps(names, stamps, True)


def recorded_moments(stamps: Stamps, tolerance: float, clocks_differ: bool = False) -> np.ndarray:
    """Image numbers (m, C) of moments in which two cameras have an image, −1 for none. Raises InputError without any.

    tolerance: seconds. clocks_differ: images are taken by their order where few are of the same time.
    """
    if clocks_differ and stamps.numbered:
        raise InputError("`time_offset` is for images with times; these are paired by their numbers or their order")
    within = 0 if stamps.numbered else max(_RECORDED_WITHIN, round(tolerance * 1e9))
    moments = simultaneous(stamps.of_cameras, within)
    moments = moments[(moments >= 0).sum(axis=1) > 1]
    least = min(map(len, stamps.of_cameras))
    if clocks_differ and 2 * len(moments) < least:
        by_order = [np.linspace(0, len(of_camera) - 1, least).round().astype(int) for of_camera in stamps.of_cameras]
        moments = np.stack(by_order, axis=1)
    if len(moments) == 0:
        raise InputError("no two cameras have images of the same time" + _nearest(stamps))
    return moments


def _nearest(stamps: Stamps) -> str:
    if stamps.numbered:
        return ""
    names: Sequence[str] = stamps.names
    gap, a, b = min(
        (nearest_ns(stamps.of_cameras[a], stamps.of_cameras[b]), names[a], names[b])
        for a in range(len(names))
        for b in range(a + 1, len(names))
    )
    return (
        f": those of {a} and {b} are {1e-9 * gap:.3f} s apart at least; `tolerance` SECONDS where the target "
        "stood still, `time_offset` auto where the clocks differ"
    )
