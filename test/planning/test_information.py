"""The images that are looked at next are those that tell most about the camera."""

import numpy as np
import pytest

from fisheye_ep_calib.planning.image_information import most_informative
from fisheye_ep_calib.simulation.poses import look_pose
from fisheye_ep_calib.simulation.scenes import paper_camera
from fisheye_ep_calib.simulation.truth import observe
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.detection import Detection

CAMERA = paper_camera()
TARGET = Chessboard.create("board", 11, 7, 0.012)
FRAMES = 600


def recording(theta, distance, frames=FRAMES):
    """Detections of a board that wanders around the axis; theta (rad) and distance (m) are functions of time 0..1."""
    poses = []
    for time in np.linspace(0, 1, frames):
        turn = 2 * np.pi * time
        tilt = 0.45 + 0.2 * np.sin(9 * turn)
        poses.append(look_pose(TARGET, theta(time), 5 * turn, distance(time), tilt, 7 * turn, 0.5 * np.sin(3 * turn)))
    seen = observe(CAMERA, TARGET, np.stack(poses), noise=0.05)
    return [
        Detection(seen.point_index[seen.image_index == i], seen.pixels[seen.image_index == i]) for i in range(frames)
    ]


@pytest.fixture(scope="module")
def near_once():
    """Far away and in the middle, but for the fifth part of the time, near and towards the edge."""

    def closeness(time):
        return np.exp(-(((time - 0.5) / 0.07) ** 2))

    return recording(lambda t: 0.3 + 0.9 * closeness(t), lambda t: 0.45 - 0.35 * closeness(t))


def evenly(detections, count):
    return {i: detections[i] for i in np.linspace(0, len(detections) - 1, count).astype(int).tolist()}


def test_a_near_board_towards_the_edge_is_preferred(near_once):
    found = evenly(near_once, 40)
    chosen = most_informative(found, sorted(found), TARGET, CAMERA.image_size, 20)
    assert len(chosen) == len(set(chosen)) == 20 and not set(chosen) & set(found)
    near = [image for image in chosen if 0.38 < image / FRAMES < 0.62]
    assert len(near) >= 15  # an even spread would put 5 there


def test_only_images_between_two_that_show_the_target_are_foreseen(near_once):
    found = evenly(near_once, 40)
    seen = sorted(found)
    lost = seen[19]
    del found[lost]
    chosen = most_informative(found, seen, TARGET, CAMERA.image_size, 30)
    assert not [image for image in chosen if seen[18] < image < seen[20]]


def test_a_resting_target_has_nothing_to_add(near_once):
    resting = {i: near_once[300] for i in range(0, 400, 10)}
    assert most_informative(resting, sorted(resting), TARGET, CAMERA.image_size, 20) == []
    moved_once = resting | {i: near_once[i] for i in range(400, 600, 10)}
    chosen = most_informative(moved_once, sorted(moved_once), TARGET, CAMERA.image_size, 20)
    assert chosen and min(chosen) >= 390


def test_where_too_little_is_known_nothing_is_foreseen(near_once):
    few = evenly(near_once, 5)
    assert most_informative(few, sorted(few), TARGET, CAMERA.image_size, 20) == []
    assert most_informative({}, [0, 10, 20], TARGET, CAMERA.image_size, 20) == []
    generator = np.random.default_rng(0)
    wrong = {i: Detection(np.arange(77), generator.uniform(0, 2000, (77, 2))) for i in range(0, 200, 10)}
    assert most_informative(wrong, sorted(wrong), TARGET, CAMERA.image_size, 20) == []
    twice = {i: Detection(np.zeros(9, int), generator.uniform(0, 2000, (9, 2))) for i in range(0, 200, 10)}
    assert most_informative(twice, sorted(twice), TARGET, CAMERA.image_size, 20) == []
