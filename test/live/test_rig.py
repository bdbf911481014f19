"""A rig is calibrated while its cameras are: which views are kept for it, when, from what, and what is told."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from simulated_rig import NAMES, cameras, errors, place, see, targets_between, write_camera

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.camera_views import CameraViews, Verdict
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.outcome import outcome_of_file
from fisheye_ep_calib.live.rig import LiveRig
from fisheye_ep_calib.live.rig_views import RigViews, common_moments
from fisheye_ep_calib.live.settings import Limits, RigSettings, Tuning
from fisheye_ep_calib.live.status import Status, rig_status
from fisheye_ep_calib.live.subject import Workplace
from fisheye_ep_calib.live.work_pool import WorkPool
from fisheye_ep_calib.planning.view_selection import Novelty
from fisheye_ep_calib.simulation import paper_target
from fisheye_ep_calib.storage.rig_file import load_rig
from fisheye_ep_calib.target import Detection, parse_target

PATIENCE = 60.0
BOARD = parse_target({"type": "chessboard", "columns": 6, "rows": 5, "spacing": 0.02})
SIZE = (1280, 800)
DISCS = paper_target()
PLACES = [np.eye(4), place(60, (0.08, 0.01, -0.03), (0.05, 0.0, 0.02)), place(120, (0.05, -0.02, -0.12))]
EVERY_VIEW = Limits(Novelty(0.0, 0.0, 0.0))
START_NS = 1_700_000_000 * 10**9


def wait_for(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.02)


def name_of(stamp_ns: int) -> str:
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def board(column: int, milliseconds: int, size: tuple[int, int] = SIZE) -> Sighting:
    """The board at one of many places, flat on."""
    points = BOARD.object_points[:, :2] * 2000 + np.array([20 + 150 * column, 20])
    return Sighting(name_of(START_NS + 10**6 * milliseconds), size, Detection(np.arange(len(points)), points))


def show(rig: RigViews, cameras: dict[str, CameraViews], name: str, sighting: Sighting) -> Verdict:
    """What the calibrator does with a frame in which a camera saw the target."""
    generation = cameras[name].generation
    verdict = cameras[name].consider(sighting, generation)
    for partner in rig.partners(name, sighting, generation, verdict is Verdict.KEPT):
        assert cameras[partner.camera].keep(partner.view, partner.image_size, partner.generation)
    return verdict


class TwoCameras:
    """front and rear, which see the board; what is kept of it."""

    def __init__(self, folder: Path, most: int = 40, **limits) -> None:
        self.cameras = {
            name: CameraViews(name, BOARD, folder / f"{name}.npz", Limits(**limits)) for name in ("front", "rear")
        }
        self.views = RigViews(tuple(self.cameras.values()), tolerance=0.01, most=most)

    def sees(self, camera: str, column: int, milliseconds: int) -> Verdict:
        return show(self.views, self.cameras, camera, board(column, milliseconds))

    @property
    def kept(self) -> tuple[int, int]:
        return len(self.cameras["front"].kept), len(self.cameras["rear"].kept)

    @property
    def common(self) -> int:
        return int(self.views.counts()[0, 1])


@pytest.mark.parametrize("order", [("front", "rear"), ("rear", "front")])
def test_a_redundant_view_is_kept_where_its_partner_is_new(tmp_path: Path, order) -> None:
    two = TwoCameras(tmp_path)
    for moment, column in enumerate((0, 1, 2)):  # front sees it move, rear does not
        columns = {"front": column, "rear": 0}
        for late, camera in enumerate(order):
            two.sees(camera, columns[camera], 100 * moment + late)
    assert two.kept == (3, 3) and two.common == 3


def test_views_of_other_times_are_no_partners(tmp_path: Path) -> None:
    two = TwoCameras(tmp_path)
    two.sees("rear", 0, 0)
    two.sees("front", 0, 50)
    two.sees("rear", 0, 100)
    assert two.kept == (1, 1) and two.common == 0


def test_what_is_new_to_no_camera_may_be_new_to_both_together(tmp_path: Path) -> None:
    two = TwoCameras(tmp_path, maximum_views=2)
    for column in (0, 1):
        two.sees("front", column, 1000 * column)
        two.sees("rear", column, 1000 * column + 500)
    assert two.kept == (2, 2) and two.common == 0 and two.cameras["front"].full
    for moment in range(4):  # twice the same
        for camera in ("front", "rear"):
            two.sees(camera, moment // 2, 3000 + 100 * moment)
    assert two.kept == (4, 4) and two.common == 2


def test_no_more_are_kept_than_wanted_and_a_loop_shows_nothing_twice(tmp_path: Path) -> None:
    two = TwoCameras(tmp_path, most=2)
    assert two.views.wants("front")
    for _ in range(2):
        for moment in range(4):
            two.sees("rear", 0, 100 * moment)
            two.sees("front", moment, 100 * moment)
    assert two.kept == (4, 2) and two.common == 2 and not two.views.wants("front")


def test_a_partner_from_before_a_reset_is_not_kept(tmp_path: Path) -> None:
    """All cameras are reset one after the other, and the rig after them; meanwhile frames come."""
    two = TwoCameras(tmp_path)
    two.sees("rear", 0, 0)
    two.sees("rear", 0, 100)  # shows nothing new
    two.cameras["rear"].forget()
    front = two.cameras["front"]
    latest = board(3, 100)
    front.consider(latest, front.generation)
    (partner,) = two.views.partners("front", latest, front.generation, True)
    assert partner.camera == "rear"
    assert not two.cameras["rear"].keep(partner.view, partner.image_size, partner.generation)
    assert two.kept == (1, 0)


def test_forgotten_sightings_are_no_partners(tmp_path: Path) -> None:
    two = TwoCameras(tmp_path)
    two.sees("rear", 0, 0)
    two.sees("rear", 0, 100)
    two.views.forget()
    two.sees("front", 3, 100)
    assert two.kept == (1, 1) and two.common == 0


def test_views_whose_names_are_no_times_belong_to_no_moment(tmp_path: Path) -> None:
    two = TwoCameras(tmp_path)
    two.sees("front", 0, 0)
    two.sees("rear", 0, 1)
    detection = board(3, 0).detection
    two.cameras["front"].consider(Sighting("by hand", SIZE, detection), 0)
    assert two.views.partners("front", Sighting("by hand", SIZE, detection), 0, True) == []
    moments = common_moments([camera.kept for camera in two.cameras.values()], 10**7)
    assert moments.tolist() == [[0, 0]]


class Rig:
    """Cameras with known places, calibrated as they are in truth, and what they see. uncalibrated: but for these."""

    def __init__(
        self, folder: Path, overlaps: list[tuple[int, int]], count: int, views: int = 12, uncalibrated: str = ""
    ) -> None:
        models = cameras(count, theta_max_deg=60)
        self.told: list = []
        self.said: list[str] = []
        self.tuning = Tuning()
        self.pool = WorkPool(2, self.said.append)
        announcer = Announcer(self.said.append, self.said.append)
        workplace = Workplace(self.pool, announcer, lambda: self.tuning, lambda: self.rig.calibrate_if_due())
        self.cameras = []
        for name, model in zip(NAMES, models, strict=False):
            write_camera(folder / f"{name}_before.yaml", model, name)
            outcome = None if name == uncalibrated else outcome_of_file(folder / f"{name}_before.yaml")
            seen = CameraViews(name, DISCS, folder / f"{name}.npz", EVERY_VIEW)
            self.cameras.append(LiveCamera(seen, "auto", workplace, lambda outcome: None, outcome))
        poses = [targets_between(PLACES[a], PLACES[b], DISCS, views, seed=10 * a + b) for a, b in overlaps]
        self.seen = see(models, PLACES[:count], DISCS, np.concatenate(poses), noise=0.1)
        topics = {name: f"/{name}/image_raw" for name in NAMES}
        self.rig = LiveRig(self.cameras, topics, RigSettings(), folder, workplace, self.told.append)

    def show(self, camera: int, images: range) -> None:
        one = self.seen[camera]
        observations = one.observations
        for image in images:
            rows = observations.image_index == image
            if not rows.any():
                continue
            detection = Detection(observations.point_index[rows], observations.pixels[rows])
            sighting = Sighting(name_of(START_NS + int(one.stamps_ns[image])), observations.image_size, detection)
            show(self.rig.views, {each.name: each.views for each in self.cameras}, NAMES[camera], sighting)

    def show_all(self, images: range) -> None:
        for image in images:
            for camera in range(len(self.cameras)):
                self.show(camera, range(image, image + 1))

    def status(self) -> Status:
        return rig_status(self.rig, [])

    def calibrate(self) -> Answer:
        return self.rig.calibrate().wait(threading.Event())

    def save(self) -> Answer:
        return self.rig.save(threading.Event())


@pytest.fixture
def make_rig(tmp_path: Path):
    made: list[Rig] = []

    def make(*arguments, **options) -> Rig:
        made.append(Rig(tmp_path, *arguments, **options))
        return made[-1]

    yield make
    for rig in made:
        rig.pool.stop()


def within_stated(rig: Rig, outcome) -> None:
    """Every camera lies where it is, within four times what is stated."""
    file = yaml.safe_load(outcome.yaml)
    for number, camera in enumerate(rig.cameras):
        block = file["cameras"][camera.name]
        angle, distance = errors(np.array(block["reference_from_camera"]), PLACES[number])
        if number > 0:
            assert angle < 4 * np.linalg.norm(block["rotation_sigma"]) < 1e-2
            assert distance < 4 * np.linalg.norm(block["position_sigma"]) < 1e-3


def test_two_cameras_from_nothing_to_a_rig(make_rig, tmp_path: Path) -> None:
    rig = make_rig([(0, 1)], 2)
    status = rig.status()
    assert status.values["joined"] == ["front"] and status.values["apart"] == ["left"]
    assert status.next == "hold the target where front and left both see it: 3 more common views at least"
    rig.rig.calibrate_if_due()
    answer = rig.calibrate()
    assert not answer.success and "front and left both see it" in answer.text
    assert rig.save().success and rig.told == []

    rig.show_all(range(6))
    rig.rig.calibrate_if_due()
    wait_for(lambda: bool(rig.told))
    rig.show_all(range(6, 12))
    rig.rig.calibrate_if_due()
    wait_for(lambda: rig.told[-1].figures["moments"] > 10 and not rig.rig.unwritten)
    outcome = rig.rig.outcome
    within_stated(rig, outcome)
    assert (tmp_path / "rig.yaml").read_text() == outcome.yaml
    file = load_rig(tmp_path / "rig.yaml")
    assert file.camera_files == {"front": "front_before.yaml", "left": "left_before.yaml"}
    assert (tmp_path / "camchain.yaml").read_text() == outcome.files["camchain.yaml"]
    status = rig.status()
    assert status.message == "2 of 2 cameras placed" and status.values["calibrated"]
    assert status.values["calibration"]["cameras"]["left"]["position_sigma_m"][0] > 0

    told = len(rig.told)
    rig.rig.calibrate_if_due()  # nothing new
    answer = rig.save()
    assert answer.success and "left at (8" in answer.text and len(rig.told) == told
    assert rig.calibrate().success and len(rig.told) == told + 1


def test_a_chain_is_joined_and_who_is_not_in_it_is_told(make_rig) -> None:
    rig = make_rig([(0, 1), (1, 2)], 3)
    rig.tuning = Tuning(auto_calibrate=False)
    rig.show_all(range(12))  # front and left alone
    rig.rig.calibrate_if_due()
    answer = rig.calibrate()
    assert not answer.success and "not joined: rear" in answer.text and "and rear both see it" in answer.text
    assert rig.status().message == "2 of 3 cameras placed"
    assert list(rig.rig.outcome.figures["cameras"]) == ["front", "left"]
    rig.show_all(range(12, 24))
    answer = rig.calibrate()
    assert answer.success, answer.text
    assert rig.rig.outcome.figures["cameras"]["rear"]["joined_through"] == ["front", "left", "rear"]
    within_stated(rig, rig.rig.outcome)


def test_a_camera_without_a_calibration_is_waited_for(make_rig) -> None:
    rig = make_rig([(0, 1)], 2, uncalibrated="left")
    rig.show_all(range(6))
    rig.rig.calibrate_if_due()
    assert rig.status().values["uncalibrated"] == ["left"]
    assert rig.status().next == "calibrate left first: show the target there"
    assert "calibrate left first" in rig.calibrate().text
    assert rig.told == []


def test_a_calibration_that_waited_while_all_was_reset_changes_nothing(make_rig, tmp_path: Path) -> None:
    rig = make_rig([(0, 1)], 2)
    rig.show_all(range(6))
    promise = rig.rig.calibrate()
    for camera in rig.cameras:
        camera.reset()
    rig.rig.reset()
    answer = promise.wait(threading.Event())
    assert not answer.success and "reset meanwhile" in answer.text
    assert rig.told == [None] and rig.rig.outcome is None and not (tmp_path / "rig.yaml").exists()
    assert not any("not calibrated" in text for text in rig.said)
    rig.show_all(range(6, 12))
    rig.rig.calibrate_if_due()
    wait_for(lambda: rig.told[-1] is not None)


def test_a_refusing_disk_is_told_once_and_retried(make_rig, tmp_path: Path, monkeypatch) -> None:
    rig = make_rig([(0, 1)], 2)
    rig.show_all(range(6))

    def refuse(*_) -> None:
        raise CalibrationError("cannot write: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("fisheye_ep_calib.storage.kept_file.atomic_write", refuse)
        for _ in range(2):
            assert "writing is tried again" in rig.calibrate().text
        assert rig.status().values["unwritten"] and len([t for t in rig.said if "No space" in t]) == 1
    rig.rig.retry_writing()
    assert (tmp_path / "rig.yaml").exists() and not rig.status().values["unwritten"]
