"""Where a live calibration stands: what a user, a dashboard and a diagnostics viewer are told."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from fisheye_ep_calib.live.session import CameraSession
from fisheye_ep_calib.live.settings import Tuning


class Level(IntEnum):
    """As in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Reception:
    """How a camera's images arrive. silent: for a while none has. delay: from the last one's stamp to its arrival, s.

    largest_delay: the largest of the last second or so, s.
    """

    topic: str
    silent: bool
    delay: float | None
    largest_delay: float | None


@dataclass(frozen=True)
class Status:
    """Of one camera, or of the rig.

    message: one sentence. next: what the user should do. values: figures by name, JSON-ready.
    """

    name: str
    level: Level
    message: str
    next: str
    values: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "level": self.level.name,
            "message": self.message,
            "next": self.next,
            **self.values,
        }


def camera_status(session: CameraSession, reception: Reception, warnings: list[str], tuning: Tuning) -> Status:
    """Status of one camera. warnings: texts that stand."""
    counters, views, outcome = session.counters, len(session.views), session.outcome
    values: dict[str, Any] = {
        "topic": reception.topic,
        "received": counters.received,
        "dropped": counters.dropped,
        "unreadable": counters.unreadable,
        "searched": counters.searched,
        "found": counters.found,
        "views": views,
        "image_size": list(session.image_size) if session.image_size else None,
        "delay_s": reception.delay,
        "largest_delay_s": reception.largest_delay,
        "unwritten": session.unwritten,
        "calibrated": outcome is not None,
        "calibration": outcome.figures if outcome is not None else None,
        "guidance": outcome.advice.figures if outcome is not None and outcome.advice is not None else None,
        "goal_entrance_pupil_mm": tuning.goal_mm,
        "warnings": warnings,
    }
    if reception.silent:
        level, message = Level.STALE, f"no image on {reception.topic}"
    elif warnings:
        level, message = Level.WARN, warnings[0]
    elif outcome is None:
        level, message = Level.OK, f"collecting, {views} views"
    else:
        level, message = Level.OK, f"calibrated ({outcome.figures['model']}), {views} views"
    step = "start the camera" if reception.silent else next_step(session, tuning)
    return Status(session.name, level, message, step, values)


def next_step(session: CameraSession, tuning: Tuning) -> str:
    """What would help most, in one sentence."""
    minimum_views, goal_mm = tuning.minimum_views, tuning.goal_mm
    views = len(session.views)
    if views == 0 and session.counters.found == 0:
        return "hold the target before the camera"
    if views < minimum_views:
        return f"move and tilt the target: {minimum_views - views} more views are wanted"
    outcome = session.outcome
    if outcome is None:
        return "call ~/calibrate, or go on moving the target"
    if outcome.advice is None:
        return "move and tilt the target: near, far and at the edge of the image"
    if outcome.pupil_band_mm <= goal_mm:
        return f"the entrance pupil is known to {outcome.pupil_band_mm:.2g} mm, the goal: save, or go on"
    return outcome.advice.sentence


def headline(session: CameraSession) -> str:
    """What there is so far, in a few words."""
    outcome = session.outcome
    text = f"{session.name}: {len(session.views)} views"
    if outcome is None or "rms_px" not in outcome.figures:
        return text
    return text + ", {model}, RMS {rms_px:.3f} px, E to {band:.2g} mm".format(
        **outcome.figures, band=outcome.pupil_band_mm
    )
