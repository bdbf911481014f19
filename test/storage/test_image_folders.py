"""Which camera took an image, and when, by folders and names: nothing of one camera is split, no two become one."""

from __future__ import annotations

import pickle

import cv2
import numpy as np
import pytest
from bag_writers import images

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.recording import choose_topics, open_recording
from fisheye_ep_calib.storage.sources.image_names import cameras_in_names, times_in_names

PICTURE = images(1)[0]


def names(*patterns: str, first: int = 1, count: int = 20) -> list[str]:
    return [pattern % number for pattern in patterns for number in range(first, first + count)]


def cameras(listed: list[str], size_of=None) -> dict[str, int]:
    found = cameras_in_names(listed, size_of)
    return {} if found is None else {camera: len(places) for camera, places in found.numbers.items()}


@pytest.mark.parametrize(
    "patterns, expected",
    [
        (("left%02d.jpg", "right%02d.jpg"), ("left", "right")),
        (("Left%d.bmp", "Right%d.bmp"), ("left", "right")),
        (("img_l_%03d.png", "img_r_%03d.png"), ("left", "right")),
        (("imgL%d.png", "imgR%d.png"), ("left", "right")),
        (("%dL.png", "%dR.png"), ("left", "right")),
        (("%04d_left.png", "%04d_right.png"), ("left", "right")),
        (("imageleft%d.png", "imageright%d.png"), ("left", "right")),
        (("cam0_%04d.png", "cam1_%04d.png"), ("cam0", "cam1")),
        (("frame%04d_cam_1.png", "frame%04d_cam_2.png", "frame%04d_cam_3.png"), ("cam1", "cam2", "cam3")),
        (("board_cameraA_%d.tif", "board_cameraB_%d.tif"), ("cameraa", "camerab")),
        (("front_%d.png", "rear_%d.png", "left_%d.png", "right_%d.png"), ("front", "left", "rear", "right")),
        (("a_14037090804378%05d.png", "b_14037090804378%05d.png"), ()),
    ],
)
def test_names_that_name_cameras(patterns, expected):
    expected = expected or ("a", "b")
    assert cameras(names(*patterns)) == dict.fromkeys(expected, 20)


@pytest.mark.parametrize(
    "listed",
    [
        names("frame%04d.png"),
        names("cam_%04d.png"),
        names("left%02d.png"),
        names("boardA_%d.png", "boardB_%d.png"),
        names("session1_%d.png", "session2_%d.png"),
        names("left%02d.png", "right%02d.png", "top%02d.png", "bottom%02d.png"),
        names("left%02d.png", "center%02d.png", "right%02d.png"),
        names("left%02d.png") + names("right%02d.png", first=21),
        names("left%02d.png") + names("right%02d.png", count=5),
        names("color%d.png", "floor%d.png"),
        names("bright%d.png", "dark%d.png"),
        names("WIN_20240101_1200%02d_Pro.jpg"),
        [f"c{column}_r{row}.png" for column in range(4) for row in range(5)],
        ["a.png", "b.png"],
        ["left.png", "right.png"],
        [],
    ],
)
def test_one_camera_stays_one(listed):
    assert cameras(listed) == {}


def test_a_few_strays_are_no_camera():
    found = cameras_in_names([*names("left%d.png", "right%d.png"), "overview.png"])
    assert found is not None and found.strays == (40,) and len(found.numbers) == 2


def test_sizes_of_their_own_tell_cameras_apart():
    listed = names("wide_%d.png", "narrow_%d.png")
    assert cameras(listed, lambda place: (640, 480)) == {}
    assert cameras(listed, lambda place: (640, 480) if place < 20 else (800, 600)) == {"narrow": 20, "wide": 20}
    assert cameras(listed, lambda place: None) == {}


@pytest.mark.parametrize(
    "name, time",
    [
        ("1403709080437837056.png", 1403709080437837056),
        ("frame_1403709080437837.jpg", 1403709080437837000),
        ("1403709080437.tif", 1403709080437000000),
        ("left_1403709080.437837.png", 1403709080437837000),
        ("1403709080.437", 1403709080437000000),
        ("12.000000001", 12000000001),
        ("img0001.png", None),
        ("9999999999999999999.png", None),
        ("20240131120000.png", None),
        ("3.14.png", None),
    ],
)
def test_times_in_names(name, time):
    assert times_in_names([name]) == (None if time is None else [time])


def test_all_names_are_times_or_none():
    assert times_in_names(["1403709080437837056.png", "notes1.png"]) is None
    assert times_in_names(["a_1403709080437837056.png", "b_1403709080437837056.png"]) is None


def write(folder, listed, picture=PICTURE):
    folder.mkdir(parents=True)
    content = cv2.imencode(".png", picture)[1].tobytes()
    for name in listed:
        (folder / name).write_bytes(content)


def counts(*paths) -> dict[str, int]:
    with open_recording(paths) as recording:
        assert choose_topics(recording, several=True) == tuple(topic.name for topic in recording.image_topics())
        return {topic.name: topic.count for topic in recording.image_topics()}


TIMES = [f"{1403709080437837056 + 10**8 * number}.png" for number in range(3)]
LAYOUTS = {
    "EuRoC": (("mav0/cam0/data", "mav0/cam1/data"), ("cam0", "cam1")),
    "images of cameras": (("cam0/images", "cam1/images"), ("cam0", "cam1")),
    "left and right": (("left", "right"), ("left", "right")),
    "deep": (("raw/left/img/png", "raw/right/img/png"), ("left", "right")),
    "two days": (("monday/cam0", "monday/cam1", "tuesday/cam0", "tuesday/cam1"), ("cam0", "cam1")),
    "KITTI": (("image_00/data", "image_01/data"), ("image_00", "image_01")),
    "own names": (("alpha/data", "beta/data"), ("alpha", "beta")),
    "the same names": (("a/x/one", "b/x/one"), ("a_x_one", "b_x_one")),
    "one camera": (("dataset/images",), ("images",)),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_folders_within_folders(tmp_path, layout):
    folders, expected = LAYOUTS[layout]
    for folder in folders:
        write(tmp_path / "recording" / folder, TIMES)
    (tmp_path / "recording" / "imu0").mkdir()
    found = counts(tmp_path / "recording")
    assert tuple(found) == expected and sum(found.values()) == 3 * len(folders)


def test_folders_named_one_by_one_or_by_a_pattern(tmp_path):
    for camera in ("cam0", "cam1"):
        write(tmp_path / camera / "data", TIMES)
    assert counts(tmp_path / "cam0" / "data", tmp_path / "cam1" / "data") == {"cam0": 3, "cam1": 3}
    assert counts(f"{tmp_path}/*/data/*.png") == {"cam0": 3, "cam1": 3}
    assert counts(tmp_path / "cam1" / "data") == {"cam1": 3}


def test_two_cameras_in_one_folder_are_told_and_one_can_be_given_alone(tmp_path):
    write(tmp_path / "both", names("left%02d.png", "right%02d.png", count=4))
    with open_recording(tmp_path / "both", strict=True) as recording:
        assert [topic.name for topic in recording.image_topics()] == ["left", "right"]
        assert "2 cameras: left (4 images), right (4 images)" in recording.notes[0]
        assert recording.frame("right", 2).name == "right03.png"
        assert not recording.timed("left")
    assert counts(f"{tmp_path}/both/left*.png") == {"both": 4}


def test_images_named_by_time_are_in_its_order(tmp_path):
    write(tmp_path / "front", [f"frame{number}_{1403709080 - number}.250.png" for number in range(4)])
    with open_recording(tmp_path / "front") as recording:
        recording = pickle.loads(pickle.dumps(recording))
        assert recording.timed("front")
        assert recording.stamps("front") == [(1403709077 + number) * 10**9 + 250_000_000 for number in range(4)]
        assert [frame.name[:6] for frame in recording.frames()] == ["frame3", "frame2", "frame1", "frame0"]
        np.testing.assert_array_equal(recording.frame("front", 0).image(), PICTURE)


def test_folders_without_end_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("fisheye_ep_calib.storage.sources.image_folders._MOST_FOLDERS", 20)
    for number in range(30):
        (tmp_path / "many" / str(number)).mkdir(parents=True)
    with pytest.raises(InputError, match="more than 20 folders"):
        open_recording(tmp_path / "many")
    (tmp_path / "loop").mkdir()
    (tmp_path / "loop" / "again").symlink_to(tmp_path / "loop")
    with pytest.raises(InputError, match="neither a bag"):
        open_recording(tmp_path / "loop")
