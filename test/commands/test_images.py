"""Cameras from images, through the command: rendered bags of known cameras and a folder of real photographs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import yaml
from small_recording import CAMERAS, TARGET, VIEWS

from fisheye_ep_calib.simulation import StampedImage, write_bag
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.observation_file import load_observations


def test_two_cameras_by_their_topics(command, recording, tmp_path) -> None:
    ended = command(
        "calibrate", recording / "rig.mcap", "--target", recording / "board.yaml", "--model", "ep_even", "--workers", 1,
        "--topic", "front=/left/image_raw", "--topic", "rear=/right/image_raw", "--all", "--json",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    cameras = ended.json["cameras"]
    assert list(cameras) == ["front", "rear"]
    for name, truth in zip(("front", "rear"), CAMERAS.values(), strict=True):
        said = cameras[name]
        assert said["converged"] and said["views"] + len(said["unused_views"]) == VIEWS and said["views"] >= 10
        assert said["rms_px"] < 0.15 and said["points"] > 0.85 * said["views"] * 48
        assert said["seconds"]["read"] > 0 and said["seconds"]["detect"] > 0
        found = read_camera_file(tmp_path / said["yaml"]).camera
        assert abs(found.fx / truth.fx - 1) < 0.01 and abs(found.cx - truth.cx) < 1.5
    again = command("evaluate", cameras["front"]["yaml"], "calibration/observations/front.npz", "--json").json
    assert again["views"] == cameras["front"]["views"] and again["rms_px"] < 0.15


def test_files_on_disk_are_the_same_bits_for_any_number_of_workers(command, recording, tmp_path) -> None:
    """Both passes and the choice of the model; but for the time that is written into it, and where it lies."""
    words = ("calibrate", recording / "rig.mcap", "--target", recording / "board.yaml", "--topic", "/left/image_raw")
    contents = []
    for workers in (1, 2, 3):
        assert command(*words, "--workers", workers, "--output", f"out{workers}", "--no-report").code == 0
        text = (tmp_path / f"out{workers}" / "left.yaml").read_text("utf-8")
        lines = [line for line in text.splitlines() if not line.lstrip().startswith("date:")]
        assert len(lines) == len(text.splitlines()) - 1
        seen = load_observations(tmp_path / f"out{workers}" / "observations" / "left.npz")
        contents.append((lines, seen.pixels.tobytes(), seen.point_index.tobytes(), seen.image_names))
    assert contents[0] == contents[1] == contents[2]


def test_one_camera_is_named_after_its_topic(command, recording, tmp_path) -> None:
    ended = command(
        "calibrate", recording / "rig.mcap", "--target", recording / "board.yaml", "--topic", "/right/image_raw",
        "--model", "kannala", "--workers", 1, "--passes", 1, "--all", "--no-report", "--json",
    )  # fmt: skip
    assert list(ended.json["cameras"]) == ["right"] and (tmp_path / "calibration" / "right.yaml").exists()


def test_topics_that_leave_a_choice_are_listed(command, recording, tmp_path) -> None:
    words = ("calibrate", recording / "rig.mcap", "--target", recording / "board.yaml")
    command(*words).refused(2, "/left/image_raw", "/right/image_raw", "--topic")
    command(*words, "--topic", "front=/nowhere").refused(2, "/nowhere", "/left/image_raw")
    command(*words, "--topic", "../front=/left/image_raw").refused(2, "letters, digits")
    command(*words, "--topic", "a=/left/image_raw", "--topic", "a=/right/image_raw").refused(2, "two cameras called a")
    command(*words, "--topic", "=/left/image_raw").refused(2, "--topic =/left/image_raw")
    for option, value in (("--max-views", 0), ("--max-views", -3), ("--every", 0), ("--workers", -1)):
        command(*words, "--topic", "/left/image_raw", option, value).refused(2, f" {value}")
    assert not (tmp_path / "calibration").exists()


def test_evaluate_reads_a_bag_too(command, recording, tmp_path) -> None:
    words = (
        recording / "rig.mcap",
        "--target",
        recording / "board.yaml",
        "--topic",
        "/left/image_raw",
        "--workers",
        1,
    )
    made = command("calibrate", *words, "--model", "ep_even", "--all", "--no-report", "--json").json["cameras"]["left"]
    found = command("evaluate", made["yaml"], *words, "--all", "--json").json
    assert found["views"] >= 10 and found["rms_px"] < 0.2
    alone = (*words[:3], "--workers", 1, "--all", "--json")  # of two cameras the one that the file's is called
    assert command("evaluate", made["yaml"], *alone).json == found
    assert command("evaluate", made["yaml"], *alone, "--topic", "left").json == found
    other = ("--topic", "/right/image_raw")
    worse = command("evaluate", made["yaml"], *words[:3], *other, "--workers", 1, "--all", "--json").json
    assert worse["rms_px"] > 5 * found["rms_px"]


def test_a_board_that_is_never_there(command, recording, tmp_path) -> None:
    (tmp_path / "other.yaml").write_text(yaml.safe_dump({**TARGET, "columns": 20, "rows": 20}))
    blank = np.full((240, 320), 90, np.uint8)
    write_bag(tmp_path / "blank.mcap", [StampedImage("/image", 10**18 + i, "c", blank) for i in range(4)])
    ended = command("calibrate", "blank.mcap", "--target", "other.yaml", "--workers", 1)
    assert ended.code == 1 and ended.out == "" and "error: " in ended.err.splitlines()[-1]
    assert not (tmp_path / "calibration").exists()


@pytest.mark.slow
def test_real_photographs_of_a_partial_board(command, shared_data, tmp_path) -> None:
    """22 × 22 corners never wholly in view, past 90°: every view is used or named with the reason."""
    photographs = sorted((shared_data / "ov_plane" / "images").glob("*.png"))
    assert len(photographs) == 25
    (tmp_path / "board.yaml").write_text("type: chessboard\ncolumns: 22\nrows: 22\nspacing: 0.0075\n")
    images = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in photographs)
    write_bag(
        tmp_path / "photographs.mcap",
        (StampedImage("/camera/image_raw", 10**18 + i * 10**9, "camera", image) for i, image in enumerate(images)),
    )
    ended = command("calibrate", "photographs.mcap", "--target", "board.yaml", "--all", "--no-report", "--json")
    camera = ended.json["cameras"]["camera"]
    left_out = set(camera["unused_views"]) | set(camera["wrong_views"])
    assert camera["views"] + len(left_out) == 25 and all(camera["unused_views"].values())
    assert camera["views"] >= 23 and camera["points"] >= 7900
    assert camera["entrance_pupil_supported"] and camera["converged"]
    assert camera["rms_px"] < 0.5
    assert 100 < np.abs(1e3 * np.array(camera["board_warp_mm"])).max() < 700
