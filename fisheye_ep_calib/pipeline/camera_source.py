"""What one camera saw, and where that came from."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.collection import DetectionRun
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.pipeline.names import safe_name
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.storage.fingerprint import fingerprint_of_all
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target import Target

_log = logging.getLogger(__name__)

MOST_IMAGES, MOST_PLACES = 1200, 80_000  # of an observation file; a calibration takes up to 15 kB a place


@dataclass(frozen=True)
class CameraSource:
    """One camera's observations and where they came from.

    outcome: the observations, or why there are none. seconds: spent in "read" and "detect". unused_views: image name →
    why it is no view. run: None for an observation file. target: its file or name, where it is known. target_keys: what
    that file says. files: and folders of the source, where it is a recording.
    image: reads the image of that number, grey (h, w), as long as its file is there.
    """

    name: str
    outcome: Observations | CalibrationError
    source: str = ""
    seconds: dict[str, float] = field(default_factory=lambda: {"read": 0.0, "detect": 0.0})
    unused_views: dict[str, str] = field(default_factory=dict)
    run: DetectionRun | None = None
    target: str = ""
    image: Callable[[int], np.ndarray] | None = None
    target_keys: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[Path, ...] = ()

    @property
    def observations(self) -> Observations:
        """Raises CalibrationError where the target was not found."""
        if isinstance(self.outcome, CalibrationError):
            raise self.outcome
        return self.outcome

    def inputs(self) -> dict[str, Any]:
        """Where the observations came from, as calibration.json has it."""
        inputs: dict[str, Any] = {"source": self.source, "image_size": list(self.observations.image_size)}
        if self.target:
            inputs["target"] = self.target
        source: Sequence[str | Path] = self.files or [self.source]
        for name, paths in (("source_hash", source), ("target_hash", [self.target])):
            if told := fingerprint_of_all([path for path in paths if path]):
                inputs[name] = told
        if self.run is not None:
            inputs["topic"] = self.run.topic
            inputs["images_available"] = self.run.available
            inputs["images_looked_at"] = len(self.run.frames)
            inputs["images_unreadable"] = self.run.bad_frames
        inputs["images_with_target"] = self.observations.view_count
        inputs["points_found"] = len(self.observations.pixels)
        if self.run is not None:
            inputs["points_given_up"] = self.run.points_given_up
        return inputs


def source_of_observations(name: str, given: object) -> CameraSource:
    """One camera's source from what it is said to have seen. Raises InputError."""
    if isinstance(given, CameraSource):
        return given
    if isinstance(given, Observations):
        return CameraSource(name, given)
    how = "as `Observations.load` gives them, or one of those of `find_target`"
    raise InputError(f"`observations` must be those of one camera, {how}, not {shown(given)}")


def source_of_run(
    name: str,
    run: DetectionRun,
    target: Target,
    recording: Recording,
    source: str,
    target_name: str,
    opened: float = 0.0,
) -> CameraSource:
    """One camera's source from what was seen by it. opened: seconds that it took to open the recording."""
    _log.info("%s", run.summary())
    outcome: Observations | CalibrationError
    try:
        observations = run.observations(target.object_points, target.disc_radius)
        outcome = replace(observations, board=target.shape, mistakable=not target.unmistakable)
    except CalibrationError as error:
        outcome = error

    def image(number: int) -> np.ndarray:
        return recording.frame(run.topic, run.views[number].index).image()

    seconds = {"read": opened + run.read_seconds, "detect": run.detect_seconds}
    files = tuple(recording.files())
    return CameraSource(name, outcome, source, seconds, run.unused, run, target_name, image, target.keys, files)


def sources_of_files(paths: list[Path], split: str | None = None) -> list[CameraSource]:
    """A camera an observation file, named after it. split: only the images with this mark. Raises InputError."""
    return _differently_named([_source_of_file(path, split) for path in paths])


def _source_of_file(path: Path, split: str | None) -> CameraSource:
    began = time.perf_counter()
    observations = load_observations(path)
    if split is not None:
        if observations.split is None:
            raise InputError(f"{path} marks no image as {split}: it has no split")
        observations = observations.select_images(np.flatnonzero(observations.split == split))
        if len(observations.pixels) == 0:
            raise InputError(f"{path} marks no image as {split}")
    read = {"read": time.perf_counter() - began, "detect": 0.0}
    return CameraSource(safe_name(path.stem), observations, str(path), seconds=read)


def within_memory(camera: CameraSource) -> CameraSource:
    """The camera with as many of its images, evenly spaced, as a calibration has memory for.

    Memory goes with the sightings, and half as much with images × points of the target, seen or not.
    """
    observations = camera.observations
    images, sightings = np.unique(observations.image_index), len(observations.pixels)
    places = (2 * sightings + len(images) * len(observations.object_points)) / 3
    most = min(MOST_IMAGES, int(len(images) * MOST_PLACES / places))
    if most >= len(images):
        return camera
    kept = images[np.linspace(0, len(images) - 1, most).round().astype(int)]
    observations = observations.select_images(kept)
    _log.warning(
        "%s: %d of %d images are used, evenly spaced: memory is planned for no more", camera.source, most, len(images)
    )
    return replace(camera, outcome=observations)


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
