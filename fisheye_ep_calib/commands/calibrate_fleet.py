"""fisheye_ep_calib calibrate-fleet: the cameras of many devices, each from its own recording, in one table."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.collection import FrameChoice
from fisheye_ep_calib.commands.calibrate import add_fit_arguments, check_fit_arguments
from fisheye_ep_calib.commands.fleet_devices import Device, absence, find_devices
from fisheye_ep_calib.commands.fleet_jobs import DeviceJob, Ended, run_jobs
from fisheye_ep_calib.commands.fleet_table import Row, as_csv, as_text, device_rows, failed_row, is_finished, mark_odd
from fisheye_ep_calib.commands.sources import add_looking_arguments, topics_given
from fisheye_ep_calib.errors import InputError, Interrupted
from fisheye_ep_calib.outside import real_path
from fisheye_ep_calib.pipeline.writing import RECORD
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.folder_owner import FolderOwner
from fisheye_ep_calib.storage.json_text import json_text, read_json
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.target import Target, load_target
from fisheye_ep_calib.worker_processes import usable_cores

DESCRIPTION = """\
Calibrate many devices of one kind, each from its own recording, with one target.

DIR_OR_LIST is a folder with a sub-folder, bag or observation file for each device, or a text file with a path a line
(relative to that file; # at a line's start or after a space begins a comment). Each device is calibrated as 'calibrate'
does it, in a process of its own, and gets the folder OUTPUT/DEVICE with the same files; what 'calibrate' says is in
OUTPUT/logs/DEVICE.txt. Devices that are finished are skipped, so that the same command goes on after an interruption,
and takes new devices only. One that fails does not stop the others: its reason is in the table.

OUTPUT/fleet.csv, also printed, has a row a camera: fx, fy, cx, cy, skew, k1..k4, r and E at 30, 60 and 80 degrees, each
with its standard deviation, RMS, views and so on. A camera is called odd where it differs from the same camera of the
other devices in fx, fy, cx, cy, r, E or the RMS: |value - median| beyond 3.5 times (in a large fleet; more with few
devices: 10.5 with 5, 5.3 with 10, 4.2 with 20) the root of the fleet's spread squared (1.4826 x median absolute
deviation) plus the camera's own standard deviation squared. Fewer than 4 devices are not compared."""
EPILOG = """examples:
  fisheye_ep_calib calibrate-fleet recordings/ --target board.yaml --output fleet
  fisheye_ep_calib calibrate-fleet monday.txt --target board.yaml --output fleet --topic front=/front/image_raw --jobs 2
  fisheye_ep_calib calibrate-fleet recordings/ --target board.yaml --output fleet --scheduler tcp://10.0.0.5:8786

exit code: 0 where every device is calibrated, 1 where some are not, 2 wrong usage, 130 interrupted
"""
TABLE = "fleet.csv"
# What may differ between runs without making other results.
_NO_MATTER = {"devices", "output", "overwrite", "resume", "json", "jobs", "workers", "scheduler", "no_report", "target"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("devices", type=Path, metavar="DIR_OR_LIST", help="the devices' recordings")
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="devices at once, which share the cores (1)")
    parser.add_argument("--overwrite", action="store_true", help="calibrate finished devices too, and replace them")
    parser.add_argument(
        "--resume", action="store_true", help="go on from what interrupted or failed devices have found in their images"
    )
    parser.add_argument("--json", action="store_true", help="print the table as one JSON object on stdout")
    add_looking_arguments(parser)
    add_fit_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    _refuse_what_cannot_work(arguments)
    output = arguments.output
    devices = find_devices(arguments.devices, output)
    if arguments.target is None and any(path.suffix != ".npz" for device in devices for path in device.sources):
        raise InputError("images need --target TARGET.yaml, which says what to look for")
    if all(map(absence, devices)):
        raise InputError(f"{arguments.devices}: none of what it lists is there; {absence(devices[0])}")
    owner = FolderOwner(output, "calibrate-fleet")
    owner.hold()
    try:
        return _calibrate(devices, arguments)
    finally:
        owner.release()


def _calibrate(devices: list[Device], arguments: argparse.Namespace) -> int:
    """With the output's folder held: all that is not finished, then the table. The exit code."""
    output = arguments.output
    finished = set() if arguments.overwrite else {each.name for each in devices if is_finished(output / each.name)}
    absent = {each.name: reason for each in devices if each.name not in finished and (reason := absence(each))}
    jobs = [_job(each, arguments) for each in devices if each.name not in finished and each.name not in absent]
    _say_what_differs([device for device in devices if device.name in finished], arguments)
    missing = f", {len(absent)} not there" if absent else ""
    print(f"{len(devices)} devices, {len(finished)} of them finished before{missing}", file=sys.stderr)
    if jobs:
        (output / "logs").mkdir(parents=True, exist_ok=True)
    progress = _Progress(len(jobs))
    interrupted = run_jobs(jobs, arguments.jobs, progress.ended)
    rows = _rows(devices, absent | progress.failed, output)
    if output.exists():
        atomic_write(output / TABLE, as_csv(rows).encode("utf-8", "backslashreplace"))
    if interrupted:
        raise Interrupted("interrupted; the same command goes on with what is left, and with --resume where it was")
    print(json_text({"devices": rows}) if arguments.json else as_text(rows))
    print(f"wrote {output / TABLE}", file=sys.stderr)
    return 1 if any(row["status"] != "done" for row in rows) else 0


def _refuse_what_cannot_work(arguments: argparse.Namespace) -> None:
    """Once, before every device fails by itself."""
    if arguments.jobs < 1:
        raise InputError(f"--jobs must be at least 1, not {arguments.jobs}")
    if not arguments.devices.exists():
        raise InputError(f"{arguments.devices} does not exist")
    if arguments.output.exists() and not arguments.output.is_dir():
        raise InputError(f"--output {arguments.output} is not a folder")
    if arguments.target is not None:
        load_target(arguments.target)
    topics_given(arguments.topic)
    FrameChoice(arguments.max_views, arguments.every)
    check_fit_arguments(arguments)
    if arguments.scheduler is not None:
        from fisheye_ep_calib.collection.cluster import check_scheduler

        check_scheduler(arguments.scheduler)


def _job(device: Device, arguments: argparse.Namespace) -> DeviceJob:
    workers = arguments.workers
    own = argparse.Namespace(**vars(arguments))
    own.source = list(map(str, device.sources))
    own.output = arguments.output / device.name
    own.overwrite = arguments.overwrite or (own.output / RECORD).exists()  # what is there is not finished
    own.workers = max(1, usable_cores() // arguments.jobs) if workers is None else workers
    own.split, own.previous, own.json = None, None, False
    del own.devices, own.jobs, own.run, own.command
    return DeviceJob(device.name, own, arguments.output / "logs" / f"{device.name}.txt")


class _Progress:
    """A line on stderr for each device that has ended."""

    def __init__(self, total: int) -> None:
        self.failed: dict[str, str] = {}
        self._total = total
        self._done = 0
        self._began = time.monotonic()

    def ended(self, job: DeviceJob, end: Ended) -> None:
        self._done += 1
        if end.code:
            self.failed[job.name] = end.reason
        outcome = f"failed: {end.reason}" if end.code else "done"
        left = (time.monotonic() - self._began) / self._done * (self._total - self._done)
        ahead = f", about {left / 60:.0f} min left" if left >= 60 else ""
        print(f"{self._done}/{self._total} {job.name}: {outcome} ({end.seconds:.0f} s{ahead})", file=sys.stderr)


def _rows(devices: list[Device], failed: dict[str, str], output: Path) -> list[Row]:
    """The table: a row a camera, or one for a device that has none."""
    rows: list[Row] = []
    for device in devices:
        folder = output / device.name
        if not (folder / RECORD).exists():
            rows.append(failed_row(device.name, failed.get(device.name, "not calibrated yet")))
            continue
        try:
            rows += device_rows(device.name, folder)
        except InputError as error:
            rows.append(failed_row(device.name, str(error)))
        if device.name in failed and all(row["status"] == "done" for row in rows if row["device"] == device.name):
            rows.append(failed_row(device.name, failed[device.name]))
    mark_odd(rows)
    return rows


def _say_what_differs(finished: list[Device], arguments: argparse.Namespace) -> None:
    """What was finished with other options, another target or from another recording is compared all the same."""
    options = {name: value for name, value in vars(arguments).items() if name not in (*_NO_MATTER, "run", "command")}
    given = json.loads(json_text(options))
    target = None if arguments.target is None else load_target(arguments.target)
    for device in finished:
        folder = arguments.output / device.name
        try:
            made = read_json(folder / RECORD)
            changed = [key for key, value in made["options"].items() if key in given and given[key] != value]
            sources = {camera["inputs"]["source"] for camera in made["cameras"].values()}
            elsewhere = _resolved(", ".join(map(str, device.sources))) not in map(_resolved, sources)
            samples = [load_observations(folder / "observations" / f"{name}.npz") for name in list(made["cameras"])[:1]]
        except (ValueError, KeyError, TypeError, AttributeError, InputError):
            continue
        other = [f"another --{key.replace('_', '-')}" for key in changed]
        if target is not None and any(not _shows(sample, target) for sample in samples):
            other.append("another --target")
        if elsewhere:
            other.append("another recording")
        if other:
            before = f"{device.name} was calibrated before with {other[0]}"
            print(f"warning: {before}; --overwrite calibrates it again", file=sys.stderr)


def _shows(observations: Observations, target: Target) -> bool:
    """Whether the observations are of this target; files hold rounded numbers."""
    first, second = (-1.0 if radius is None else radius for radius in (observations.disc_radius, target.disc_radius))
    pairs: list[tuple[Any, Any]] = [(observations.object_points, target.object_points), (first, second)]
    return all(np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=0, atol=1e-9) for a, b in pairs)


def _resolved(sources: str) -> list[Path]:
    """Paths as ``inputs.source`` of calibration.json has them, seen from here."""
    return [real_path(source) for source in sources.split(", ")]
