"""From a recording or observation files to what each camera of a rig saw, and when."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.collection.progress import progress_bar
from fisheye_ep_calib.collection.results import DetectionRun, FrameResult, without_strays
from fisheye_ep_calib.collection.workers import FrameWorkers, Job
from fisheye_ep_calib.commands.sources import camera_name, safe_name
from fisheye_ep_calib.cores import usable_cores
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rig.synchronisation import nearest_ns, numbers_of_names, simultaneous
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.recording import Recording, choose_topics, open_recording
from fisheye_ep_calib.storage.sources.image_names import times_in_names
from fisheye_ep_calib.target import Target, load_target

_RECORDED_WITHIN = 50_000_000  # ns: images of one moment may be recorded this much later than others


@dataclass(frozen=True)
class Seen:
    """What one camera saw. stamps_ns: by image number. topic: empty where it is not known.

    numbered: the stamps count images instead of nanoseconds, so that only equal ones are of the same time.
    """

    observations: Observations
    stamps_ns: np.ndarray
    topic: str
    numbered: bool
    unmistakable: bool


def what_cameras_saw(names: Sequence[str], arguments: argparse.Namespace) -> dict[str, Seen]:
    """For each camera of the rig, by name. Raises InputError where a camera has no source."""
    files = [Path(path) for path in arguments.source if Path(path).suffix == ".npz"]
    if files and len(files) < len(arguments.source):
        raise InputError("give observation files or recordings, not both at once")
    if files:
        return _from_files(names, files)
    if arguments.target is None:
        raise InputError("images need --target TARGET.yaml, which says what to look for")
    target = load_target(arguments.target)
    with open_recording(arguments.source, strict=arguments.strict) as recording:
        for problem in recording.problems:
            print(f"warning: {problem}", file=sys.stderr)
        return _from_recording(names, recording, target, arguments)


def _from_files(names: Sequence[str], files: Sequence[Path]) -> dict[str, Seen]:
    by_name = {safe_name(path.stem): path for path in files}
    missing = [name for name in names if name not in by_name]
    if missing:
        raise InputError(f"there is no {missing[0]}.npz among the observation files for --camera {missing[0]}")
    seen = {}
    for name in names:
        observations = load_observations(by_name[name])
        times = times_in_names(observations.image_names)
        numbered = times is None
        stamps = (
            _numbers_of_names(observations.image_names, by_name[name]) if times is None else np.array(times, np.int64)
        )
        seen[name] = Seen(observations, stamps, "", numbered, False)
    if len({one.numbered for one in seen.values()}) > 1:
        raise InputError("the images of some cameras are named by their time, those of others are not")
    return seen


def _numbers_of_names(names: Sequence[str], path: Path) -> np.ndarray:
    """The last number in each image's name, for images that no clock has stamped."""
    numbers = []
    for name in names:
        found = re.findall(r"\d{1,18}", Path(name).stem)
        if not found:
            raise InputError(f"{path}: image {name!r} has neither time nor number to match it with other cameras by")
        numbers.append(int(found[-1]))
    if len(set(numbers)) < len(numbers):
        raise InputError(f"{path}: two images have the same number, so it is not clear which others they go with")
    return np.array(numbers, dtype=np.int64)


def _from_recording(names, recording: Recording, target: Target, arguments: argparse.Namespace) -> dict[str, Seen]:
    topics = _topics(names, recording, arguments.topic)
    stamps, numbered = _stamps(topics, recording)
    auto = arguments.time_offset == "auto"
    if auto and numbered:
        raise InputError("--time-offset is for images with times; these are paired by their numbers or their order")
    moments = _moments(list(topics), stamps, numbered, auto, arguments.tolerance)
    found = _look(recording, target, list(topics.values()), moments, arguments)
    seen = {}
    for camera, (name, topic) in enumerate(topics.items()):
        run = DetectionRun(
            topic, recording.count(topic), without_strays([found[camera][i] for i in sorted(found[camera])])
        )
        print(run.summary(), file=sys.stderr)
        observations = run.observations(target.object_points, target.disc_radius)
        if numbered:
            taken = stamps[camera][[view.index for view in run.views]]
        else:  # by the camera's clock, so that saved observations can be matched too
            taken = np.array([recording.frame(topic, view.index).taken_ns for view in run.views], dtype=np.int64)
            by_time = tuple(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in taken.tolist())
            observations = replace(observations, image_names=by_time)
        seen[name] = Seen(observations, taken, topic, numbered, target.unmistakable)
    return seen


def _stamps(topics: dict[str, str], recording: Recording) -> tuple[list[np.ndarray], bool]:
    """When each camera's images were recorded, or numbers that are equal for images of the same time; which of the two.

    Raises InputError where neither is known.
    """
    timed = {recording.timed(topic) for topic in topics.values()}
    if len(timed) > 1:
        raise InputError("images with times, of bags or in names, cannot be matched with numbered ones")
    stamps = [np.array(recording.stamps(topic), dtype=np.int64) for topic in topics.values()]
    if timed == {True}:
        return stamps, False
    counts = [len(one) for one in stamps]
    names = [
        [recording.frame(topic, i).name for i in range(n)] for topic, n in zip(topics.values(), counts, strict=True)
    ]
    numbers = numbers_of_names(names)
    if numbers is not None:
        if len(set(counts)) > 1:
            print("note: images are paired by the numbers in their names", file=sys.stderr)
        return numbers, True
    if len(set(counts)) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in zip(topics, counts, strict=True))
        raise InputError(
            f"which images are of the same time? Their names hold neither times nor numbers that go together, and "
            f"their counts differ ({listed}): name them by time or number"
        )
    print("note: images have no times: they are paired by their order", file=sys.stderr)
    return stamps, True


def _moments(
    names: Sequence[str], stamps: Sequence[np.ndarray], numbered: bool, auto: bool, tolerance: float
) -> np.ndarray:
    """Image numbers (m, C) of moments in which two cameras have an image, −1 for none. Raises InputError without any.

    auto: the clocks may differ; images are then taken by their order where none are of the same time.
    """
    within = 0 if numbered else max(_RECORDED_WITHIN, round(tolerance * 1e9))
    moments = simultaneous(stamps, within)
    moments = moments[(moments >= 0).sum(axis=1) > 1]
    least = min(map(len, stamps))
    if auto and 2 * len(moments) < least:
        moments = np.stack([np.linspace(0, len(one) - 1, least).round().astype(int) for one in stamps], axis=1)
    if len(moments) == 0:
        gaps = [
            (nearest_ns(stamps[a], stamps[b]), names[a], names[b])
            for a in range(len(stamps))
            for b in range(a + 1, len(stamps))
        ]
        gap, a, b = min(gaps)
        said = "no two cameras have images of the same time"
        if not numbered:
            said += (
                f": those of {a} and {b} are {1e-9 * gap:.3f} s apart at least; --tolerance SECONDS where the target "
                "stood still, --time-offset auto where the clocks differ"
            )
        raise InputError(said)
    return moments


def _topics(names: Sequence[str], recording: Recording, given: Sequence[str]) -> dict[str, str]:
    """Camera name → topic, from NAME=TOPIC arguments or from what the topics are called."""
    topics = {camera_name(topic.name): topic.name for topic in recording.image_topics()}
    for text in given:
        name, equals, topic = text.partition("=")
        if not equals or name not in names:
            raise InputError(f"--topic {text}: give NAME=TOPIC with the NAME of a --camera")
        topics[name] = topic
    missing = [name for name in names if name not in topics]
    if missing:
        listed = ", ".join(map(str, recording.image_topics()))
        raise InputError(f"which topic is {missing[0]}'s? Give --topic {missing[0]}=TOPIC; image topics: {listed}")
    chosen = {name: topics[name] for name in names}
    choose_topics(recording, tuple(chosen.values()))
    return chosen


def _look(recording: Recording, target: Target, topics: list[str], moments: np.ndarray, arguments):
    """For each camera the images looked at, by number: half of them evenly spread, half where two saw the target."""
    found: list[dict[int, FrameResult]] = [{} for _ in topics]
    workers = usable_cores() if arguments.workers is None else arguments.workers
    frames = FrameWorkers(recording, target, 0 if workers == 1 else workers)
    looked: set[int] = set()
    expected = min(arguments.max_moments, len(moments)) * len(topics)
    try:
        with progress_bar(what="looking for the target", total=expected) as bar:
            for rows in (_spread(len(moments), arguments.max_moments), None):
                chosen = _between(moments, found, looked, arguments.max_moments) if rows is None else rows
                looked.update(chosen)
                pairs = [(c, int(moments[row, c])) for row in chosen for c in np.flatnonzero(moments[row] >= 0)]
                jobs = [Job(topics[camera], image) for camera, image in pairs]
                frames.add(jobs)
                while (result := frames.next_result()) is not None:
                    if result.error and arguments.strict:
                        raise InputError(f"{result.topic}, image {result.name}: {result.error}")
                    found[topics.index(result.topic)][result.index] = result
                    bar.update()
    finally:
        frames.close()
    return found


def _spread(count: int, most: int) -> list[int]:
    if count <= most:
        return list(range(count))
    return np.unique(np.linspace(0, count - 1, max(2, most // 2)).round().astype(int)).tolist()


def _between(moments: np.ndarray, found, looked: set[int], most: int) -> list[int]:
    """Moments not looked at yet that are nearest to ones in which two cameras saw the target."""
    left = [row for row in range(len(moments)) if row not in looked]
    good = [row for row in looked if sum(_saw(found, c, image) for c, image in enumerate(moments[row])) > 1]
    if not left or not good:
        return []
    distance = np.abs(np.subtract.outer(left, good)).min(axis=1)
    return [left[i] for i in np.argsort(distance, kind="stable")[: max(0, most - len(looked))]]


def _saw(found, camera: int, image: int) -> bool:
    return image in found[camera] and found[camera][image].found
