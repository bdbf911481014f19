"""What the names of image files tell: which of several cameras took an image, and when."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import PurePath
from typing import TypeAlias

MOST_CAMERAS = 12
_ALIKE = 0.6  # of the larger camera's images the smaller one has at least, and of its numbers the other one has too
_STRAY = 0.1  # of the images may belong to no camera
_MOST_STRAYS = 3

_SIDES = r"left|right|front|rear|back|l|r"
# Left, right, top and bottom are places of a board before one camera as well: only these sets are cameras.
_SIDE_SETS = ({"left", "right"}, {"front", "rear"}, {"front", "rear", "left", "right"})
_SAME_SIDE = {"l": "left", "r": "right", "back": "rear"}
_DEVICES = r"cam|camera|fisheye|fish|lens|sensor|gopro|webcam|device"
_MARKS = (
    re.compile(rf"(?<![a-z])({_SIDES})(?![a-z])"),
    re.compile(r"(left|right)(?![a-z])|(?<![a-z])(left|right)"),
    re.compile(rf"(?<![a-z])(?:{_DEVICES})[ _-]?(?:\d+|[a-h](?![a-z]))"),
)

_Reading: TypeAlias = tuple[str, str, tuple[int, ...]]  # camera, rest and numbers of a name

# The digits of a time since 1970 → nanoseconds a unit.
_UNITS = {10: 10**9, 13: 10**6, 16: 10**3, 19: 1}
_EARLIEST, _LATEST = 10**18, 4 * 10**18  # 2001 to 2096
_SECONDS = re.compile(r"(?<![\d.])(\d{1,10})\.(\d{3,9})(?![\d.])")


@dataclass(frozen=True)
class NamedCameras:
    """Which images each camera took. numbers: camera → places in the list of names. strays: places of the others."""

    numbers: dict[str, list[int]]
    strays: tuple[int, ...] = ()


def stem(name: str) -> str:
    """A file's name without what tells its format, the whole of a time 12.000000001 that was given no ending."""
    return name if re.fullmatch(r"\d+\.\d+", name) else PurePath(name).stem


def cameras_in_names(
    names: Sequence[str], size_of: Callable[[int], tuple[int, int] | None] | None = None
) -> NamedCameras | None:
    """The cameras that took the images of one folder, by their names; None where they are of one, as far as is clear.

    Clear is: words that name cameras (left, right, cam0, cam1 …) with as many images each and the same numbers; or
    whatever words, where both cameras have images of the same time or each has one size of its own, which
    ``size_of`` reads from the image of that place.
    """
    words = [re.sub(r"(?<=[a-z])(?=[A-Z])", "_", stem(name)).lower() for name in names]
    for mark in _MARKS:
        cameras = _split(words, partial(_marked, mark))
        if cameras is not None and _are_cameras(cameras.numbers):
            return cameras
    cameras = _split(words, _skeleton)
    if cameras is None or cameras.strays:
        return None
    if _same_times(words, cameras) or (size_of is not None and _sizes_of_their_own(cameras, size_of)):
        return cameras
    return None


def _marked(mark: re.Pattern[str], word: str) -> _Reading | None:
    """Camera, rest and numbers of a name; None where no camera or no number is in it."""
    match = mark.search(word)
    if match is None:
        return None
    camera = re.sub(r"[ _-]", "", match[0])
    rest = f"{word[: match.start()]}|{word[match.end() :]}"
    numbers = tuple(map(int, re.findall(r"\d{1,30}", rest)))
    return (_SAME_SIDE.get(camera, camera), re.sub(r"\d+", "#", rest), numbers) if numbers else None


def _skeleton(word: str) -> _Reading | None:
    """As _marked, with all that is no number as the camera."""
    numbers = tuple(map(int, re.findall(r"\d{1,30}", word)))
    camera = re.sub(r"[\W_]+", "_", re.sub(r"\d+", "", word)).strip("_")
    return (camera, "", numbers) if numbers and camera else None


def _split(words: Sequence[str], reading: Callable[[str], _Reading | None]) -> NamedCameras | None:
    """Images by camera, where the cameras have about as many, of the same numbers, named in the same way."""
    readings = [reading(word) for word in words]
    rests = [parts[1] for parts in readings if parts is not None]
    if not rests:
        return None
    usual = max(set(rests), key=rests.count)
    cameras: dict[str, list[int]] = {}
    numbers_of: dict[str, set[tuple[int, ...]]] = {}
    strays = []
    for place, parts in enumerate(readings):
        if parts is None or parts[1] != usual:
            strays.append(place)
        else:
            cameras.setdefault(parts[0], []).append(place)
            numbers_of.setdefault(parts[0], set()).add(parts[2])
    if not 2 <= len(cameras) <= MOST_CAMERAS or len(strays) > min(_MOST_STRAYS, _STRAY * len(words)):
        return None
    numbers = list(numbers_of.values())
    fewest, most = min(map(len, numbers)), max(map(len, numbers))
    if fewest < 2 or fewest < _ALIKE * most or sum(map(len, numbers)) != len(words) - len(strays):
        return None
    if any(len(first & second) < _ALIKE * min(len(first), len(second)) for first in numbers for second in numbers):
        return None
    return NamedCameras(dict(sorted(cameras.items())), tuple(strays))


def _are_cameras(cameras: dict[str, list[int]]) -> bool:
    return any(character.isdigit() for character in next(iter(cameras))) or set(cameras) in (
        *_SIDE_SETS,
        *({f"{device}{letter}" for letter in "abcdefgh"[: len(cameras)]} for device in _DEVICES.split("|")),
    )


def _same_times(words: Sequence[str], cameras: NamedCameras) -> bool:
    """One camera does not take two images in the same microsecond."""
    return all(
        any(len(digits) in (16, 19) for digits in re.findall(r"\d+", words[place])) or _SECONDS.search(words[place])
        for places in cameras.numbers.values()
        for place in places
    )


def _sizes_of_their_own(cameras: NamedCameras, size_of: Callable[[int], tuple[int, int] | None]) -> bool:
    sizes = [{size_of(places[i]) for i in (0, len(places) // 2, -1)} for places in cameras.numbers.values()]
    return all(len(of_camera) == 1 and None not in of_camera for of_camera in sizes) and len(
        set().union(*sizes)
    ) == len(sizes)


def times_in_names(names: Sequence[str]) -> list[int] | None:
    """Nanoseconds, where every name holds a time of its own; None where any does not.

    A time is seconds with a dot and three to nine decimals, or seconds, milliseconds, microseconds or nanoseconds
    since 1970 of 10, 13, 16 or 19 digits.
    """
    for reading in (_dotted_time, _whole_time):
        times = [reading(stem(name)) for name in names]
        if None not in times and len(set(times)) == len(times) > 0:
            return times  # type: ignore[return-value]
    return None


def _dotted_time(word: str) -> int | None:
    matches = _SECONDS.findall(word)
    if len(matches) != 1:
        return None
    seconds, decimals = matches[0]
    return int(seconds) * 10**9 + int(decimals.ljust(9, "0"))


def _whole_time(word: str) -> int | None:
    runs = [digits for digits in re.findall(r"\d+", word) if len(digits) in _UNITS]
    if len(runs) != 1:
        return None
    time = int(runs[0]) * _UNITS[len(runs[0])]
    return time if _EARLIEST <= time < _LATEST else None
