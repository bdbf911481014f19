"""From a recording, or observation files, to what each camera of a rig saw, and when."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.evaluation import where_to_look_again
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.collection.collector import Guide
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline.camera_source import CameraSource, sources_of_files
from fisheye_ep_calib.pipeline.looking import Look, Looking, Source, looking, observation_files, opened_once
from fisheye_ep_calib.pipeline.names import camera_name, checked_topics
from fisheye_ep_calib.pipeline.rig_moments import Stamps, recorded_moments, recorded_stamps
from fisheye_ep_calib.rig import USUAL_TOLERANCE
from fisheye_ep_calib.storage.recording import Recording, choose_topics
from fisheye_ep_calib.storage.sources.image_names import times_in_names
from fisheye_ep_calib.target import Target

_RECORDED_WITHIN = 50_000_000  # ns: images of one moment may be recorded this much later than others


@dataclass(frozen=True)
class RigSource:
    """What one camera saw. stamps_ns: by image number. topic: empty where it is not known.

    numbered: the stamps count images instead of nanoseconds, so that only equal ones are of the same time.
    unmistakable: the detector cannot have taken the target for itself turned.
    """

    observations: Observations
    stamps_ns: np.ndarray
    topic: str = ""
    numbered: bool = False
    unmistakable: bool = False


@contextmanager
def rig_sources(
    source: Source,
    target: str | PathLike[str] | Target | None,
    cameras: Mapping[str, FisheyeCamera],
    look: Look,
    tolerance: float = USUAL_TOLERANCE,
    clocks_differ: bool = False,
) -> Iterator[dict[str, RigSource]]:
    """For each camera of the rig, by name. What was found meanwhile is kept until this is left in peace.

    look: its ``max_views`` counts moments. Each image is looked at a second time, where its camera says that the
    target is. tolerance: seconds within which images are of the same time. clocks_differ: as in ``recorded_moments``.
    Raises InputError where a camera has no source.
    """
    files = observation_files(source)
    if files:
        yield _of_files(tuple(cameras), files)
        return
    with opened_once(source, look.strict) as recording:
        topics = _topics(tuple(cameras), recording, look)
        stamps = recorded_stamps(topics, recording)
        moments = recorded_moments(stamps, tolerance, clocks_differ)
        with looking(recording, target, replace(look, topics=topics)) as place:
            first = place.first_look_together(moments)
            again = place.look_again([_guide(camera, cameras[camera.name]) for camera in first])
            yield {name: _of_images(again[name], place, stamps) for name in topics}


def _of_files(names: Sequence[str], files: list[Path]) -> dict[str, RigSource]:
    by_name = {camera.name: camera for camera in sources_of_files(files)}
    sources = {}
    for name in names:
        if name not in by_name:
            raise InputError(f"there is no {name}.npz among the observation files for `camera` {name}")
        observations = by_name[name].observations
        times = times_in_names(observations.image_names)
        if times is None:
            stamps = _numbers_of_names(observations.image_names, by_name[name].source)
        else:
            stamps = np.array(times, dtype=np.int64)
        sources[name] = RigSource(observations, stamps, numbered=times is None)
    if len({source.numbered for source in sources.values()}) > 1:
        raise InputError("the images of some cameras are named by their time, those of others are not")
    return sources


def _numbers_of_names(names: Sequence[str], path: str) -> np.ndarray:
    """The last number in each image's name, for images that no clock has stamped."""
    numbers = []
    for name in names:
        digits = re.findall(r"\d{1,18}", Path(name).stem)
        if not digits:
            raise InputError(f"{path}: image {name!r} has neither time nor number to match it with other cameras by")
        numbers.append(int(digits[-1]))
    if len(set(numbers)) < len(numbers):
        raise InputError(f"{path}: two images have the same number, so it is not clear which others they go with")
    return np.array(numbers, dtype=np.int64)


def _topics(names: Sequence[str], recording: Recording, look: Look) -> dict[str, str]:
    """Camera name → topic, from those given or from what the topics are called."""
    given = checked_topics(look.topics)
    for name, topic in given.items():
        if name not in names:
            raise InputError(f"`topics` {name}={topic}: no camera of the rig is called {name}")
    topics = {camera_name(topic.name): topic.name for topic in recording.image_topics()} | given
    missing = [name for name in names if name not in topics]
    if missing:
        listed = ", ".join(map(str, recording.image_topics()))
        raise InputError(f"which topic is {missing[0]}'s? Say so by `topics`; image topics: {listed}")
    chosen = {name: topics[name] for name in names}
    return dict(zip(chosen, choose_topics(recording, tuple(chosen.values())), strict=True))


def _guide(source: CameraSource, camera: FisheyeCamera) -> Guide:
    assert source.run is not None  # images were looked at
    try:
        return Guide(source.run, *where_to_look_again(camera, source.observations))
    except CalibrationError as error:
        raise type(error)(f"{source.name}: {error}") from None


def _of_images(source: CameraSource, place: Looking, stamps: Stamps) -> RigSource:
    observations, run = source.observations, source.run
    assert run is not None
    images = [view.index for view in run.views]
    if stamps.numbered:
        taken = stamps.of_cameras[stamps.names.index(source.name)][images]
    else:  # by the camera's clock, so that saved observations can be matched too
        taken = np.array([place.recording.frame(run.topic, image).taken_ns for image in images], dtype=np.int64)
        by_time = tuple(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in taken.tolist())
        observations = replace(observations, image_names=by_time)
    return RigSource(observations, taken, run.topic, stamps.numbered, place.target.unmistakable)
