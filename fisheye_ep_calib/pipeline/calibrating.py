"""From what cameras saw to calibrated cameras: calibrate, look again where the target is expected, calibrate."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.assessing.target_findings import smaller_board
from fisheye_ep_calib.calibration.calibrate import rough_camera
from fisheye_ep_calib.calibration.estimating.sightings import MIN_VIEWS
from fisheye_ep_calib.calibration.options import AUTO
from fisheye_ep_calib.collection.collector import Guide
from fisheye_ep_calib.collection.progress import OnProgress, Progress, seldom, unheard
from fisheye_ep_calib.collection.results import counted
from fisheye_ep_calib.errors import CalibrationError, Interrupted
from fisheye_ep_calib.pipeline.calibrated_camera import CalibratedCamera
from fisheye_ep_calib.pipeline.camera_source import CameraSource
from fisheye_ep_calib.pipeline.known_camera import AnyCamera
from fisheye_ep_calib.pipeline.looking import Look, LookAgain, Source, camera_sources
from fisheye_ep_calib.pipeline.names import Topics
from fisheye_ep_calib.pipeline.options import LOOK_OPTIONS, check_fit, fit_options, refuse_unknown_options
from fisheye_ep_calib.pipeline.writing import write_cameras
from fisheye_ep_calib.target import Target

_log = logging.getLogger(__name__)


class CalibratedCameras(Mapping[str, CalibratedCamera]):
    """Camera name → its result. failed: name → why there is none, which asking for that camera raises."""

    def __init__(self, results: Mapping[str, CalibratedCamera], failed: Mapping[str, CalibrationError]) -> None:
        self._results = dict(results)
        self.failed = dict(failed)

    def __getitem__(self, name: str) -> CalibratedCamera:
        if name in self.failed:
            raise self.failed[name]
        return self._results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._results)

    def __len__(self) -> int:
        return len(self._results)

    def __contains__(self, name: object) -> bool:
        return name in self._results

    def write(self, folder: str | PathLike[str], *, overwrite: bool = False) -> dict[str, Path | None]:
        """``CalibratedCamera.write`` for all of them; returns camera name → camera file."""
        failed = {name: str(error) for name, error in self.failed.items()}
        results = [(result, result.camera_source, result.to_dict()) for result in self._results.values()]
        return write_cameras(folder, results, failed, overwrite=overwrite)

    def report(self, path: str | PathLike[str]) -> None:
        """Write one HTML page of all cameras."""
        from fisheye_ep_calib.report.html import write_report

        write_report(path, [result.page(pictures=True, share=len(self)) for result in self._results.values()])

    def to_dict(self) -> dict[str, Any]:
        """What ``calibrate --json`` prints."""
        return {"cameras": {name: result.to_dict() for name, result in self._results.items()}}

    def __repr__(self) -> str:
        return "\n".join([*map(repr, self._results.values()), *(f"{name}: {why}" for name, why in self.failed.items())])


def calibrate_recording(
    recording: Source,
    target: str | PathLike[str] | Target | None = None,
    *,
    topics: Topics = None,
    model: str = AUTO,
    passes: int = 2,
    previous: AnyCamera | Mapping[str, AnyCamera] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    on_progress: OnProgress | None = None,
    **options: Any,
) -> CalibratedCameras:
    """The whole way: choose images, find the target, calibrate, look again where it is expected, calibrate, judge.

    Args:
        recording: A bag, a folder or pattern of images, several of them, or an open Recording; or observation files,
            which need no target.
        target: A Target, its file, or the name of a shipped one.
        topics: Camera name → topic, or topics; None for the only one.
        model: "auto" takes what the data support; else the model of that name is fitted.
        passes: 2 looks again where the first camera says that the target is.
        previous: An earlier calibration of the camera, or of several by their names, that ``change`` of the result is
            since.
        workers: Processes that look; None for one a core.
        scheduler: Address of a Dask cluster that looks instead.
        on_progress: Is called with a ``Progress``, which prints as a line; an exception from it ends the workers and
            reaches the caller.
        **options: Those of ``calibration.Options.of``, and max_views, every, strict of ``Look``.

    Returns:
        Camera name → result; where only some of several cameras fail, ``failed`` says why.

    Raises:
        InputError: An argument, the recording or the target cannot be used.
        CalibrationError: No camera could be calibrated.
    """
    refuse_unknown_options(options, (*fit_options(), *LOOK_OPTIONS))
    fit = {name: value for name, value in options.items() if name in fit_options()}
    check_fit(model, passes, fit)
    told = unheard if on_progress is None else seldom(on_progress)
    chosen = {name: value for name, value in options.items() if name in LOOK_OPTIONS}
    look = Look(topics, workers=workers, scheduler=scheduler, on_progress=told, **chosen)
    results: dict[str, CalibratedCamera] = {}
    failed: dict[str, CalibrationError] = {}
    with camera_sources(recording, target, look) as (cameras, look_again):
        for camera, end in calibrate_cameras(cameras, look_again, model, passes, told, fit):
            if isinstance(end, CalibratedCamera):
                earlier = previous.get(camera.name) if isinstance(previous, Mapping) else previous
                results[camera.name] = end if earlier is None else end.since(earlier)
            else:
                failed[camera.name] = end
                if len(cameras) > 1:
                    _log.warning("%s: %s", camera.name, end)
        if not results:
            raise none_calibrated(list(failed.values()))
    return CalibratedCameras(results, failed)


def calibrate_cameras(
    cameras: list[CameraSource],
    look_again: LookAgain | None,
    model: str = AUTO,
    passes: int = 2,
    on_progress: OnProgress = unheard,
    options: Mapping[str, Any] | None = None,
) -> Iterator[tuple[CameraSource, CalibratedCamera | CalibrationError]]:
    """Each camera's last source and its result, or why there is none. options: the fields of ``Options``."""
    for camera in cameras:
        try:
            result = _calibrated(camera, look_again if passes > 1 else None, model, on_progress, options or {})
            yield result.camera_source, result
        except Interrupted:
            raise
        except CalibrationError as error:
            yield camera, _with_reasons(error, camera)


def _calibrated(
    camera: CameraSource,
    look_again: LookAgain | None,
    model: str,
    on_progress: OnProgress,
    options: Mapping[str, Any],
) -> CalibratedCamera:
    if look_again is None or camera.run is None:
        on_progress(Progress(f"{camera.name}: calibrating"))
        return CalibratedCamera.of(calibrate(camera.observations, model, **options), camera)
    on_progress(Progress(f"{camera.name}: a rough camera for the second look"))
    rough = rough_camera(camera.observations, model, **options)
    poses = dict(zip(rough.view_images.tolist(), rough.camera_from_target, strict=True))
    again = look_again([Guide(camera.run, rough.camera, poses)])[camera.name]
    on_progress(Progress(f"{camera.name}: calibrating"))
    first = (camera.seconds, rough.seconds)
    return CalibratedCamera.of(calibrate(again.observations, model, **options), again, first)


def _with_reasons(error: CalibrationError, camera: CameraSource) -> CalibrationError:
    """The same error; where too few images are views, with every reason, counted; and where the board is smaller than
    its file.
    """
    outcome = camera.outcome  # where there are no views at all the error tells the reasons by itself
    if isinstance(outcome, CalibrationError):
        return error
    reasons = []
    if outcome.view_count < MIN_VIEWS and camera.unused_views:
        reasons.append(f"images not used: {counted(list(camera.unused_views.values()))}")
    if smaller := smaller_board(outcome.object_points, outcome.image_index, outcome.point_index):
        reasons.append(smaller)
    if not reasons:
        return error
    told = type(error)("; ".join([str(error), *reasons]))
    told.exit_code = error.exit_code
    return told


def none_calibrated(failures: list[CalibrationError]) -> CalibrationError:
    """What to raise where no camera could be calibrated."""
    if len(failures) == 1:
        return failures[0]
    error = CalibrationError(f"none of the {len(failures)} cameras could be calibrated")
    error.exit_code = max(failure.exit_code for failure in failures)
    return error
