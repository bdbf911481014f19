"""A recording that does not show the target is refused before all of it is looked at, and says how to look at more."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from bag_writers import messages, write_folder, write_mcap
from numbered_target import ABSENT, TARGET, picture

from fisheye_ep_calib.collection import Collector, DetectionRun, FrameChoice
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.planning import nothing_found
from fisheye_ep_calib.simulation.clutter import clutter_image
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target import Target, load_target

KINDS = ["chessboard_9x6", "charuco_10x7", "aprilgrid_6x5", "circle_grid_11x7_holed"]
TOPIC = "/front/image_raw"
USUAL = FrameChoice()


def collect(path: Path, target: Target, choice: FrameChoice = USUAL, workers: int = 0) -> DetectionRun:
    with open_recording(path) as recording, Collector(recording, target, workers=workers) as collector:
        (topic,) = recording.topics
        return collector.collect([topic], choice)[topic]


def write(path: Path, suffix: str, images: list[np.ndarray]) -> Path:
    return write_mcap(path / "a.mcap", messages(images, TOPIC)) if suffix else write_folder(path / "front", images)


@pytest.fixture
def dear_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine images of 240 × 180 are all that a refusal may cost."""
    monkeypatch.setattr(nothing_found, "MOST_PIXELS", 9.5 * 240 * 180)


@pytest.mark.usefixtures("dear_pixels")
@pytest.mark.parametrize("suffix", ["", ".mcap"], ids=["folder", "bag"])
@pytest.mark.parametrize("kind", KINDS)
def test_some_of_the_images_are_enough_to_refuse_it(tmp_path: Path, kind: str, suffix: str) -> None:
    path = write(tmp_path, suffix, [clutter_image(seed, (240, 180)) for seed in range(30)])
    run = collect(path, load_target(kind))
    looked = [frame.index for frame in run.frames]
    assert len(looked) == 9 and run.available == 30 and np.diff(looked).max() <= 6
    with pytest.raises(CalibrationError, match=r"none of 9 images looked at, of 30 \(\d × ?: .*`max_views`, `every`"):
        run.observations(load_target(kind).object_points)
    assert [frame.index for frame in collect(path, load_target(kind), workers=2).frames] == looked


@pytest.mark.usefixtures("dear_pixels")
@pytest.mark.parametrize("choice", [FrameChoice(every=1), FrameChoice(max_views=30)])
def test_all_that_were_asked_for_are_looked_at(tmp_path: Path, choice: FrameChoice) -> None:
    path = write_folder(tmp_path / "front", [picture(ABSENT, shape=(180, 240))] * 30)
    assert len(collect(path, TARGET, choice).frames) == 30


@pytest.mark.usefixtures("dear_pixels")
def test_one_view_and_all_are_looked_at(tmp_path: Path) -> None:
    images = [picture(ABSENT, shape=(180, 240))] * 30
    path = write_folder(tmp_path / "front", images)
    seen = collect(path, TARGET).frames[-1].index
    images[seen] = picture(shape=(180, 240))
    run = collect(write_folder(tmp_path / "again", images), TARGET)
    assert len(run.frames) == 30 and len(run.views) == 1


@pytest.mark.usefixtures("dear_pixels")
@pytest.mark.parametrize(("most", "looked"), [(None, 4), (30, 15)])
def test_a_rig_whose_cameras_see_nothing(tmp_path: Path, most: int | None, looked: int) -> None:
    images = [picture(ABSENT, shape=(180, 240))] * 60
    both = sorted(messages(images, "/a") + messages(images, "/b"), key=lambda message: message[1])
    moments = np.stack([np.arange(60)] * 2, axis=1)
    with open_recording(write_mcap(tmp_path / "a.mcap", both)) as recording:
        with Collector(recording, TARGET) as collector:
            runs = collector.collect_moments(["/a", "/b"], moments, FrameChoice(most))
    assert [len(run.frames) for run in runs.values()] == [looked, looked]


@pytest.mark.usefixtures("dear_pixels")
@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize("shown", [False, True])
def test_several_cameras_share_what_a_refusal_may_cost(tmp_path: Path, shown: bool, workers: int) -> None:
    """Four of them: three images each are more than nine. Where one sees the target, each of the others has nine."""
    empty = [picture(ABSENT, shape=(180, 240))] * 30
    images = {f"/{name}": empty for name in "abc"} | {"/d": [picture(shape=(180, 240))] * 30 if shown else empty}
    every = [message for topic, pictures in images.items() for message in messages(pictures, topic)]
    path = write_mcap(tmp_path / "a.mcap", sorted(every, key=lambda message: message[1]))
    with open_recording(path) as recording, Collector(recording, TARGET, workers=workers) as collector:
        runs = collector.collect(list(images), USUAL)
    assert [len(run.frames) for run in runs.values()] == ([9, 9, 9, 30] if shown else [3, 3, 3, 3])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_refusal_of_large_images_takes_less_than_20_s_of_processor_time(tmp_path: Path, kind: str) -> None:
    path = write_folder(tmp_path / "front", [clutter_image(seed, (2048, 2048)) for seed in range(4)] * 10, ".jpg")
    began = time.process_time()
    run = collect(path, load_target(kind))
    assert len(run.frames) == 14 and not run.views
    assert time.process_time() - began < 20.0
