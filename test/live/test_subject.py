"""Calibrations of a subject that cross with resets, with each other and with the disk, in every order that is asked."""

from __future__ import annotations

import threading
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import pytest

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.settings import Tuning
from fisheye_ep_calib.live.subject import Basis, Subject, Workplace
from fisheye_ep_calib.live.work_pool import Task
from fisheye_ep_calib.storage import kept_file


class Bench:
    """A pool whose tasks are begun and ended by hand."""

    def __init__(self) -> None:
        self.queued: list[Task] = []

    def queue_job(self, task: Task) -> None:
        self.queued.append(task)

    def begin(self) -> Work:
        return Work(self.queued.pop(0))

    def run(self) -> None:
        self.begin().end()


class Work:
    """A task whose arguments have been taken, as by a worker that is busy with it."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.error: CalibrationError | None = None
        try:
            self.arguments = task.arguments()
        except CalibrationError as error:
            self.error = error

    def end(self, error: CalibrationError | None = None) -> None:
        error = self.error or error
        self.task.done(None if error else self.task.function(*self.arguments), error)


class Counted(Subject[str]):
    """Its calibration is how much there was to calibrate from."""

    calibrator = staticmethod("calibration of {}".format)

    def __init__(self, folder: Path, workplace: Workplace, tell: Any, initial: str | None = None) -> None:
        super().__init__("front", workplace, tell, initial)
        self.file = folder / "front.yaml"
        self.amount, self.generation = 0, 0
        self.objecting = ""
        self.resettable = True

    def basis(self) -> Basis:
        return Basis(self.generation, self.amount)

    def enough(self, basis: Basis) -> bool:
        return self.amount >= 3

    def arguments(self, basis: Basis) -> tuple[Hashable, ...]:
        if self.amount == 0:
            raise CalibrationError("nothing there")
        return (self.amount,)

    def objection(self, outcome: str, before: str) -> str:
        return self.objecting

    def files(self, outcome: str) -> dict[Path, str]:
        return {self.file: outcome}

    def summary(self) -> Answer:
        return Answer(True, f"front: {self.outcome}")

    def forget_views(self) -> str:
        if not self.resettable:
            raise CalibrationError("cannot rename")
        self.amount, self.generation = 0, self.generation + 1
        return "forgotten"


class Scene:
    def __init__(self, folder: Path, initial: str | None = None) -> None:
        self.bench = Bench()
        self.told: list[str | None] = []
        self.said: list[str] = []
        self.tuning = Tuning()
        announcer = Announcer(self.said.append, self.said.append)
        workplace = Workplace(
            self.bench,  # type: ignore[arg-type]
            announcer,
            lambda: self.tuning,
            lambda: self.subject.calibrate_if_due(),
        )
        self.subject = Counted(folder, workplace, self.told.append, initial)


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


def answer_of(promise: Any) -> Answer:
    assert promise.ready.is_set()
    return promise.answer


def test_calibrated_once_for_each_state_and_again_when_more_has_come_meanwhile(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    for subject.amount in range(1, 6):
        subject.calibrate_if_due()
    assert len(bench.queued) == 1
    work = bench.begin()
    subject.amount = 7
    subject.calibrate_if_due()
    assert bench.queued == []  # the one that runs must end first
    work.end()
    bench.run()
    assert scene.told == ["calibration of 5", "calibration of 7"] and bench.queued == []
    assert subject.file.read_text() == "calibration of 7" and not subject.unwritten


def test_not_without_being_asked_where_that_is_not_wanted(scene: Scene) -> None:
    scene.tuning = Tuning(auto_calibrate=False)
    scene.subject.amount = 5
    scene.subject.calibrate_if_due()
    assert scene.bench.queued == []
    promise = scene.subject.calibrate()
    scene.bench.run()
    assert answer_of(promise) == Answer(True, "front: calibration of 5") and scene.told == ["calibration of 5"]


def test_ten_calls_at_once_are_one_calibration(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    subject.calibrate_if_due()  # is waited for as well
    promises = [subject.calibrate() for _ in range(5)]
    work = bench.begin()
    promises += [subject.calibrate() for _ in range(5)]
    assert bench.queued == []
    work.end()
    assert {answer_of(promise) for promise in promises} == {Answer(True, "front: calibration of 4")}
    assert scene.told == ["calibration of 4"]


def test_a_call_that_knows_of_more_is_another_calibration(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    early = subject.calibrate()
    work = bench.begin()
    subject.amount = 5
    late = [subject.calibrate() for _ in range(3)]
    work.end()
    bench.run()
    assert bench.queued == [] and scene.told == ["calibration of 4", "calibration of 5"]
    assert answer_of(early).text == "front: calibration of 4"
    assert {answer_of(promise).text for promise in late} == {"front: calibration of 5"}


def test_a_file_that_went_is_written_again_and_told(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    subject.calibrate()
    bench.run()
    subject.retry_writing()
    told = len(scene.said)
    subject.file.unlink()
    assert subject.unwritten
    subject.retry_writing()
    assert subject.file.read_text() == "calibration of 4" and not subject.unwritten
    assert scene.said[told:] == [f"front: {subject.file} had gone from the disk, or was changed: written again"]


@pytest.mark.parametrize("when", ["waiting", "running"])
@pytest.mark.parametrize("asked", [True, False])
def test_what_a_reset_overtakes_changes_nothing(scene: Scene, when: str, asked: bool) -> None:
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    promise = subject.calibrate() if asked else subject.calibrate_if_due()
    work = bench.begin() if when == "running" else None
    assert subject.reset() == Answer(True, "front: forgotten")
    scene.tuning = Tuning(auto_calibrate=False)
    subject.amount = 4  # as many as before the reset: they are others
    (work or bench.begin()).end()
    assert scene.told == [None] and subject.outcome is None and not subject.file.exists() and scene.said == []
    if asked:
        assert answer_of(promise) == Answer(False, "front: its views were reset meanwhile")
    scene.tuning = Tuning()
    subject.calibrate_if_due()
    bench.run()
    assert subject.outcome == "calibration of 4"


def test_a_failure_that_a_reset_overtakes_is_not_told(scene: Scene) -> None:
    scene.subject.amount = 4
    scene.subject.calibrate_if_due()
    work = scene.bench.begin()
    scene.subject.reset()
    work.end(CalibrationError("too few"))
    assert scene.said == []


def test_a_slow_calibration_does_not_take_the_place_of_a_later_one(scene: Scene) -> None:
    """Three workers: two calibrate at the same time."""
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    early = subject.calibrate()
    slow = bench.begin()
    subject.amount = 9
    subject.calibrate_if_due()
    bench.run()
    slow.end()
    assert scene.told == ["calibration of 9"] and subject.file.read_text() == "calibration of 9"
    assert answer_of(early).text == "front: a calibration that began later is in force already; it stays"


def test_a_failure_is_told_once_and_not_tried_again_on_the_same(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.amount = 4
    for _ in range(2):
        subject.calibrate_if_due()
        for work in [bench.begin() for _ in bench.queued[:1]]:
            work.end(CalibrationError("too few"))
    assert scene.said == ["front: not calibrated: too few"] and bench.queued == []
    subject.amount = 0
    promise = subject.calibrate()
    bench.run()
    assert answer_of(promise) == Answer(False, "front: nothing there")


def test_one_that_knows_less_is_taken_only_where_it_was_asked_for(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.objecting = "the one before knows more"
    for subject.amount in (4, 5):
        subject.calibrate_if_due()
        bench.run()
    assert scene.told == ["calibration of 4"]
    subject.calibrate()
    bench.run()
    assert scene.told[-1] == "calibration of 5"


def test_what_was_there_before_is_in_force_again_after_a_reset_and_is_not_written(tmp_path: Path) -> None:
    scene = Scene(tmp_path, initial="from a file")
    subject = scene.subject
    assert subject.outcome == "from a file" and subject.save(threading.Event()).success
    assert not subject.file.exists()
    subject.amount = 3
    subject.calibrate_if_due()
    scene.bench.run()
    subject.reset()
    assert scene.told == ["calibration of 3", "from a file"] and subject.standing.number == 0


def test_a_reset_that_fails_forgets_nothing(scene: Scene) -> None:
    subject = scene.subject
    subject.amount, subject.resettable = 3, False
    subject.calibrate_if_due()
    work = scene.bench.begin()
    assert subject.reset() == Answer(False, "front: cannot rename")
    work.end()
    assert scene.told == ["calibration of 3"]


def test_no_file_appears_after_a_reset(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The disk is slow; meanwhile all is forgotten."""
    subject, bench = scene.subject, scene.bench
    begun, go_on, order = threading.Event(), threading.Event(), []
    write = kept_file.atomic_write

    def slowly(*arguments: Any) -> None:
        begun.set()
        go_on.wait(10)
        write(*arguments)
        order.append("written")

    monkeypatch.setattr(kept_file, "atomic_write", slowly)
    subject.amount = 3
    subject.calibrate_if_due()
    calibrating = threading.Thread(target=bench.run)
    calibrating.start()
    assert begun.wait(10)
    resetting = threading.Thread(target=lambda: (subject.reset(), order.append("reset")))
    resetting.start()
    resetting.join(0.2)
    assert order == []
    go_on.set()
    calibrating.join(10)
    resetting.join(10)
    assert order == ["written", "reset"] and subject.outcome is None and not subject.unwritten
    subject.retry_writing()
    assert order == ["written", "reset"]


def test_a_refusing_disk_is_told_once_and_what_is_newest_is_written(scene: Scene) -> None:
    subject, bench = scene.subject, scene.bench
    subject.file.mkdir()
    for subject.amount in (3, 4):
        subject.calibrate_if_due()
        bench.run()
    assert subject.unwritten and len([text for text in scene.said if "cannot write" in text]) == 1
    subject.file.rmdir()
    subject.retry_writing()
    assert subject.file.read_text() == "calibration of 4" and not subject.unwritten
    assert scene.said[-1] == "front: everything is written now"
