"""Where a live calibration stands: what a user, a dashboard and a diagnostics viewer are told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.words import BAD, CAUTION, GOOD
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.check import CheckResult
from fisheye_ep_calib.live.look import Look
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.rig import LiveRig
from fisheye_ep_calib.live.rig_outcome import RigOutcome
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


def camera_status(camera: LiveCamera, reception: Reception, warnings: list[str], tuning: Tuning) -> Status:
    """Status of one camera. warnings: texts that stand."""
    counters, views, outcome = camera.views.counters, len(camera.views.kept), camera.outcome
    size = camera.views.image_size
    values: dict[str, Any] = {
        "topic": reception.topic,
        "received": counters.received,
        "dropped": counters.dropped,
        "unreadable": counters.unreadable,
        "searched": counters.searched,
        "found": counters.detected,
        "views": views,
        "image_size": None if size is None else list(size),
        "delay_s": reception.delay,
        "largest_delay_s": reception.largest_delay,
        "guidance": outcome.advice.figures if outcome is not None and outcome.advice is not None else None,
        "goal_entrance_pupil_mm": tuning.goal_mm,
        "goal_reached": camera.reached(tuning),
        "say": say(camera, tuning),
        "wanted": _wanted(camera),
        "other_board": camera.other_board.sentence,
        "check": None if camera.check is None or camera.check.result is None else camera.check.result.figures,
        **_event(camera.looks.since_asked()),
        **_standing(camera.unwritten, outcome, warnings),
    }
    if reception.silent:
        return Status(camera.name, Level.STALE, f"no image on {reception.topic}", "start the camera", values)
    if camera.other_board.sentence:
        warnings = [*warnings, camera.other_board.sentence]
    if camera.check is not None:
        return _checked(camera, camera.check.result, values, warnings)
    message = f"calibrated ({outcome.figures['model']})" if outcome is not None else "collecting"
    findings = () if outcome is None or outcome.advice is None else outcome.advice.findings
    level, message = _level([*warnings, *findings], f"{message}, {views} views")
    return Status(camera.name, level, message, next_step(camera, tuning), values)


def _checked(camera: LiveCamera, result: CheckResult | None, values: dict[str, Any], warnings: list[str]) -> Status:
    """Of a camera that is only held against its calibration."""
    pose = camera.guide.wanted
    following = "hold the target before the camera" if pose is None else pose.sentence
    if result is None:
        return Status(camera.name, *_level(warnings, "nothing checked yet"), following, values)
    levels = {GOOD: Level.OK, CAUTION: Level.WARN, BAD: Level.ERROR}
    following = "calibrate the camera anew" if result.level == BAD else following
    return Status(camera.name, levels[result.level], result.sentence, following, values)


def _wanted(camera: LiveCamera) -> dict[str, Any] | None:
    """Where to hold the target next, and from where it is now how to get there."""
    wanted, steering = camera.guide.wanted, camera.guide.steering
    if wanted is None or camera.views.full:
        return None
    return {
        "sentence": wanted.sentence,
        "outline_px": np.round(wanted.outline, 1).tolist(),
        "move": None if steering is None else steering.sentence,
    }


def _event(look: Look) -> dict[str, Any]:
    return {"event": look.event.value, "event_points": look.points, "event_reason": look.reason}


def rig_status(rig: LiveRig, warnings: list[str]) -> Status:
    """Status of a rig. warnings: texts that stand."""
    names, counts, joined, outcome = rig.names, rig.views.counts(), rig.joined(), rig.outcome
    apart = [name for name in names if name not in joined]
    values: dict[str, Any] = {
        "joined": list(joined),
        "apart": apart,
        "uncalibrated": list(rig.uncalibrated),
        "common_views": [
            {"cameras": [names[a], names[b]], "views": int(counts[a, b])}
            for a in range(len(names))
            for b in range(a + 1, len(names))
        ],
        **_standing(rig.unwritten, outcome, warnings),
    }
    if outcome is not None:
        message = f"{len(outcome.figures['cameras'])} of {len(names)} cameras placed"
    elif apart:
        message = f"not joined yet: {', '.join(apart)}"
    else:
        message = "all cameras are joined by common views"
    return Status(rig.name, *_level(warnings, message), rig.next_step, values)


def _standing(unwritten: bool, outcome: Outcome | RigOutcome | None, warnings: list[str]) -> dict[str, Any]:
    """What is told of whatever is calibrated."""
    return {
        "unwritten": unwritten,
        "calibrated": outcome is not None,
        "calibration": None if outcome is None else outcome.figures,
        "warnings": warnings,
    }


def _level(warnings: list[str], message: str) -> tuple[Level, str]:
    return (Level.WARN, warnings[0]) if warnings else (Level.OK, message)


def next_step(camera: LiveCamera, tuning: Tuning) -> str:
    """What would help most, in a sentence or two."""
    views, outcome, wanted = len(camera.views.kept), camera.outcome, camera.guide.wanted
    if camera.other_board.sentence:
        return f"{camera.other_board.sentence}: show the target, or start again with another target file"
    pose = "move and tilt the target: near, far and at the edge of the image" if wanted is None else wanted.sentence
    if camera.views.full:
        rest = "save" if outcome is not None and outcome.advice is not None else "call ~/calibrate"
        return f"{views} views are kept, as many as maximum_views wants: {rest}"
    if outcome is None and views == 0 and wanted is None:
        return "hold the target before the camera"
    if views < tuning.minimum_views:
        return f"{pose}: {tuning.minimum_views - views} more views are wanted"
    if outcome is None:
        return f"call ~/calibrate, or go on: {pose}"
    if outcome.advice is None:
        return pose
    if camera.reached(tuning):
        sentence = f"the entrance pupil is known to {outcome.pupil_band_mm:.2g} mm, "
        sentence = sentence if np.isfinite(outcome.pupil_band_mm) else ""
        return f"the goal is reached: {sentence}save, or go on" + _besides(outcome.advice.findings)
    if outcome.advice.lacking:
        return f"{outcome.advice.lacking[0]}. Next: {pose}"
    return pose


def say(camera: LiveCamera, tuning: Tuning) -> str:
    """What to do now in as few words as a person two metres away can read."""
    outcome, wanted = camera.outcome, camera.guide.wanted
    if camera.other_board.sentence:
        return camera.other_board.sentence
    if camera.check is not None and camera.check.result is not None:
        return camera.check.result.sentence
    if camera.views.full:
        return "enough views: save" if outcome is not None and outcome.advice is not None else "enough views: calibrate"
    if camera.reached(tuning):
        return "done: save, or go on"
    if wanted is None:
        return "move and tilt the target" if camera.views.counters.detected else "hold the target before the camera"
    return wanted.suggestion.short


def _besides(findings: Sequence[str]) -> str:
    return f"; besides, {findings[0]}" if findings else ""


def headline(camera: LiveCamera) -> str:
    """What there is so far, in a few words."""
    outcome = camera.outcome
    text = f"{camera.name}: {len(camera.views.kept)} views"
    if outcome is None or "rms_px" not in outcome.figures:
        return text
    return text + ", {model}, RMS {rms_px:.3f} px, E to {band:.2g} mm".format(
        **outcome.figures, band=outcome.pupil_band_mm
    )
