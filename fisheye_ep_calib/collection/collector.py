"""Looks for a target in a recording's images."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.collection.detection_log import DetectionLog, search_key
from fisheye_ep_calib.collection.look import Job
from fisheye_ep_calib.collection.pool import frame_pool
from fisheye_ep_calib.collection.progress import OnProgress, Progress, unheard
from fisheye_ep_calib.collection.results import DetectionRun, FrameResult, sizes_differ, usual_size, without_strays
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.planning.image_choice import FrameChoice, first_look, first_moments, next_look, next_moments
from fisheye_ep_calib.planning.nothing_found import worth_a_look
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.base import Target

_SEARCH = "looking for the target"
_ALL = "all topics"


@dataclass(frozen=True)
class Guide:
    """What a first calibration says: a FisheyeCamera, and poses (4, 4) by the views' numbers in the run."""

    run: DetectionRun
    camera: Any
    camera_from_target: Mapping[int, np.ndarray]


class Collector:
    """Looks for one target in one recording, with worker processes that are kept for a second pass.

    workers: processes; 0 looks in the calling process. scheduler: address of a Dask cluster that looks instead.
    strict: an image that cannot be read is an error.
    log: a file that holds what was found so far, removed by ``forget``; resume: go on from it.
    on_progress: is told of every image; an exception from it ends the looking.
    """

    def __init__(
        self,
        recording: Recording,
        target: Target,
        *,
        workers: int = 0,
        strict: bool = False,
        log: str | PathLike[str] | None = None,
        resume: bool = False,
        scheduler: str | None = None,
        on_progress: OnProgress = unheard,
    ) -> None:
        self._recording = recording
        self._on_progress = on_progress
        self._target = target
        self._strict = strict
        self._log_path = None if log is None else Path(log)
        self._resume = resume
        self._log: DetectionLog | None = None
        self._workers = frame_pool(recording, target, workers, scheduler)

    def __enter__(self) -> Collector:
        return self

    def __exit__(self, *_: object) -> None:
        self._workers.close()
        if self._log is not None:
            self._log.close()

    @property
    def log(self) -> DetectionLog | None:
        """What was found so far, on disk, once the search has begun."""
        return self._log

    def forget(self) -> None:
        """Delete the log: what was found is saved elsewhere."""
        if self._log is not None:
            self._log.remove()

    def collect(self, topics: Sequence[str], choice: FrameChoice | None = None) -> dict[str, DetectionRun]:
        """Look at the images of these cameras, coarse to fine in time.

        Ctrl-C ends the looking and keeps what was found; so does a topic whose images differ in size, for that topic,
        unless a few alone are of another size: these are left out. Raises InputError where strict and an image cannot
        be read or is left out.
        """
        choice = choice or FrameChoice()
        self._open_log(topics)
        counts = {topic: self._recording.count(topic) for topic in topics}
        first = {topic: first_look(counts[topic], choice) for topic in topics}
        looked_at: dict[str, dict[int, FrameResult]] = {topic: {} for topic in topics}
        expected = sum(min(count, max(choice.most, len(first[topic]))) for topic, count in counts.items())

        def planned(topic: str) -> list[int]:
            seen = looked_at[topic]
            images = [index for index in first[topic] if index not in seen]
            if not images and _of_one_size(seen):
                images = self._next_look(seen, counts[topic], choice)
            return images

        def jobs_of(topic: str) -> list[Job]:
            images = planned(topic)
            if choice.gives_up and not _any_view(looked_at[topic]):
                images = worth_a_look(images, _pixels([looked_at[topic]]))
            return [Job(topic, index) for index in images]

        def next_jobs(part: str) -> dict[str, list[Job]]:
            if part != _ALL:
                return {part: jobs_of(part)}
            seen = looked_at.values()
            if not choice.gives_up or any(map(_any_view, seen)):
                return {topic: jobs_of(topic) for topic in topics}
            # As long as no camera has seen the target, all of them together have what a refusal may cost.
            pixels = _pixels(seen)
            return {_ALL: [Job(t, index) for t in topics for index in worth_a_look(planned(t), pixels, len(topics))]}

        interrupted = self._look(_SEARCH, expected, next_jobs, looked_at, self._log)
        return self._runs(looked_at, interrupted)

    def collect_moments(
        self, topics: Sequence[str], moments: np.ndarray, choice: FrameChoice
    ) -> dict[str, DetectionRun]:
        """Look at images that several cameras took at the same time: some moments, then those next to shared views.

        moments (m, topics): an image's number for each topic, −1 where it has none. choice: its ``max_views`` counts
        moments; ``every`` means nothing here.
        Ends as ``collect`` does.
        """
        self._open_log(topics)
        looked_at: dict[str, dict[int, FrameResult]] = {topic: {} for topic in topics}

        def jobs_of(rows: np.ndarray) -> list[Job]:
            pairs = [(c, int(image)) for row in rows for c, image in enumerate(moments[row]) if image >= 0]
            return [Job(topics[c], image) for c, image in pairs]

        def next_jobs(_: str) -> dict[str, list[Job]]:
            results = [
                [looked_at[topic].get(image) for topic, image in zip(topics, row, strict=True)] for row in moments
            ]
            looked = np.array([any(row) for row in results])
            shared = np.array([sum(bool(result and result.is_view) for result in row) > 1 for row in results])
            planned = first[~looked[first]]
            if not len(planned) and all(map(_of_one_size, looked_at.values())):
                planned = next_moments(looked, shared, choice.most)
            if choice.gives_up and not any(map(_any_view, looked_at.values())):
                planned = np.array(worth_a_look(planned, _pixels(looked_at.values()), len(topics)), dtype=int)
            return {_ALL: jobs_of(planned)}

        first = first_moments(len(moments), choice.most)
        expected = min(choice.most, len(moments)) * len(topics)
        interrupted = self._look(_SEARCH, expected, next_jobs, looked_at, self._log)
        return self._runs(looked_at, interrupted)

    def refine(self, guides: Sequence[Guide]) -> dict[str, DetectionRun]:
        """Look again, where a first calibration says the target is, at the views that have a pose.

        What the first pass found stays, unless its image contradicts it.
        """
        jobs = {
            guide.run.topic: [
                Job(guide.run.topic, view.index, guide.camera, guide.camera_from_target[number], view.detection)
                for number, view in enumerate(guide.run.views)
                if number in guide.camera_from_target
            ]
            for guide in guides
        }
        looked_at: dict[str, dict[int, FrameResult]] = {guide.run.topic: {} for guide in guides}
        interrupted = self._look(
            "looking again", sum(map(len, jobs.values())), lambda part: jobs if part == _ALL else {}, looked_at
        )
        refined = {}
        for guide in guides:
            again = {index: frame for index, frame in looked_at[guide.run.topic].items() if frame.is_view}
            frames = tuple(again.get(frame.index, frame) for frame in guide.run.frames)
            refined[guide.run.topic] = replace(
                guide.run, frames=frames, interrupted=guide.run.interrupted or interrupted
            )
        return refined

    def _look(
        self,
        step: str,
        expected: int,
        next_jobs: Callable[[str], Mapping[str, Sequence[Job]]],
        looked_at: dict[str, dict[int, FrameResult]],
        log: DetectionLog | None = None,
    ) -> bool:
        """Fill in ``looked_at`` in rounds; while a part's next round is planned the others' go on. True if interrupted.

        expected: how many images the step may come to look at. next_jobs: what follows a part's round once it has been
        seen whole, by part; nothing where it is done. It begins with the part of all topics.
        """
        part_of: dict[tuple[str, int], str] = {}
        left: dict[str, int] = {}
        at_hand: deque[FrameResult] = deque()
        looked = views = 0

        def begin(rounds: Mapping[str, Sequence[Job]]) -> None:
            for part, jobs in rounds.items():
                left[part] = len(jobs)
                part_of.update(((job.topic, job.index), part) for job in jobs)
                at_hand.extend(self._begin(jobs, log))

        try:
            self._on_progress(Progress(step, 0, expected, 0))
            begin(next_jobs(_ALL))
            while (result := at_hand.popleft() if at_hand else self._workers.next_result()) is not None:
                part = part_of[result.topic, result.index]
                self._note(result, looked_at[result.topic], log)
                looked, views = looked + 1, views + result.is_view
                if looked < expected:
                    self._on_progress(Progress(step, looked, expected, views))
                left[part] -= 1
                if left[part] == 0:
                    begin(next_jobs(part))
            self._on_progress(Progress(step, looked, looked, views))  # what else was expected promised nothing new
        except KeyboardInterrupt:
            self._workers.close()
            return True
        return False

    def _open_log(self, topics: Sequence[str]) -> None:
        if self._log_path is not None:
            key = search_key(self._recording, topics, self._target)
            self._log = DetectionLog(self._log_path, key, self._recording.fingerprint, self._resume)

    def _runs(self, looked_at: Mapping[str, Mapping[int, FrameResult]], interrupted: bool) -> dict[str, DetectionRun]:
        runs = {}
        for topic, results in looked_at.items():
            frames = without_strays(_in_order(results))
            self._refuse_strays(frames)
            runs[topic] = DetectionRun(topic, self._recording.count(topic), frames, interrupted)
        return runs

    def _begin(self, jobs: Sequence[Job], log: DetectionLog | None) -> list[FrameResult]:
        """Have images looked at; returns at once what the log knows from an earlier run."""
        earlier = {} if log is None else log.results
        self._workers.add(job for job in jobs if (job.topic, job.index) not in earlier)
        return [earlier[job.topic, job.index] for job in jobs if (job.topic, job.index) in earlier]

    def _note(self, result: FrameResult, looked_at: dict[int, FrameResult], log: DetectionLog | None) -> None:
        if result.error and self._strict:
            raise InputError(f"{result.topic}, image {result.name}: {result.error}")
        looked_at[result.index] = result
        if log is not None and (result.topic, result.index) not in log.results:
            log.add(result)

    def _refuse_strays(self, frames: Sequence[FrameResult]) -> None:
        strays = [frame for frame in frames if frame.stray]
        if strays and self._strict:
            raise InputError(f"{strays[0].topic}, image {strays[0].name}: {strays[0].error}")

    def _next_look(self, looked_at: Mapping[int, FrameResult], count: int, choice: FrameChoice) -> list[int]:
        size = usual_size(tuple(looked_at.values())) or (0, 0)
        detections = {
            index: frame.detection if frame.is_view and frame.image_size == size else None
            for index, frame in looked_at.items()
        }
        return next_look(detections, self._target, size, count, choice)


def _any_view(frames: Mapping[int, FrameResult]) -> bool:
    return any(frame.is_view for frame in frames.values())


def _of_one_size(frames: Mapping[int, FrameResult]) -> bool:
    return sizes_differ(_in_order(frames)) is None


def _pixels(seen: Iterable[Mapping[int, FrameResult]]) -> list[int]:
    """Of each image looked at by any of the cameras; 0 where it could not be read."""
    sizes = [frame.image_size or (0, 0) for frames in seen for frame in frames.values()]
    return [width * height for width, height in sizes]


def _in_order(frames: Mapping[int, FrameResult]) -> tuple[FrameResult, ...]:
    return tuple(frames[index] for index in sorted(frames))
