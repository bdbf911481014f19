"""calibrate on damaged recordings: a result from what is left or one line, soon, and never half a folder."""

from __future__ import annotations

import time

import numpy as np
import pytest
from bag_writers import mcap_bytes, messages, write_ros1, write_rosbag2
from damages import DAMAGES

from fisheye_ep_calib.storage.recording import open_recording

RESULTS = ["calibration.json", "observations/*.npz", "*.yaml"]  # a damaged topic gives the camera another name


@pytest.fixture(scope="module")
def whole(recording, tmp_path_factory) -> dict[str, bytes]:
    """One camera's images as a file of each format."""
    folder = tmp_path_factory.mktemp("whole")
    with open_recording(recording / "rig.mcap") as opened:
        recorded = messages([frame.image() for frame in opened.frames(["/left/image_raw"])], "/camera/image_raw")
    twice = messages([image for *_, image in 2 * recorded], "/camera/image_raw")  # SQLite writes eight rows at a time
    (db3,) = write_rosbag2(folder / "bag", twice).glob("*.db3")
    return {
        "mcap": mcap_bytes(recorded, chunk_size=10**6),
        "db3": db3.read_bytes(),
        "bag": write_ros1(folder / "a.bag", recorded, chunk_bytes=10**6).read_bytes(),
    }


def calibrate_damaged(command, recording, tmp_path, path) -> int:
    words = ("--target", recording / "board.yaml", "--model", "kannala", "--passes", 1, "--workers", 1, "--no-report")
    began = time.process_time()  # one worker is a thread of this process
    ended = command("calibrate", path, *words, "--output", tmp_path / "out" / path.name)
    assert time.process_time() - began < 10
    assert "Traceback" not in ended.err
    out = tmp_path / "out" / path.name
    hidden = [left for left in tmp_path.rglob(".*")]
    if ended.code == 0:
        written = sum(file.is_file() for file in out.rglob("*"))
        assert [len(list(out.glob(one))) for one in RESULTS] == [1, 1, 1] and written == 3 and not hidden
        return 0
    assert ended.code in (1, 2) and ended.out == ""
    last = ended.err.splitlines()[-1]
    assert last.startswith("fisheye_ep_calib: error: ") and out.exists() == bool(hidden)
    assert not [file for file in out.rglob("*") if file.is_file() and file not in hidden]
    assert (len(hidden) == 1) == ("--resume" in last)  # what was found in too few images
    for left in hidden:
        left.unlink()
        out.rmdir()
    return ended.code


def damage_many(command, recording, whole, tmp_path, form, trials, seed) -> None:
    generator = np.random.default_rng([seed, len(form)])
    codes = []
    for trial in range(trials):
        path = tmp_path / f"{trial}.{form}"
        path.write_bytes(DAMAGES[trial % len(DAMAGES)](whole[form], generator))
        codes.append(calibrate_damaged(command, recording, tmp_path, path))
        if codes[-1] == 0:
            for file in sorted((tmp_path / "out").rglob("*"), reverse=True):
                file.rmdir() if file.is_dir() else file.unlink()
            (tmp_path / "out").rmdir()
    assert {0, 2} <= set(codes)


@pytest.mark.parametrize("form", ["mcap", "db3", "bag"])
def test_damaged_recordings_end_in_a_result_or_one_line(command, recording, whole, tmp_path, form):
    damage_many(command, recording, whole, tmp_path, form, trials=len(DAMAGES), seed=4)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["mcap", "db3", "bag"])
def test_hundreds_of_damaged_recordings_end_in_a_result_or_one_line(command, recording, whole, tmp_path, form):
    damage_many(command, recording, whole, tmp_path, form, trials=60, seed=1)


def test_sixty_percent_of_a_recording_give_a_camera_and_a_word_of_it(command, recording, whole, tmp_path):
    for form, content in whole.items():
        path = tmp_path / f"part.{form}"
        path.write_bytes(content[: int(0.6 * len(content))])
        words = ("--target", recording / "board.yaml", "--model", "kannala", "--workers", 1, "--no-report")
        ended = command("calibrate", path, *words, "--output", tmp_path / form, "--json")
        assert ended.code == 0 and 4 <= ended.json["cameras"]["camera"]["views"] <= 14, ended.err
        assert "warning: " in ended.err and "cut short" in ended.err
        command("calibrate", path, *words, "--output", tmp_path / "strict", "--strict").refused(2, "cut short")
        assert not (tmp_path / "strict").exists()
