"""What has changed since the last calibration of a camera is told: in the text, in the record and on the page."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA

from fisheye_ep_calib import calibrate_recording, save_camera
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation import observe, paper_poses
from fisheye_ep_calib.storage.observation_file import save_observations

WORDS = ("--model", "ep_even", "--json")


@pytest.fixture
def seen(tmp_path):
    """Writes views of a camera as NAME.npz, other ones for another seed."""

    def write(camera: FisheyeCamera, seed: int, name: str = "front"):
        path = tmp_path / f"{seed}" / f"{name}.npz"
        path.parent.mkdir(exist_ok=True)
        save_observations(path, observe(camera, BOARD, paper_poses(BOARD, seed), 0.1, seed))
        return path

    return write


def test_the_same_camera_is_unchanged_and_one_that_was_refocused_is_not(command, seen, tmp_path) -> None:
    first = command("calibrate", seen(CAMERA, 1), *WORDS, "--no-report")
    assert first.code == 0 and first.json["cameras"]["front"]["previous"] is None, first.err
    again = command("calibrate", seen(CAMERA, 2), *WORDS)
    said = again.json["cameras"]["front"]["previous"]
    assert said["file"] == "calibration/front.yaml" and said["changed"] is False
    assert said["rim_sigma"] < 3 and said["rim_px"] < 0.3 and f"· {said['text']}" in again.err
    assert said["text"].startswith("unchanged against calibration/front.yaml: ")
    page = (tmp_path / "calibration_2" / "report.html").read_text("utf-8")
    assert said["text"] in page
    focused = replace(CAMERA, fx=1.004 * CAMERA.fx, fy=1.004 * CAMERA.fy)
    later = command("calibrate", seen(focused, 3), *WORDS, "--no-report")
    told = later.json["cameras"]["front"]["previous"]
    assert told["file"] == "calibration_2/front.yaml" and told["changed"] is True
    assert told["rim_px"] > 1 and told["rim_sigma"] > 5 and "was the focus or the lens touched?" in told["text"]
    assert f"! {told['text']}" in later.err


def test_what_is_given_or_lies_in_the_folder(command, seen, tmp_path) -> None:
    known = tmp_path / "known.yaml"
    save_camera(known, CAMERA)
    first = command("calibrate", seen(CAMERA, 1), *WORDS, "--no-report", "--output", "out", "--previous", known)
    said = first.json["cameras"]["front"]["previous"]
    assert said["file"] == str(known) and said["changed"] is False, "a camera alone is one without σ"
    there = command("calibrate", seen(CAMERA, 2), *WORDS, "--no-report", "--output", "out", "--overwrite")
    assert there.json["cameras"]["front"]["previous"]["file"] == "out/front.yaml"
    folder = command("calibrate", seen(CAMERA, 3), *WORDS, "--no-report", "--output", "new", "--previous", "out")
    assert folder.json["cameras"]["front"]["previous"]["file"] == "out/front.yaml"
    elsewhere = command("calibrate", seen(CAMERA, 1), *WORDS, "--no-report", "--output", "other")
    assert elsewhere.json["cameras"]["front"]["previous"] is None
    command("calibrate", seen(CAMERA, 1), *WORDS, "--previous", tmp_path / "none.yaml").refused(2, "none.yaml")


def test_in_python_and_a_camera_of_another_size(seen) -> None:
    first = calibrate_recording(seen(CAMERA, 1), model="ep_even")["front"]
    assert first.change is None
    later = calibrate_recording(seen(CAMERA, 2), model="ep_even", previous={"front": first, "rear": CAMERA})["front"]
    assert later.change is not None and not later.change.changed and later.change.rim_px > 0
    assert first.since(later).change.rim_px == pytest.approx(later.change.rim_px, rel=0.3)
    small = replace(CAMERA, image_size=(640, 480))
    other = later.since(small).change
    assert other is not None and "640×480" in other.sentence and other.to_dict()["changed"] is None
    assert np.isnan(other.rim_px)
