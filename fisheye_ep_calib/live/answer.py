"""What service calls are answered."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Answer:
    """What a service call tells: whether all of it was done, and a line with the numbers."""

    success: bool
    text: str


class Promise:
    """The answer of a calibration that has been queued."""

    def __init__(self) -> None:
        self.ready = threading.Event()
        self.answer = Answer(False, "the calibrator stopped before the calibration ended")

    def wait(self, stopping: threading.Event) -> Answer:
        while not self.ready.wait(0.1) and not stopping.is_set():
            pass
        return self.answer


def together(answers: Sequence[Answer]) -> Answer:
    """One answer of several cameras'."""
    if not answers:
        return Answer(False, "no camera has a target: they are only published")
    return Answer(all(answer.success for answer in answers), "; ".join(answer.text for answer in answers))
