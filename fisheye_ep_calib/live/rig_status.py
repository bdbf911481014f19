"""Where the calibration of a rig stands, and what the person who holds the target can do for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from fisheye_ep_calib.live.rig_session import RigSession
from fisheye_ep_calib.live.status import Level, Status
from fisheye_ep_calib.rig.assembly import MIN_COMMON_VIEWS

ENOUGH = 10  # common views of two cameras from which on more add little


def rig_status(session: RigSession, warnings: list[str]) -> Status:
    """Status of a rig. warnings: texts that stand."""
    counts, joined, outcome = session.views.counts(), session.joined(), session.outcome
    apart = [name for name in session.names if name not in joined]
    values: dict[str, Any] = {
        "joined": list(joined),
        "apart": apart,
        "uncalibrated": list(session.uncalibrated),
        "common_views": _common_views(session.names, counts),
        "unwritten": session.unwritten,
        "calibrated": outcome is not None,
        "calibration": outcome.figures if outcome is not None else None,
        "warnings": warnings,
    }
    level = Level.WARN if warnings else Level.OK
    if warnings:
        message = warnings[0]
    elif outcome is not None:
        message = f"{len(outcome.figures['cameras'])} of {len(session.names)} cameras placed"
    elif apart:
        message = f"not joined yet: {', '.join(apart)}"
    else:
        message = "all cameras are joined by common views"
    return Status("rig", level, message, next_step(session), values)


def next_step(session: RigSession) -> str:
    """What would help most, in one sentence."""
    counts, names, joined = session.views.counts(), session.names, session.joined()
    inside = [number for number, name in enumerate(names) if name in joined]
    outside = [number for number, name in enumerate(names) if name not in joined]
    if outside:
        a, b = max(((a, b) for a in inside for b in outside), key=lambda pair: counts[pair])
        missing = MIN_COMMON_VIEWS - int(counts[a, b])
        return (
            f"hold the target where {names[a]} and {names[b]} both see it: "
            f"{missing} more common view{'s' if missing > 1 else ''} at least"
        )
    if session.uncalibrated:
        return f"calibrate {', '.join(session.uncalibrated)} first: show the target there"
    weak = [number for number in range(len(names)) if np.delete(counts[number], number).max() < ENOUGH]
    if weak:
        a = weak[-1]
        b = int(np.argmax(np.where(np.arange(len(names)) == a, -1, counts[a])))
        return (
            f"move and tilt the target where {names[min(a, b)]} and {names[max(a, b)]} both see it: "
            f"{counts[a, b]} common views so far"
        )
    return "save, or go on moving the target where two cameras see it"


def _common_views(names: tuple[str, ...], counts: np.ndarray) -> list[dict[str, Any]]:
    return [
        {"cameras": [names[a], names[b]], "views": int(counts[a, b])}
        for a in range(len(names))
        for b in range(a + 1, len(names))
    ]
