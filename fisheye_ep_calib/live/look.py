"""What became of the frame that was looked at last: told on every look, with a word that a sound can be made of."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from enum import Enum

from fisheye_ep_calib.live.camera_views import Verdict
from fisheye_ep_calib.live.frame import Sighting


class Event(Enum):
    """The value is the word in ``~/status``."""

    KEPT = "kept"
    TOO_FEW_POINTS = "too few points"
    BLURRED = "blurred"
    NOT_NEW = "not new"
    CHECKED = "checked"
    FULL = "enough views"
    OTHER_SIZE = "other size"
    NOT_FOUND = "no target"
    NONE = "none"


_EVENTS = {
    Verdict.KEPT: Event.KEPT,
    Verdict.NOT_NEW: Event.NOT_NEW,
    Verdict.TOO_FEW_POINTS: Event.TOO_FEW_POINTS,
    Verdict.FULL: Event.FULL,
    Verdict.OTHER_SIZE: Event.OTHER_SIZE,
    Verdict.NOT_FOUND: Event.NOT_FOUND,
    Verdict.FORGOTTEN: Event.NONE,
    Verdict.CHECKED: Event.CHECKED,
}
_WEIGHT = {event: weight for weight, event in enumerate(reversed(Event))}


@dataclass(frozen=True)
class Look:
    """number: counts looks. points: that were found of the target's. reason: why nothing or little was found."""

    number: int
    event: Event
    points: int = 0
    reason: str = ""


class Looks:
    """The last look, and the one that matters most since somebody asked; safe to use from several threads."""

    def __init__(self) -> None:
        self._last = Look(0, Event.NONE)
        self._most: Look = self._last
        self._lock = threading.Lock()

    @property
    def last(self) -> Look:
        return self._last

    def take(self, sighting: Sighting, verdict: Verdict) -> None:
        event, reason = _EVENTS[verdict], sighting.detection.reason
        if reason.startswith("blurred") and event in (Event.NOT_FOUND, Event.TOO_FEW_POINTS):
            event = Event.BLURRED
        with self._lock:
            self._last = Look(self._last.number + 1, event, len(sighting.detection), reason)
            if _WEIGHT[event] >= _WEIGHT[self._most.event]:
                self._most = self._last

    def since_asked(self) -> Look:
        """What mattered most since the last call: a view that was kept before anything else."""
        with self._lock:
            most, self._most = self._most, Look(self._last.number, Event.NONE)
        return most
