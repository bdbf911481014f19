"""calibrate-fleet: each device for itself, all in one table, the odd ones out."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from known_scenes import CAMERA, seen_board

import fisheye_ep_calib
from fisheye_ep_calib.commands import fleet_jobs
from fisheye_ep_calib.commands.fleet_devices import find_devices
from fisheye_ep_calib.commands.fleet_table import FEWEST, device_rows, mark_odd, robust_z, threshold
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.writing import RECORD
from fisheye_ep_calib.storage.folder_owner import LOCK, FolderOwner
from fisheye_ep_calib.storage.observation_file import save_observations

BOARD_FILE = Path(fisheye_ep_calib.__file__).parents[1] / "config" / "targets" / "circle_grid_11x7.yaml"
OPTIONS = ("--model", "ep_even", "--no-report", "--no-skew")


def table(folder: Path) -> dict[str, dict[str, str]]:
    with open(folder / "fleet.csv", encoding="utf-8", newline="") as file:
        return {row["device"]: row for row in csv.DictReader(file)}


def device(seed: int, **change):
    rng = np.random.default_rng(seed)
    fx = 480 * (1 + 0.002 * rng.normal())
    camera = replace(CAMERA, skew=0.0, fx=fx, fy=fx + 3, cx=812 + 2 * rng.normal(), cy=590 + 2 * rng.normal())
    return seen_board(replace(camera, **change), views=14, seed=seed)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory) -> Path:
    """Six devices of a kind, one with another focal length, one with too few views."""
    folder = tmp_path_factory.mktemp("fleet")
    for number in range(6):
        save_observations(folder / f"unit{number}.npz", device(number, **({"fx": 530.0} if number == 4 else {})))
    save_observations(folder / "unit6.npz", device(6).select_images([0, 1]))
    return folder


def test_a_fleet_ends_in_a_table_with_the_odd_one_marked(command, fleet, tmp_path):
    ended = command("calibrate-fleet", fleet, "--output", "out", *OPTIONS)
    assert ended.code == 1, ended.err  # unit6
    rows = table(tmp_path / "out")
    assert list(rows) == [f"unit{number}" for number in range(7)]
    for number in range(6):
        row = rows[f"unit{number}"]
        assert row["status"] == "done" and row["supported"] == "True" and int(row["views"]) == 14
        assert float(row["fx_sigma"]) < 1 and 0.1 < float(row["rms_px"]) < 0.16
        assert abs(float(row["E60_mm"]) - 1e3 * CAMERA.entrance_pupil(np.radians(60))) < 5 * float(row["E60_sigma_mm"])
        assert (tmp_path / "out" / f"unit{number}" / f"unit{number}.yaml").exists()
    assert [name for name, row in rows.items() if row["odd"]] == ["unit4"] and "fx +" in rows["unit4"]["odd"]
    assert rows["unit6"]["status"] == "failed" and "2 views have" in rows["unit6"]["reason"]
    assert not (tmp_path / "out" / "unit6").exists()
    assert "2 views have" in (tmp_path / "out" / "logs" / "unit6.txt").read_text()
    assert "ODD: r(80°) +" in ended.out and "7/7 unit6: failed: " in ended.err and "Traceback" not in ended.err

    shutil.copy(fleet / "unit0.npz", tmp_path / "unit6.npz")
    before = (tmp_path / "out" / "unit0" / "calibration.json").stat().st_mtime_ns
    lines = [f"{fleet / f'unit{number}.npz'}\n" for number in range(6)]
    (tmp_path / "list.txt").write_text("# the fleet\n\n" + "".join(lines) + "unit6.npz\n")
    again = command("calibrate-fleet", "list.txt", "--output", "out", *OPTIONS, "--json")
    assert again.code == 0 and "7 devices, 6 of them finished before" in again.err and "1/1 unit6: done" in again.err
    assert [row["device"] for row in again.json["devices"]] == list(rows)
    assert (tmp_path / "out" / "unit0" / "calibration.json").stat().st_mtime_ns == before
    other = command("calibrate-fleet", "list.txt", "--output", "out", "--model", "kannala", "--no-report", "--no-skew")
    assert other.code == 0 and "unit0 was calibrated before with another --model; --overwrite" in other.err


def test_bags_are_devices_and_some_at_once_give_the_same(command, recording, tmp_path):
    for name in ("a", "b"):
        (tmp_path / "bags" / name).mkdir(parents=True)
        shutil.copy(recording / "rig.mcap", tmp_path / "bags" / name / "rig.mcap")
    (tmp_path / "bags" / "c.mcap").write_bytes(b"broken")
    words = ("calibrate-fleet", "bags", "--target", recording / "board.yaml", "--topic", "front=/left/image_raw")
    words += ("--topic", "rear=/right/image_raw", *OPTIONS, "--workers", 1, "--passes", 1)
    assert command(*words, "--output", "one").code == 1
    assert command(*words, "--output", "two", "--jobs", 3).code == 1
    for out in ("one", "two"):
        with open(tmp_path / out / "fleet.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        assert [(row["device"], row["camera"], row["status"]) for row in rows] == [
            ("a", "front", "done"), ("a", "rear", "done"), ("b", "front", "done"), ("b", "rear", "done"),
            ("c", "", "failed"),
        ]  # fmt: skip
        assert "c.mcap" in rows[4]["reason"]
        values = [{key: row[key] for key in row if key not in ("device", "source", "yaml")} for row in rows]
        assert values[:2] == values[2:4]


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_ctrl_c_ends_all_devices_and_the_same_command_goes_on(fleet, tmp_path):
    root = str(Path(fisheye_ep_calib.__file__).parents[1])
    words = [sys.executable, "-m", "fisheye_ep_calib", "calibrate-fleet", str(fleet), "--output", "out", *OPTIONS]
    process = subprocess.Popen(
        words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": root}, stderr=subprocess.PIPE, text=True,
        stdout=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    while "1/7 unit0: done" not in process.stderr.readline():
        assert process.poll() is None
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGINT)
    said = process.stderr.read()
    assert process.wait(60) == 130 and "interrupted; the same command goes on" in said and "Traceback" not in said
    rows = table(tmp_path / "out")
    assert rows["unit0"]["status"] == "done" and rows["unit5"]["reason"] == "not calibrated yet"
    folders = {path.name for path in (tmp_path / "out").iterdir() if path.is_dir()}
    assert folders <= {"logs", "unit0", "unit1"} and not list((tmp_path / "out").rglob("*unfinished"))


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_device_that_is_interrupted_as_it_starts_is_called_so(command, fleet, tmp_path, monkeypatch):
    monkeypatch.setattr(fleet_jobs, "wait", lambda handles: os.kill(os.getpid(), signal.SIGINT))
    ended = command("calibrate-fleet", fleet, "--output", "out", *OPTIONS)
    assert ended.code == 130 and "unit0: failed: interrupted (" in ended.err, ended.err
    assert table(tmp_path / "out")["unit0"]["reason"] == "interrupted"


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_a_device_whose_process_is_killed_costs_no_other(command, fleet, tmp_path):
    others = set(multiprocessing.active_children())  # left by tests before

    def kill_first():
        while not (children := set(multiprocessing.active_children()) - others):
            time.sleep(0.01)
        os.kill(children.pop().pid, signal.SIGKILL)

    (tmp_path / "list").write_text(f"{fleet / 'unit0.npz'}\n{fleet / 'unit1.npz'}\n")
    killer = threading.Thread(target=kill_first)
    killer.start()
    ended = command("calibrate-fleet", "list", "--output", "out", *OPTIONS)
    killer.join()
    rows = table(tmp_path / "out")
    assert ended.code == 1 and rows["unit1"]["status"] == "done"
    reason = rows["unit0"]["reason"]
    assert "its process ended with code -9" in reason
    assert ("see out/logs/unit0.txt" in reason) == (tmp_path / "out" / "logs" / "unit0.txt").exists()


def test_a_second_run_into_the_same_folder_says_who_has_it(command, fleet, tmp_path):
    owner = FolderOwner(tmp_path / "out", "calibrate-fleet")
    owner.hold()
    ended = command("calibrate-fleet", fleet, "--output", "out", *OPTIONS)
    assert ended.code == 1 and f"out is in use by calibrate-fleet, process {os.getpid()} on " in ended.err
    assert [path.name for path in (tmp_path / "out").iterdir()] == [LOCK]
    owner.release()


def test_what_is_no_fleet_is_refused_in_one_line(command, fleet, recording, tmp_path):
    def refused(place, *words):
        command("calibrate-fleet", place, "--output", "out", *OPTIONS).refused(2, *words)

    (tmp_path / "empty").mkdir()
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.png").write_bytes(b"")
    (tmp_path / "list.txt").write_text("# nothing\n")
    (tmp_path / "missing.txt").write_text("nowhere.mcap\n")
    refused("nowhere", "nowhere does not exist")
    refused("empty", "empty holds no device")
    refused("images", "images is one recording")
    refused("list.txt", "lists no device")
    refused(recording / "rig.mcap", "is no text")
    refused("missing.txt", "--target")
    command("calibrate-fleet", fleet, "--output", "list.txt").refused(2, "list.txt is not a folder")
    command("calibrate-fleet", fleet, "--output", "out", "--jobs", 0).refused(2, "--jobs must be at least 1")
    command("calibrate-fleet", fleet, "--output", "out", "--target", "no.yaml").refused(2, "no.yaml")
    assert not (tmp_path / "out").exists()


def test_devices_are_named_by_as_much_of_the_path_as_tells_them_apart(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name / "observations").mkdir(parents=True)
        (tmp_path / name / "rec.mcap").touch()
        for camera in ("front", "rear"):
            (tmp_path / name / "observations" / f"{camera}.npz").touch()
    (tmp_path / "list").write_text("a/rec.mcap\nb/rec.mcap\nb\n")
    devices = find_devices(tmp_path / "list", tmp_path / "out")
    assert [device.name for device in devices] == ["a_rec", "b_rec", "b"]
    assert [path.name for path in devices[2].sources] == ["front.npz", "rear.npz"]
    assert [device.name for device in find_devices(tmp_path, tmp_path / "b")] == ["a"]
    (tmp_path / "list").write_text("a/rec.mcap\na/rec.mcap\n")
    with pytest.raises(InputError, match="listed twice"):
        find_devices(tmp_path / "list", tmp_path / "out")


def test_devices_have_names_of_any_script_and_are_numbered_where_they_are_alike(tmp_path):
    for name in ("前", "後", "a b", "a+b", "A-b"):
        (tmp_path / f"{name}.mcap").touch()
    names = [device.name for device in find_devices(tmp_path, tmp_path / "out")]
    assert sorted(names) == ["A-b", "a_b", "a_b_2", "前", "後"]


def test_a_comment_may_follow_a_path_in_the_list(tmp_path):
    (tmp_path / "list").write_text("# fleet\ndev 1.mcap   # monday\n  # none\nunit#2.mcap\n")
    devices = find_devices(tmp_path / "list", tmp_path / "out")
    assert [device.sources for device in devices] == [(tmp_path / "dev 1.mcap",), (tmp_path / "unit#2.mcap",)]


def test_devices_of_a_kind_are_seldom_called_odd_and_others_always():
    rng = np.random.default_rng(0)
    for count, most in ((4, 0.01), (8, 0.01), (50, 0.003)):
        sigma = rng.uniform(0, 1, (2000, count))
        values = 500 + rng.normal(size=sigma.shape) * np.hypot(1, sigma)
        odd = [np.abs(robust_z(*both)) > threshold(count) for both in zip(values, sigma, strict=True)]
        assert np.mean(odd) < most
    for count in (4, 8, 50):
        values = 500 + rng.normal(size=count)
        values[1] = 600
        assert (np.abs(robust_z(values, np.ones(count))) > threshold(count)).tolist() == [
            number == 1 for number in range(count)
        ]
    assert threshold(FEWEST - 1) == np.inf and 3.5 < threshold(1000) < 3.52
    assert abs(threshold(5) - 10.5) < 0.05 and abs(threshold(20) - 4.2) < 0.05


def test_a_poorly_known_device_is_not_odd_and_cameras_are_compared_by_name():
    def row(name, camera, fx, sigma=0.1, rms=0.2, supported=True):
        return {
            "device": name, "camera": camera, "status": "done", "odd": "", "model": "ep_even", "fx": fx,
            "fx_sigma": sigma, "rms_px": rms, "supported": supported,
        }  # fmt: skip

    rows = [row(str(n), camera, base + 0.1 * n) for n in range(8) for camera, base in (("a", 500.0), ("b", 700.0))]
    mark_odd(rows)
    assert not [one for one in rows if one["odd"]]
    rows[4]["fx"] = rows[6]["fx"] = 505.0
    rows[6]["fx_sigma"] = 5.0
    rows[1]["rms_px"] = 0.5
    rows[3]["supported"] = False
    rows[5] |= {"status": "failed"}
    mark_odd(rows)
    assert {number: one["odd"].split()[0] for number, one in enumerate(rows) if one["odd"]} == {
        1: "RMS", 3: "pupil", 4: "fx",
    }  # fmt: skip
    alike = [row(str(n), "a", 500.0, sigma=0.0) for n in range(5)]
    mark_odd(alike)
    assert not [one for one in alike if one["odd"]]


def test_a_device_of_which_a_camera_failed_is_not_finished(command, tmp_path):
    for name, views in (("front", 14), ("rear", 2)):
        save_observations(tmp_path / "fleet" / "unit0" / f"{name}.npz", device(0).select_images(range(views)))
    for _ in range(2):
        ended = command("calibrate-fleet", "fleet", "--output", "out", *OPTIONS)
        assert ended.code == 1 and "0 of them finished before" in ended.err, ended.err
        with open(tmp_path / "out" / "fleet.csv", encoding="utf-8", newline="") as file:
            rows = {row["camera"]: row for row in csv.DictReader(file)}
        assert rows["front"]["status"] == "done" and rows["rear"]["status"] == "failed"
        assert "2 views have" in rows["rear"]["reason"] and len(rows) == 2
    save_observations(tmp_path / "fleet" / "unit0" / "rear.npz", device(0))
    assert command("calibrate-fleet", "fleet", "--output", "out", *OPTIONS).code == 0


def test_what_was_finished_from_another_recording_is_named(command, fleet, tmp_path):
    for place in ("one", "two"):
        (tmp_path / place).mkdir()
        shutil.copy(fleet / "unit0.npz", tmp_path / place)
    assert command("calibrate-fleet", "one", "--output", "out", *OPTIONS).code == 0
    assert "warning" not in command("calibrate-fleet", "one", "--output", "out", *OPTIONS).err
    ended = command("calibrate-fleet", "two", "--output", "out", *OPTIONS)
    assert ended.code == 0 and "unit0 was calibrated before with another recording; --overwrite" in ended.err
    ended = command("calibrate-fleet", "one", "--output", "out", *OPTIONS, "--target", BOARD_FILE)
    assert ended.code == 0 and "unit0 was calibrated before with another --target; --overwrite" in ended.err


@pytest.mark.parametrize("option", [("--terms", 0), ("--max-views", 0), ("--svp-distance", -1), ("--topic", "../x=/y")])
def test_a_fleet_refuses_once_what_no_device_can_do(command, fleet, tmp_path, option):
    command("calibrate-fleet", fleet, "--output", "out", *option).refused(2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "content", ["[]", "null", '{"cameras": 3}', '{"cameras": {"a": []}}', '{"cameras": {"a": {}}}', "{"]
)
def test_a_record_that_no_calibration_wrote_is_told_in_words_of_ones_own(tmp_path, content) -> None:
    (tmp_path / RECORD).write_text(content)
    with pytest.raises(InputError, match="is not what a calibration writes|is not valid JSON") as refusal:
        device_rows("unit0", tmp_path)
    assert RECORD in str(refusal.value) and "object" not in str(refusal.value) and "Error" not in str(refusal.value)


def test_devices_that_are_not_there_cost_no_process(command, fleet, tmp_path) -> None:
    """A list may be any text by mistake: nothing that can be seen at once is found out by a process a line."""
    absent = "".join(f"/nowhere/{number}.npz\n" for number in range(500))
    (tmp_path / "none.txt").write_text(absent)
    refused = command("calibrate-fleet", "none.txt", "--output", "out", *OPTIONS)
    refused.refused(2, "none.txt: none of what it lists is there; /nowhere/0.npz does not exist")
    assert not (tmp_path / "out").exists()
    (tmp_path / "many.txt").write_text("a\n" * 10_001)
    command("calibrate-fleet", "many.txt", "--output", "out", *OPTIONS).refused(2, "many.txt lists 10001 devices")
    (tmp_path / "one.txt").write_text(f"{absent}{fleet / 'unit0.npz'}\n")
    ended = command("calibrate-fleet", "one.txt", "--output", "out", *OPTIONS)
    assert ended.code == 1 and "501 devices, 0 of them finished before, 500 not there" in ended.err
    rows = table(tmp_path / "out")
    assert rows["unit0"]["status"] == "done" and "/nowhere/7.npz does not exist" in str(rows["7"])
    assert [path.name for path in (tmp_path / "out" / "logs").iterdir()] == ["unit0.txt"]


@pytest.mark.parametrize("source", [5, "a\0b", None])
def test_a_record_of_another_source_than_a_path_ends_no_fleet(command, fleet, tmp_path, source) -> None:
    (tmp_path / "list").write_text(f"{fleet / 'unit0.npz'}\n")
    words = ("calibrate-fleet", "list", "--output", "out", *OPTIONS)
    assert command(*words).code == 0
    record = json.loads((tmp_path / "out" / "unit0" / RECORD).read_text())
    for camera in record["cameras"].values():
        camera["inputs"]["source"] = source
    (tmp_path / "out" / "unit0" / RECORD).write_text(json.dumps(record))
    assert command(*words).code == 0
