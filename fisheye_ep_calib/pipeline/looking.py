"""From a recording, or observation files, to what each camera saw."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.collection import Collector, DetectionRun, FrameChoice
from fisheye_ep_calib.collection.collector import Guide
from fisheye_ep_calib.collection.progress import OnProgress, seldom, unheard
from fisheye_ep_calib.errors import CalibrationError, InputError, Interrupted
from fisheye_ep_calib.outside import checked_paths
from fisheye_ep_calib.pipeline.camera_source import CameraSource, source_of_run, sources_of_files, within_memory
from fisheye_ep_calib.pipeline.found_so_far import Log, keeping_what_was_found
from fisheye_ep_calib.pipeline.names import Topics, named_topics
from fisheye_ep_calib.pipeline.options import LOOK_OPTIONS, refuse_unknown_options
from fisheye_ep_calib.storage.recording import Recording, open_recording
from fisheye_ep_calib.target import Target, load_target
from fisheye_ep_calib.worker_processes import usable_cores

_log = logging.getLogger(__name__)
Path_ = str | PathLike[str]
Source = Path_ | Sequence[Path_] | Recording


@dataclass(frozen=True)
class Look:
    """Which images are looked at, and by whom.

    topics: camera name → topic, or topics; None for the only one, or that of the camera called ``camera``. max_views:
    images chosen of a camera, None for 150, or fewer where they show nothing; unless every: each N-th image, whatever
    it shows. strict: damaged recordings and images are errors. workers: processes, one a core where it is None.
    scheduler: address of a Dask cluster that looks instead. log: keeps what was found so far.
    """

    topics: Topics = None
    camera: str = ""
    max_views: int | None = None
    every: int | None = None
    strict: bool = False
    workers: int | None = None
    scheduler: str | None = None
    log: Log | None = None
    on_progress: OnProgress = unheard

    @property
    def choice(self) -> FrameChoice:
        """Raises InputError where the numbers cannot be met."""
        return FrameChoice(self.max_views, self.every)


@dataclass(frozen=True)
class Looking:
    """A recording while its images are looked at. topics: camera name → topic. opened: seconds it took to open."""

    recording: Recording
    target: Target
    collector: Collector
    topics: dict[str, str]
    choice: FrameChoice
    source: str
    target_name: str
    opened: float

    def first_look(self) -> list[CameraSource]:
        """What every camera saw. Raises Interrupted where the user ended it."""
        return self._first(self.collector.collect(tuple(self.topics.values()), self.choice))

    def first_look_together(self, moments: np.ndarray) -> list[CameraSource]:
        """The same for images taken at the same time, moments (m, topics): an image's number each, −1 for none."""
        topics = tuple(self.topics.values())
        return self._first(self.collector.collect_moments(topics, moments, self.choice))

    def _first(self, runs: Mapping[str, DetectionRun]) -> list[CameraSource]:
        _refuse_interrupted(runs)
        cameras = [self._camera(name, runs[topic], self.opened) for name, topic in self.topics.items()]
        if all(isinstance(camera.outcome, InputError) for camera in cameras):
            self.collector.forget()  # the images themselves are at fault: to look at more of them is no help
        return [self._with_what_else(camera, runs[self.topics[camera.name]]) for camera in cameras]

    def _with_what_else(self, camera: CameraSource, run: DetectionRun) -> CameraSource:
        """The same; where no image shows the target, with the board of another kind that some images show."""
        error = camera.outcome
        if not isinstance(error, CalibrationError) or isinstance(error, InputError):
            return camera
        # What is seen was told already; and where all is blurred, dark squares look like discs.
        if " seen" in str(error) or "blurred by" in str(error):
            return camera
        from fisheye_ep_calib.target.what_else import what_else  # loads every detector

        read = [frame.index for frame in run.frames if not frame.error]
        seen: Counter[str] = Counter()
        for index in read[:: max(1, len(read) // _EXAMPLES)][:_EXAMPLES]:
            with suppress(InputError):
                seen[what_else(self.recording.frame(run.topic, index).image(), self.target)] += 1
        del seen[""]
        if not seen:
            return camera
        instead = seen.most_common(1)[0][0]
        told = CalibrationError(f"{error}: {instead} is seen instead")
        told.exit_code = error.exit_code
        return replace(camera, outcome=told)

    def look_again(self, guides: Sequence[Guide]) -> dict[str, CameraSource]:
        """What the guides' cameras saw, by name, where first calibrations say that the target is."""
        runs = self.collector.refine(guides)
        _refuse_interrupted(runs)
        return {name: self._camera(name, runs[topic]) for name, topic in self.topics.items() if topic in runs}

    def _camera(self, name: str, run: DetectionRun, opened: float = 0.0) -> CameraSource:
        return source_of_run(name, run, self.target, self.recording, self.source, self.target_name, opened)


_KEPT_BYTES = 2**26  # of decoded images, here and in every worker, for the second look and the report
_EXAMPLES = 3  # images in which another board is looked for

LookAgain = Callable[[Sequence[Guide]], dict[str, CameraSource]]


@contextmanager
def looking(source: Source, target: str | PathLike[str] | Target | None, look: Look) -> Iterator[Looking]:
    """Open the recording, if it is not open yet, and the workers that look at its images."""
    if target is None:
        raise InputError("images need `target`, which says what to look for")
    target_name = target.name if isinstance(target, Target) else str(target)
    loaded, log = load_target(target), look.log
    if log is not None and log.resume and not log.path.exists():
        _log.info("nothing to resume: there is no %s", log.path)
    began = time.perf_counter()
    with opened_once(source, look.strict) as recording:
        for problem in recording.problems:
            _log.warning("%s", problem)
        for note in recording.notes:
            _log.info("note: %s", note)
        topics = named_topics(recording, look.topics, look.camera)
        for topic in topics.values():
            if len(folders := recording.folders(topic)) > 1:
                _log.info("note: %s are taken for one camera, %s", ", ".join(map(str, folders)), topic)
        workers = usable_cores() if look.workers is None else look.workers
        with (
            nullcontext() if look.scheduler else recording.keeping_decoded(_KEPT_BYTES),
            Collector(
                recording,
                loaded,
                workers=0 if workers == 1 else workers,
                strict=look.strict,
                scheduler=look.scheduler,
                log=None if log is None else log.path,
                resume=log is not None and log.resume,
                on_progress=look.on_progress,
            ) as collector,
        ):
            with keeping_what_was_found(collector):
                opened = time.perf_counter() - began
                yield Looking(
                    recording, loaded, collector, topics, look.choice, _said(source, recording), target_name, opened
                )


@contextmanager
def camera_sources(
    source: Source,
    target: str | PathLike[str] | Target | None,
    look: Look,
    *,
    split: str | None = None,
    before_looking: Callable[[list[str]], None] = lambda names: None,
) -> Iterator[tuple[list[CameraSource], LookAgain | None]]:
    """What every camera saw, and ``look_again(guides)`` where there are images to look at again.

    source: a recording, or observation files (.npz), of which ``split`` marks those to use. before_looking: is called
    with the cameras' names before the images are looked at, to refuse what cannot end well.
    """
    files = observation_files(source)
    if files:
        for option in ("topics", "every"):
            if getattr(look, option):
                raise InputError(f"`{option}` is for images in recordings; an observation file has none")
        cameras = [within_memory(camera) for camera in sources_of_files(files, split)]
        before_looking([camera.name for camera in cameras])
        yield cameras, None
        return
    if split is not None:
        raise InputError("`split` is for observation files; recordings have none")
    with looking(source, target, look) as place:
        before_looking(list(place.topics))
        yield place.first_look(), place.look_again


def find_target(
    recording: Source,
    target: str | PathLike[str] | Target,
    *,
    topics: Topics = None,
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress | None = None,
    **options: Any,
) -> dict[str, Observations]:
    """What each camera of a recording saw of the target, to evaluate or to calibrate.

    Args:
        recording: As ``calibrate_recording`` takes it, and so the others.
        target: A Target, its file, or the name of a shipped one.
        topics: Camera name → topic, or topics; None for the only one.
        workers: Processes that look; None for one a core.
        scheduler: Address of a Dask cluster that looks instead.
        on_progress: Is called with a ``Progress``.
        **options: max_views, every and strict of ``Look``.

    Returns:
        Camera name → observations.

    Raises:
        InputError: An argument, the recording or the target cannot be used.
        CalibrationError: A camera did not see the target.
    """
    refuse_unknown_options(options, LOOK_OPTIONS)
    told = unheard if on_progress is None else seldom(on_progress)
    look = Look(topics, workers=workers, scheduler=scheduler, on_progress=told, **options)
    with looking(recording, target, look) as place:
        return {camera.name: camera.observations for camera in place.first_look()}


def observation_files(source: Source) -> list[Path]:
    """The observation files given; none where it is a recording. Raises InputError for both at once."""
    paths = [] if isinstance(source, Recording) else checked_paths(source, "paths")
    files = [path for path in paths if path.suffix == ".npz"]
    if files and len(files) < len(paths):
        raise InputError(f"{files[0]}: give observation files or recordings, not both at once")
    return files


def opened_once(source: Source, strict: bool) -> AbstractContextManager[Recording]:
    if isinstance(source, Recording):
        return nullcontext(source)
    return open_recording(source, strict=strict)


def _said(source: Source, recording: Recording) -> str:
    paths = recording.files() if isinstance(source, Recording) else checked_paths(source, "paths")
    return ", ".join(map(str, paths))


def _refuse_interrupted(runs: Mapping[str, DetectionRun]) -> None:
    """End an interrupted run; what it has found is in the log, where there is one."""
    if any(run.interrupted for run in runs.values()):
        raise Interrupted("interrupted")
