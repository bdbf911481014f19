"""What was found in images outlives a run that was interrupted or failed, and can be resumed from there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fisheye_ep_calib.collection import Collector
from fisheye_ep_calib.errors import CalibrationError, Interrupted
from fisheye_ep_calib.storage.results_folder import beside


@dataclass(frozen=True)
class Log:
    """The file with what was found so far; resume: go on from what an earlier run left there."""

    path: Path
    resume: bool = False


def log_of(output: Path, resume: bool) -> Log:
    """The log of the run that writes its results to the folder ``output``."""
    return Log(beside(output, "detections.jsonl"), resume)


@contextmanager
def keeping_what_was_found(collector: Collector) -> Iterator[None]:
    """Forget the log once results are written or nothing was found; keep it where they are not, and say so."""
    try:
        yield
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted{_kept(collector)}") from None
    except CalibrationError as error:
        if collector.log is None:
            raise
        if not isinstance(error, Interrupted) and not collector.log.holds_views:
            collector.forget()
        told = type(error)(f"{error}{_kept(collector)}")
        told.exit_code = error.exit_code
        raise told from None
    collector.forget()


def _kept(collector: Collector) -> str:
    log = collector.log
    if log is None or not log.path.exists():
        return ""
    if log.images == 0:
        collector.forget()
        return ""
    images = "1 image" if log.images == 1 else f"{log.images} images"
    return f"; what {images} showed is kept in {log.path}: `resume` goes on from there"
