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
from fisheye_ep_calib.rig.synchronisation import simultaneous, stamps_of_names
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.recording import Recording, choose_topics, open_recording
from fisheye_ep_calib.storage.sources.image_files import IMAGE_FILE
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
        try:
            stamps, numbered = stamps_of_names(observations.image_names), False
        except InputError:
            stamps, numbered = _numbers_of_names(observations.image_names, by_name[name]), True
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
    numbered = {recording.topics[topic] == IMAGE_FILE for topic in topics.values()}
    if len(numbered) > 1:
        raise InputError("folders of images and bags cannot be matched in time")
    within = 0 if True in numbered else max(_RECORDED_WITHIN, round(arguments.tolerance * 1e9))
    stamps = [np.array(recording.stamps(topic), dtype=np.int64) for topic in topics.values()]
    moments = simultaneous(stamps, within)
    moments = moments[(moments >= 0).sum(axis=1) > 1]
    if len(moments) == 0:
        raise InputError("no two cameras have images of the same time in this recording")
    found = _look(recording, target, list(topics.values()), moments, arguments)
    seen = {}
    for camera, (name, topic) in enumerate(topics.items()):
        run = DetectionRun(
            topic, recording.count(topic), without_strays([found[camera][i] for i in sorted(found[camera])])
        )
        print(run.summary(), file=sys.stderr)
        taken = np.array([recording.frame(topic, view.index).taken_ns for view in run.views], dtype=np.int64)
        observations = run.observations(target.object_points, target.disc_radius)
        if True not in numbered:  # by the camera's clock, so that saved observations can be matched too
            by_time = tuple(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in taken.tolist())
            observations = replace(observations, image_names=by_time)
        seen[name] = Seen(observations, taken, topic, True in numbered, target.unmistakable)
    return seen


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
