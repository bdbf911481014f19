"""The command `simulate`."""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from fisheye_ep_calib.commands import simulate
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rig import RigCamera, calibrate_rig
from fisheye_ep_calib.simulation import paper_camera
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.storage.rig_file import load_rig


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    simulate.add_arguments(parser)
    return simulate.run(parser.parse_args(words))


def test_two_cameras_in_one_bag_with_their_truth(tmp_path, capsys):
    bag, truth = tmp_path / "rig.mcap", tmp_path / "truth"
    words = ["--output", str(bag), "--truth", str(truth), "--camera", "left=paper", "--camera", "right=laikin"]
    assert run(*words, "--poses", "random", "--views", "2", "--noise", "0") == 0
    assert "wrote 4 images of left, right" in capsys.readouterr().out
    with open_recording(bag) as recording:
        topics = {topic.name: topic.count for topic in recording.image_topics()}
        assert topics == {"/left/image_raw": 2, "/right/image_raw": 2}
        image = recording.frame("/left/image_raw", 0).image()
    observations = load_observations(truth / "left.npz")
    column, row = np.round(observations.pixels[observations.image_index == 0]).astype(int).T
    assert image.shape == (2048, 2048) and np.median(image[row, column]) < 60


def test_several_cameras_are_a_rig_that_sees_one_target_at_the_same_time(tmp_path, capsys):
    bag, truth = tmp_path / "rig.mcap", tmp_path / "truth"
    words = ["--output", str(bag), "--truth", str(truth), "--baseline", "0.08", "--camera", "left=paper"]
    assert run(*words, "--camera", "right=paper", "--poses", "random", "--views", "3", "--distance", "0.2", "0.3") == 0
    with open_recording(bag) as recording:
        assert recording.stamps("/left/image_raw") == recording.stamps("/right/image_raw")
        left, right = (recording.frame(f"/{name}/image_raw", 0).image() for name in ("left", "right"))
        assert (left != right).any()
    places = load_rig(truth / "rig.yaml").reference_from_camera
    np.testing.assert_allclose(places["right"][:3, 3], [0.08, 0, 0])
    cameras = []
    for name in ("left", "right"):
        observations = load_observations(truth / f"{name}.npz")
        stamps = np.arange(len(observations.image_names)) * 10**9
        cameras.append(RigCamera(name, paper_camera(), observations, stamps))
    found = calibrate_rig(cameras)
    np.testing.assert_allclose(found.reference_from_camera[1], places["right"], atol=1e-6)


@pytest.mark.parametrize(
    "words, named",
    [
        (["--camera", "no equals"], "NAME=CAMERA"),
        (["--camera", "a=paper", "--camera", "a=laikin"], "two cameras"),
        (["--poses", "random", "--views", "0"], "--views"),
        (["--distance", "0.2", "0.1"], "--distance"),
        (["--distance", "nan", "0.1"], "--distance"),
        (["--rate", "0"], "--rate"),
        (["--noise", "-1"], "--noise"),
        (["--seed", "-1"], "--seed"),
        (["--baseline", "inf"], "--baseline"),
    ],
)
def test_wrong_words_get_one_clear_line_and_write_nothing(tmp_path, words, named):
    with pytest.raises(InputError, match=named):
        run("--output", str(tmp_path / "bag.mcap"), *words)
    assert list(tmp_path.iterdir()) == []
