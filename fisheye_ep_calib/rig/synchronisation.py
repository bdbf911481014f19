"""Which images of several cameras were taken at the same time."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.errors import InputError

_STAMP = re.compile(r"(\d{1,11})\.(\d{9})")  # what the images of a recording are called: seconds.nanoseconds


def simultaneous(stamps_ns: Sequence[np.ndarray], tolerance_ns: int) -> np.ndarray:
    """Moments (m, cameras) int, in the order of time: the image of each camera, or −1 where it has none.

    stamps_ns: of each camera's images (V_c,), any order. Images of a moment lie within the tolerance, one a camera
    at most. The nearest neighbours in time are joined first, so that a wide tolerance does not pair the wrong ones.
    """
    camera = np.concatenate([np.full(len(stamps), number) for number, stamps in enumerate(stamps_ns)]).astype(int)
    image = np.concatenate([np.arange(len(stamps)) for stamps in stamps_ns]).astype(int)
    stamp = np.concatenate([np.asarray(stamps, dtype=np.int64) for stamps in stamps_ns])
    order = np.argsort(stamp, kind="stable")
    camera, image, stamp = camera[order], image[order], stamp[order]
    gap = np.diff(stamp)
    # Moments are runs of the sorted images, told by where they begin.
    begins = np.concatenate([np.ones(min(len(stamp), 1), bool), gap > tolerance_ns])
    plain = _whole_moments(stamp, camera, begins, tolerance_ns)
    begins |= ~plain
    first, last = np.arange(len(stamp)), np.arange(len(stamp))  # kept for the ends of each run
    close = np.flatnonzero(~plain[:-1] & (gap <= tolerance_ns))
    for left in close[np.argsort(gap[close], kind="stable")]:
        start, end = first[left], last[left + 1]
        cameras = camera[start : end + 1]
        if stamp[end] - stamp[start] <= tolerance_ns and len(np.unique(cameras)) == len(cameras):
            first[end], last[start] = start, end
            begins[left + 1] = False
    moment = np.cumsum(begins) - 1
    moments = np.full((int(begins.sum()), len(stamps_ns)), -1)
    moments[moment, camera] = image
    return moments


def _whole_moments(stamp: np.ndarray, camera: np.ndarray, begins: np.ndarray, tolerance_ns: int) -> np.ndarray:
    """Which sorted images (n,) are of a group, begun where the gap is wide, that is one moment as it is."""
    group = np.cumsum(begins) - 1
    count = np.bincount(group)
    end = np.cumsum(count) - 1
    of_camera = int(camera.max(initial=0)) + 1
    cameras = np.bincount(np.unique(group * of_camera + camera) // of_camera, minlength=len(count))
    whole: np.ndarray = ((stamp[end] - stamp[begins] <= tolerance_ns) & (cameras == count))[group]
    return whole


def nearest_ns(first: np.ndarray, second: np.ndarray) -> int:
    """The least time between images of two cameras (n,), (m,); both not empty."""
    first, second = np.sort(np.asarray(first, dtype=np.int64)), np.asarray(second, dtype=np.int64)
    place = np.searchsorted(first, second)
    before, after = first[np.maximum(place - 1, 0)], first[np.minimum(place, len(first) - 1)]
    return int(np.minimum(np.abs(second - before), np.abs(after - second)).min())


def numbers_of_names(names: Sequence[Sequence[str]]) -> list[np.ndarray] | None:
    """Of each camera's images, the last number in each name (V_c,); None where these do not go together.

    They do where every image has a number of its own, and most of each camera's are another's too.
    """
    numbers = []
    for of_camera in names:
        in_names = [re.findall(r"\d{1,18}", re.sub(r"\.\w{1,5}$", "", name)) for name in of_camera]
        if not all(in_names):
            return None
        numbers.append(np.array([int(digits[-1]) for digits in in_names], dtype=np.int64))
    if any(len(np.unique(own)) < len(own) for own in numbers):
        return None
    for own in numbers:
        if not any(2 * np.isin(own, other).sum() > len(own) for other in numbers if other is not own):
            return None
    return numbers


def stamps_of_names(names: Sequence[str]) -> np.ndarray:
    """Nanoseconds (V,) from images' names as recordings give them, seconds.nanoseconds. Raises InputError."""
    stamps = []
    for name in names:
        match = _STAMP.fullmatch(name)
        if match is None:
            raise InputError(f"image {name!r} is not named by its time, so it cannot be matched with other cameras")
        stamps.append(int(match[1]) * 10**9 + int(match[2]))
    return np.array(stamps, dtype=np.int64)
