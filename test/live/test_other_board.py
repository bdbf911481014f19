"""Another board than the target is told by name, once two looks agree, and no more when the target is back."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from nobody import Nobody

from fisheye_ep_calib.live import other_board
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.frame import RawFrame, Sighting, detect_in_frame
from fisheye_ep_calib.live.other_board import MISSES, PAUSE, OtherBoard
from fisheye_ep_calib.live.settings import CameraSettings, Settings, Tuning
from fisheye_ep_calib.live.status import Reception
from fisheye_ep_calib.simulation import look_pose, paper_camera
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target import Detection, Target, load_target

SIZE = (640, 640)
CAMERA = paper_camera()
CAMERA = replace(CAMERA, image_size=SIZE, fx=CAMERA.fx / 3.2, fy=CAMERA.fy / 3.2, cx=319.0, cy=321.0)
NOTHING = Sighting("1", SIZE, Detection(reason="no board"))
FOUND = Sighting("1", SIZE, Detection(np.arange(20), np.zeros((20, 2))))
CHESS = "a chessboard of 9 × 6 inner corners is seen, not the target"


def image_of(target: Target, number: int = 0) -> np.ndarray:
    pose = look_pose(target, 0.1 + 0.05 * number, 0.3 * number, 0.12)
    return render(CAMERA, target, pose, Imaging(blur=0.7, noise=2.0, seed=number))


def raw(image: np.ndarray) -> RawFrame:
    height, width = image.shape
    return RawFrame("1", image.tobytes(), height=height, width=width, encoding="mono8", step=width)


def test_it_is_looked_for_after_some_misses_and_not_all_the_time() -> None:
    now = [0.0]
    board = OtherBoard(lambda: now[0])
    for _ in range(MISSES - 1):
        board.take(NOTHING)
        assert not board.due()
    board.take(NOTHING)
    assert board.due() and not board.due()
    now[0] += PAUSE
    assert board.due()
    board.take(FOUND)
    now[0] += PAUSE
    assert not board.due()


def test_it_is_told_once_two_looks_agree_until_the_target_is_back() -> None:
    board = OtherBoard()
    for text in (CHESS, "a grid of 12 discs is seen, not the target"):
        board.take(replace(NOTHING, other_board=text))
        assert board.sentence == ""
    board.take(replace(NOTHING, other_board=CHESS))
    board.take(NOTHING)  # not looked for in between
    board.take(replace(NOTHING, other_board=CHESS))
    assert board.sentence == CHESS
    board.take(NOTHING)
    assert board.sentence == CHESS
    board.take(FOUND)
    assert board.sentence == ""


@pytest.mark.parametrize(
    ("asked", "shown", "told"),
    [
        ("circle_grid_11x7", "chessboard_9x6", CHESS),
        ("chessboard_9x6", "circle_grid_11x7", "a grid of 77 discs is seen, not the target"),
        ("aprilgrid_6x5", "chessboard_9x6", CHESS),
    ],
)
def test_a_worker_names_it_where_it_is_asked_to(asked: str, shown: str, told: str) -> None:
    image = image_of(load_target(shown))
    assert detect_in_frame(raw(image), load_target(asked)).other_board is None
    assert detect_in_frame(raw(image), load_target(asked), others=True).other_board == told
    large = cv2.resize(image, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC)
    assert detect_in_frame(raw(large), load_target(asked), others=True).other_board == told


def test_the_target_itself_is_none_and_an_empty_image_has_none() -> None:
    target = load_target("chessboard_9x6")
    assert detect_in_frame(raw(image_of(target)), target, others=True).other_board is None
    empty = np.random.default_rng(1).integers(90, 110, SIZE[::-1], dtype=np.uint8)
    assert detect_in_frame(raw(empty), target, others=True).other_board == ""


def test_the_status_says_it_in_place_of_a_pose(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(other_board, "PAUSE", 0.0)
    target, other = load_target("circle_grid_11x7"), load_target("chessboard_9x6")
    settings = CameraSettings("front", "/front/image_raw", False, target, "auto", None, "", "")
    live = LiveCalibrator(Settings((settings,), tmp_path, False, 1), Tuning(), Announcer(print, print), Nobody())
    sent = 0

    def status(image: np.ndarray) -> dict[str, Any]:
        nonlocal sent
        sent += 1
        header = SimpleNamespace(frame_id="front")
        height, width = image.shape
        live.offer("front", SimpleNamespace(header=header, **vars_of(image)), f"{sent}.0")
        give_up = time.monotonic() + 120
        while live.cameras["front"].looks.last.number < sent and time.monotonic() < give_up:
            time.sleep(0.01)
        (told,) = live.status({"front": Reception("/front/image_raw", False, 0.0, 0.0)})
        return told.as_dict()

    def vars_of(image: np.ndarray) -> dict[str, Any]:
        frame = raw(image)
        names = ("height", "width", "encoding", "is_bigendian", "step", "data")
        return {name: getattr(frame, name) for name in names}

    try:
        wrong = [status(image_of(other)) for _ in range(MISSES + 2)]
        assert wrong[0]["say"] != CHESS and wrong[-1]["say"] == CHESS and wrong[-1]["level"] == "WARN"
        assert wrong[-1]["next"].startswith(CHESS) and wrong[-1]["message"] == CHESS
        right = status(image_of(target))
        assert right["say"].startswith("hold the target") and right["other_board"] == ""
    finally:
        live.stop()
