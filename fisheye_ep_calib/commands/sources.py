"""From SOURCE arguments to one set of observations a camera, for every command that takes them."""

from __future__ import annotations

import argparse
import re
import sys
import time
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.collection import Collector, DetectionRun, FrameChoice
from fisheye_ep_calib.commands.resuming import Log, keeping_what_was_found, refuse_interrupted
from fisheye_ep_calib.cores import usable_cores
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.recording import Recording, choose_topics, open_recording
from fisheye_ep_calib.target import Target, load_target

_NAME = re.compile(r"[^\W_][\w.-]*")
_LONGEST = 200  # bytes: file systems take 255, and endings are to come


@dataclass(frozen=True)
class CameraSource:
    """One camera's observations and where they came from.

    found: the observations, or why there are none. seconds: spent in "read" and "detect". unused_views: image name →
    why it is no view. run: None for an observation file. image: reads the image of that number, grey (h, w), while
    the sources are open.
    """

    name: str
    found: Observations | CalibrationError
    source: str
    seconds: dict[str, float] = field(default_factory=lambda: {"read": 0.0, "detect": 0.0})
    unused_views: dict[str, str] = field(default_factory=dict)
    run: DetectionRun | None = None
    image: Callable[[int], np.ndarray] | None = None

    @property
    def observations(self) -> Observations:
        """Raises CalibrationError where the target was not found."""
        if isinstance(self.found, CalibrationError):
            raise self.found
        return self.found


@dataclass(frozen=True)
class Looking:
    """A recording while its images are looked at. topics: camera name → topic. opened: seconds it took to open."""

    recording: Recording
    target: Target
    collector: Collector
    topics: dict[str, str]
    choice: FrameChoice
    opened: float


def add_source_arguments(parser: argparse.ArgumentParser, many: bool) -> None:
    """The arguments that ``camera_sources`` reads."""
    kinds = "a bag (rosbag2 folder, .mcap, .db3, ROS 1 .bag), a folder of images, or an observation file .npz"
    parser.add_argument("source", nargs="+" if many else 1, metavar="SOURCE", help=kinds)
    parser.add_argument("--split", help="of an observation file, only the images with this mark, such as train")
    add_looking_arguments(parser)


def add_looking_arguments(parser: argparse.ArgumentParser) -> None:
    """What to look for, and in which images."""
    parser.add_argument("--target", type=Path, metavar="TARGET.yaml", help="the target; an .npz needs none")
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="NAME=TOPIC",
        help="image topic of camera NAME; repeat for several cameras",
    )
    looking = parser.add_argument_group("which images to look at")
    looking.add_argument(
        "--max-views", type=int, default=150, metavar="N", help="choose at most N a camera (default: 150), unless:"
    )
    which = looking.add_mutually_exclusive_group()
    which.add_argument("--every", type=int, metavar="N", help="every N-th image, whatever it shows")
    which.add_argument("--all", action="store_true", help="every image")
    looking.add_argument("--strict", action="store_true", help="refuse damaged recordings and images")
    looking.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core)")
    looking.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="look on the workers of this Dask cluster instead; they read the recording at the same path "
        "(pip install 'fisheye_ep_calib[cluster]')",
    )


@contextmanager
def looking(arguments: argparse.Namespace, log: Log | None = None) -> Iterator[Looking]:
    """Open the recording and the workers that look at its images. log: where to keep what they find meanwhile."""
    if arguments.target is None:
        raise InputError("images need --target TARGET.yaml, which says what to look for")
    target = load_target(arguments.target)
    if log is not None and log.resume and not log.path.exists():
        print(f"nothing to resume: there is no {log.path}", file=sys.stderr)
    began = time.perf_counter()
    with open_recording(arguments.source, strict=arguments.strict) as recording:
        for problem in recording.problems:
            print(f"warning: {problem}", file=sys.stderr)
        for note in recording.notes:
            print(f"note: {note}", file=sys.stderr)
        topics = _named_topics(recording, arguments.topic)
        for topic in topics.values():
            if len(folders := recording.folders(topic)) > 1:
                print(f"note: {', '.join(map(str, folders))} are taken for one camera, {topic}", file=sys.stderr)
        workers = usable_cores() if arguments.workers is None else arguments.workers
        choice = FrameChoice(arguments.max_views, 1 if arguments.all else arguments.every)
        with Collector(
            recording,
            target,
            workers=0 if workers == 1 else workers,
            strict=arguments.strict,
            scheduler=arguments.scheduler,
            log=log and log.path,
            resume=log is not None and log.resume,
        ) as collector:
            with keeping_what_was_found(collector):
                yield Looking(recording, target, collector, topics, choice, time.perf_counter() - began)


@contextmanager
def camera_sources(
    arguments: argparse.Namespace,
    log: Log | None = None,
    before_looking: Callable[[list[str]], None] = lambda names: None,
) -> Iterator[tuple[list[CameraSource], Callable | None]]:
    """Every camera's observations, and ``look_again(guides)`` where there are images to look at again.

    log: of what is found meanwhile; an interruption then ends it all, and keeps the log. before_looking: is called
    with the cameras' names before the images are looked at, to refuse what cannot end well.
    """
    paths = [Path(path) for path in arguments.source]
    files = [path for path in paths if path.suffix == ".npz"]
    if files and len(files) < len(paths):
        raise InputError("give observation files or recordings, not both at once")
    if files:
        for option in ("topic", "every", "all"):
            if getattr(arguments, option):
                raise InputError(f"--{option} is for images in recordings; an observation file has none")
        cameras = _differently_named([_from_file(path, arguments.split) for path in files])
        before_looking([camera.name for camera in cameras])
        yield cameras, None
        return
    if arguments.split is not None:
        raise InputError("--split is for observation files; recordings have none")
    source = ", ".join(map(str, paths))
    with looking(arguments, log) as place:
        before_looking(list(place.topics))
        runs = place.collector.collect(tuple(place.topics.values()), place.choice)
        refuse_interrupted(runs)
        cameras = [
            _with_images(from_run(name, runs[topic], place.target, source), place.recording)
            for name, topic in place.topics.items()
        ]
        cameras = [replace(one, seconds={**one.seconds, "read": one.seconds["read"] + place.opened}) for one in cameras]
        if all(isinstance(one.found, InputError) for one in cameras):
            place.collector.forget()  # the images themselves are at fault: to look at more of them is no help

        def look_again(guides):
            refined = place.collector.refine(guides)
            refuse_interrupted(refined)
            return {
                name: _with_images(from_run(name, refined[topic], place.target, source), place.recording)
                for name, topic in place.topics.items()
                if topic in refined
            }

        yield cameras, look_again


def _differently_named(cameras: list[CameraSource]) -> list[CameraSource]:
    """Results are named after the files: two of one name would overwrite each other."""
    first: dict[str, str] = {}
    for camera in cameras:
        if camera.name.lower() in first:
            raise InputError(
                f"{first[camera.name.lower()]} and {camera.source} would both be called {camera.name}: rename one"
            )
        first[camera.name.lower()] = camera.source
    return cameras


def _with_images(camera: CameraSource, recording: Recording) -> CameraSource:
    """The camera's source with its images at hand."""
    run = camera.run
    if run is None:
        return camera
    return replace(camera, image=lambda number: recording.frame(run.topic, run.views[number].index).image())


def _from_file(path: Path, split: str | None) -> CameraSource:
    began = time.perf_counter()
    observations = load_observations(path)
    if split is not None:
        if observations.split is None:
            raise InputError(f"{path} marks no image as {split}: it has no split")
        observations = observations.select_images(np.flatnonzero(observations.split == split))
        if len(observations.pixels) == 0:
            raise InputError(f"{path} marks no image as {split}")
    read = {"read": time.perf_counter() - began, "detect": 0.0}
    return CameraSource(safe_name(path.stem), observations, str(path), read)


def from_run(name: str, run: DetectionRun, target: Target, source: str) -> CameraSource:
    """One camera's source from what was seen by it; says so on stderr."""
    print(run.summary(), file=sys.stderr)
    found: Observations | CalibrationError
    try:
        found = run.observations(target.object_points, target.disc_radius)
    except CalibrationError as error:
        found = error
    seconds = {"read": run.read_seconds, "detect": run.detect_seconds}
    return CameraSource(name, found, source, seconds, run.unused, run)


def _named_topics(recording: Recording, given: list[str]) -> dict[str, str]:
    """Camera name → topic, from NAME=TOPIC or TOPIC arguments, the only image topic, or every folder of images."""
    named = topics_given(given)
    topics = choose_topics(recording, tuple(named.values()), several=True)
    return named or dict(zip(numbered_alike(map(camera_name, topics)), topics, strict=True))


def topics_given(given: list[str]) -> dict[str, str]:
    """Camera name → topic, from NAME=TOPIC or TOPIC arguments. Raises InputError."""
    named: dict[str, str] = {}
    for text in given:
        name, equals, topic = text.rpartition("=")
        name = name if equals else camera_name(topic)
        if not _NAME.fullmatch(name):
            raise InputError(f"--topic {text}: a camera's name is made of letters, digits and _ . -")
        if name in named:
            raise InputError(f"--topic {text}: there are two cameras called {name}")
        named[name] = topic
    return named


def camera_name(topic: str) -> str:
    """A camera's name from its image topic: /front/image_raw is front."""
    parts = [part for part in topic.split("/") if part]
    while len(parts) > 1 and parts[-1] in ("image_raw", "image", "image_mono", "image_color", "compressed"):
        parts.pop()
    return safe_name("_".join(parts))


def safe_name(text: str) -> str:
    """A name that is safe as a file's: letters and digits of any script, _ . and -; at most 200 bytes in UTF-8."""
    name = re.sub(r"[^\w.-]+", "_", unicodedata.normalize("NFC", text)).strip("._-")
    return name.encode()[:_LONGEST].decode(errors="ignore") or "camera"


def image_stem(name: str) -> str:
    """An image's name, safe as a file's: without what tells its format, with the whole of a time 12.000000001."""
    return safe_name(name if re.fullmatch(r"\d+\.\d+", name) else Path(name).stem)


def numbered_alike(names: Iterable[str]) -> list[str]:
    """The names, the later ones of those that differ in nothing but case numbered: a, A_2."""
    result: list[str] = []
    taken: set[str] = set()
    for stem in names:
        name, number = stem, 1
        while name.casefold() in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name.casefold())
        result.append(name)
    return result
