"""A calibration is held against what the camera sees, and the day it no longer holds is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bent_boards import bent
from known_scenes import BOARD, CAMERA, poses_of, seen

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.words import BAD, CAUTION, GOOD
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.camera_views import Verdict
from fisheye_ep_calib.live.check import WINDOW, Check, check_views
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.outcome import Outcome, outcome_of_file
from fisheye_ep_calib.live.work_pool import Task
from fisheye_ep_calib.pipeline.exporting import export
from fisheye_ep_calib.simulation import observe, paper_camera, paper_target, random_poses
from fisheye_ep_calib.storage.camera_file import load_camera, save_camera
from fisheye_ep_calib.target import Detection

TARGET = paper_target()
NOISE = 0.1


class AtOnce:
    """A pool that works where it is asked."""

    def queue_job(self, task: Task) -> None:
        task.done(task.function(*task.arguments()), None)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """The paper's camera as it was calibrated one day."""
    observed = observe(paper_camera(), TARGET, random_poses(TARGET, 20, 1), NOISE, 1)
    path: Path = tmp_path_factory.mktemp("known") / "front.yaml"
    save_camera(path, calibrate(observed, model="ep_odd"), "front", "simulated")
    return outcome_of_file(path)


def sightings(camera: FisheyeCamera, count: int = 10, seed: int = 5) -> list[Sighting]:
    seen = observe(camera, TARGET, random_poses(TARGET, count, seed), NOISE, seed)
    rows = [seen.image_index == number for number in range(count)]
    return [
        Sighting(f"{number}", camera.image_size, Detection(seen.point_index[row], seen.pixels[row]))
        for number, row in enumerate(rows)
    ]


def knocked(camera: FisheyeCamera) -> FisheyeCamera:
    """The lens sits elsewhere before the sensor, and is turned a little in its thread."""
    return replace(camera, cx=camera.cx + 4.0, cy=camera.cy - 3.0, fx=camera.fx * 1.01, fy=camera.fy * 1.01)


class Scene:
    def __init__(self, known: Outcome) -> None:
        self.said: list[str] = []
        self.now = 0.0
        announcer = Announcer(self.said.append, self.said.append)
        pool: Any = AtOnce()
        self.check = Check("front", TARGET, known, pool, announcer, lambda: self.now)

    def see(self, camera: FisheyeCamera, count: int = 10, seed: int = 5) -> None:
        for sighting in sightings(camera, count, seed):
            assert self.check.take(sighting) is Verdict.CHECKED
            self.now += 1


def test_a_camera_as_it_was_holds_with_what_is_expected(known: Outcome) -> None:
    scene = Scene(known)
    scene.see(paper_camera())
    result = scene.check.result
    assert result is not None and result.level != BAD and result.sentence.startswith("the calibration holds: ")
    figures = result.figures
    assert 0.85 < figures["rms_px"] / figures["expected_rms_px"] < 1.2
    assert figures["views"] == 10 and scene.said == []
    for parts, unit in ((figures["by_angle"], "deg"), (figures["by_distance"], "m")):
        assert len(parts) >= 3 and all(part[f"from_{unit}"] < part[f"to_{unit}"] for part in parts)
        total = sum(part["points"] * part["rms_px"] ** 2 for part in parts)
        assert sum(part["points"] for part in parts) == figures["points"]
        assert np.isclose(np.sqrt(total / figures["points"]), figures["rms_px"])
    assert 0.08 < figures["by_distance"][0]["from_m"] < 0.2


def test_a_camera_that_was_knocked_is_told_once_and_being_mended_too(known: Outcome) -> None:
    scene = Scene(known)
    scene.see(paper_camera())
    scene.now += WINDOW
    scene.see(knocked(paper_camera()))
    result = scene.check.result
    assert result is not None and result.level == BAD
    assert result.sentence.startswith("the calibration no longer holds: ") and "px expected" in result.sentence
    assert scene.said == [text for text in scene.said if text.startswith("front: the calibration no longer holds")]
    assert len(scene.said) == 1
    scene.now += WINDOW
    scene.see(paper_camera(), seed=8)
    assert scene.check.result.level != BAD and scene.said[-1].startswith("front: the calibration holds")


def test_what_was_seen_long_ago_or_again_counts_once_and_no_longer(known: Outcome) -> None:
    scene = Scene(known)
    scene.see(paper_camera(), 5)
    scene.see(paper_camera(), 5)  # the same places
    assert len(scene.check.views) == 5
    scene.now += WINDOW
    scene.see(paper_camera(), 2, seed=9)
    assert len(scene.check.views) == 2


def test_what_cannot_be_checked_is_no_look(known: Outcome) -> None:
    check, size = Scene(known).check, paper_camera().image_size
    assert check.take(Sighting("1", size, Detection(reason="none"))) is Verdict.NOT_FOUND
    few = Detection(np.arange(3), np.zeros((3, 2)))
    assert check.take(Sighting("2", size, few)) is Verdict.TOO_FEW_POINTS
    assert check.take(replace(sightings(paper_camera(), 1)[0], image_size=(10, 10))) is Verdict.OTHER_SIZE
    assert check.result is None


def test_another_camera_altogether_does_not_hold(known: Outcome) -> None:
    other = replace(paper_camera(), fx=300.0, fy=300.0)
    observed = observe(other, TARGET, random_poses(TARGET, 6, 2, theta_deg=(0, 40)), NOISE, 2)
    assert check_views(observed, known).level == BAD


def test_a_good_check_has_nothing_to_regret(known: Outcome) -> None:
    observed = observe(paper_camera(), TARGET, random_poses(TARGET, 20, 3, theta_deg=(0, 60)), NOISE, 3)
    result = check_views(observed, known)
    assert result.level == GOOD or result.figures["concerns"]


READ = [name for name, format in FORMATS.items() if format.read is not None]


@pytest.mark.parametrize("name", READ)
def test_a_camera_of_another_program_is_published_and_checked(name, tmp_path) -> None:
    """As this package's file; of a camera with one viewpoint, which each of these programs has."""
    central = replace(CAMERA, model="kannala", coefficients=(), skew=0.0)
    path = tmp_path / "theirs.yaml"
    export(central, name, path)
    known = outcome_of_file(path)
    (tmp_path / "told.yaml").write_text(known.yaml)
    told = load_camera(tmp_path / "told.yaml")
    views = seen(central, BOARD.object_points, poses_of(12, 5, 50.0), 0.1)
    points = views.object_points + [0.0, 0.0, 0.3]
    assert np.abs(told.project(points)[0] - central.project(points)[0]).max() < 0.25  # mrcal's lens has fewer terms
    holds = check_views(views, known)
    assert 0.1 < holds.figures["rms_px"] < 0.16
    assert holds.level == CAUTION and "what is to be expected its file does not tell" in holds.sentence
    moved = replace(central, fx=0.8 * central.fx, fy=0.8 * central.fy)
    wrong = check_views(seen(moved, BOARD.object_points, poses_of(12, 5), 0.1), known)
    assert wrong.figures["rms_px"] > 5 * holds.figures["rms_px"] and wrong.level != GOOD


def test_another_board_of_the_same_file_is_no_fault_of_the_camera(known: Outcome) -> None:
    """The camera's calibration had a flat board, and the one before it now is bent."""
    true = bent(BOARD.object_points, "bow", 1e-3)
    views = replace(seen(CAMERA, true, poses_of(12, 5)), object_points=BOARD.object_points)
    of_camera = replace(known, camera=CAMERA, covariance=None)
    result = check_views(views, of_camera)
    assert result.figures["rms_px"] < 0.16
    assert "estimated from these views" in result.figures["board"]
