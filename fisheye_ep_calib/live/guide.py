"""Which pose a camera asks for now: one after the other of a plan, each until it is reached or given up."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from fisheye_ep_calib.live.advice import Wanted
from fisheye_ep_calib.planning.guidance import Suggestion
from fisheye_ep_calib.planning.steering import Steering, steer
from fisheye_ep_calib.planning.view_selection import ViewSignature

PATIENCE = 20.0  # seconds for which a pose is asked for
FRAMES = 15  # that were searched meanwhile, at least
_MOST_TRIED = 30


class Guide:
    """Safe to use from several threads. What was not reached is not asked for again, by later plans either."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._plan: tuple[Wanted, ...] = ()
        self._since: float | None = None
        self._frames = 0
        self._tried: list[Suggestion] = []
        self._now: ViewSignature | None = None
        self._lock = threading.Lock()

    @property
    def wanted(self) -> Wanted | None:
        """The pose that is asked for; None where the plan is at its end."""
        plan = self._plan
        return plan[0] if plan else None

    @property
    def tried(self) -> tuple[Suggestion, ...]:
        """Poses that were asked for and not reached."""
        return tuple(self._tried)

    @property
    def steering(self) -> Steering | None:
        """From the target as it was last seen to where it is wanted; None where either is unknown."""
        wanted, now = self.wanted, self._now
        if wanted is None or wanted.signature is None or now is None:
            return None
        return steer(now, wanted.signature)

    def follow(self, plan: Sequence[Wanted], kept: Sequence[ViewSignature] = ()) -> None:
        """A new plan, without what a kept view shows already and, while more is left, what was tried in vain."""
        with self._lock:
            new = [wanted for wanted in plan if not any(wanted.shown_by(view) for view in kept)]
            left = [wanted for wanted in new if not any(wanted.suggestion.like(tried) for tried in self._tried)]
            if new and not left:
                left, self._tried = new, []
            same = self._plan and left and left[0].suggestion.like(self._plan[0].suggestion)
            self._plan = tuple(left)
            if not same:
                self._begin()

    def searched(self, signature: ViewSignature | None) -> None:
        """A frame was searched; signature: of what was found. Goes on to the next pose where it is time to."""
        with self._lock:
            self._now = signature
            if not self._plan:
                return
            if self._since is None:
                self._since = self._clock()
            self._frames += 1
            if signature is not None and self._plan[0].shown_by(signature):
                self._next()
            elif self._frames >= FRAMES and self._clock() - self._since > PATIENCE:
                self._tried = [*self._tried, self._plan[0].suggestion][-_MOST_TRIED:]
                self._next()

    def forget(self) -> None:
        with self._lock:
            self._plan, self._tried, self._now = (), [], None
            self._begin()

    def _next(self) -> None:
        self._plan = self._plan[1:]
        self._begin()

    def _begin(self) -> None:
        self._since, self._frames = None, 0
