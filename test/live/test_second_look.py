"""Once a camera is known, a live frame is looked at again where it says that the target is."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.live.frame import RawFrame, detect_in_frame, second_look
from fisheye_ep_calib.simulation import Imaging, look_pose, paper_camera, paper_target, render
from fisheye_ep_calib.simulation.truth import feature_pixels
from fisheye_ep_calib.storage.grey_levels import to_eight_bits, to_levels
from fisheye_ep_calib.target import Detection, Target, load_target

HALVED = ("fx", "fy", "skew", "cx", "cy")


def small_camera(theta_max_deg: float = 97.5) -> FisheyeCamera:
    camera = paper_camera()
    half = {name: getattr(camera, name) / 2 for name in HALVED}
    return replace(camera, image_size=(1024, 1024), theta_max=np.radians(theta_max_deg), **half)


def seen(target: Target, theta_deg: float, distances: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    """An image of the target, and its pose; its distance in diagonals of the board."""
    diagonal = float(np.hypot(*np.ptp(target.object_points[:, :2], axis=0)))
    pose = look_pose(target, np.radians(theta_deg), 0.7, distances * diagonal, np.radians(15), 1.0, 0.3)
    return render(small_camera(), target, pose, Imaging(blur=0.6, noise=1.0)), pose


def half_of(found: Detection) -> Detection:
    return Detection(found.point_index[::2], found.pixels[::2])


@pytest.mark.parametrize("name", ["circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5"])
def test_what_the_first_look_missed_is_found_where_it_is(name: str) -> None:
    target = load_target(name)
    image, pose = seen(target, 45)
    first = target.detector().detect(image)
    again = second_look(target.detector(), image, half_of(first), target, small_camera())
    assert len(again) >= 0.95 * len(first) > 0.8 * len(target.object_points)
    truth, valid = feature_pixels(small_camera(), target, pose)
    assert valid[again.point_index].all()
    assert np.median(np.hypot(*(again.pixels - truth[again.point_index]).T)) < 0.1


def test_a_camera_that_knows_the_middle_alone_loses_nothing_at_the_rim() -> None:
    """The first calibration is of few views; where the target goes next there is no evidence yet."""
    target = paper_target()
    image, _ = seen(target, 70)
    first = target.detector().detect(image)
    again = second_look(target.detector(), image, first, target, small_camera(theta_max_deg=40))
    assert len(first) > 70 and len(again) >= len(first) - 1


def test_a_camera_that_is_another_one_does_no_harm() -> None:
    target = paper_target()
    image, _ = seen(target, 45)
    first = target.detector().detect(image)
    other = replace(small_camera(), fx=900.0, fy=900.0, cx=100.0, cy=900.0)
    again = second_look(target.detector(), image, first, target, other)
    assert again.point_index.tolist() == first.point_index.tolist()
    assert second_look(target.detector(), image, Detection(reason="none"), target, small_camera()).reason == "none"


def test_only_frames_of_the_cameras_size_and_with_a_camera_are_looked_at_twice(monkeypatch) -> None:
    target = paper_target()
    kind = type(target.detector())
    looked = []
    guided = kind.detect_guided
    monkeypatch.setattr(kind, "detect_guided", lambda *arguments: looked.append(1) or guided(*arguments))
    image, _ = seen(target, 45)
    frame = RawFrame("one", cv2.imencode(".png", image)[1].tobytes(), compressed=True)
    full = replace(small_camera(), image_size=(1025, 1024))
    for camera, looks in ((None, 0), (full, 0), (small_camera(), 1)):
        sighting = detect_in_frame(frame, target, camera)
        assert len(sighting.detection) > 70 and sighting.image_size == (1024, 1024) and len(looked) == looks


@pytest.mark.parametrize("name", ["circle_grid_11x7", "chessboard_9x6", "charuco_10x7", "aprilgrid_6x5"])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_deep_frame_is_measured_in_its_own_depth(name: str, compressed: bool) -> None:
    """Twelve bits beside a lamp: the second look has them all."""
    target = load_target(name)
    _, pose = seen(target, 45)
    bright = render(small_camera(), target, pose, Imaging(blur=1.0, noise=0.0))
    deep = (900 + 12 * cv2.GaussianBlur(bright.astype(np.float32), (0, 0), 0.5)).astype(np.uint16)
    deep[5:60, 5:60] = 65535
    if compressed:
        frame = RawFrame("one", cv2.imencode(".png", deep)[1].tobytes(), compressed=True)
    else:
        frame = RawFrame("one", deep.tobytes(), False, *deep.shape, "mono16", 0, 2 * deep.shape[1])
    found = detect_in_frame(frame, target, small_camera()).detection
    levels = to_levels(deep)
    again = second_look(
        target.detector(), levels, target.detector().detect(to_eight_bits(deep)), target, small_camera()
    )
    rounded = second_look(
        target.detector(), to_eight_bits(deep), target.detector().detect(to_eight_bits(deep)), target, small_camera()
    )
    assert levels.dtype == np.float32 and len(found) > 0.9 * len(target.object_points)
    assert found.pixels.tobytes() == again.pixels.tobytes() != rounded.pixels.tobytes()
    truth, _ = feature_pixels(small_camera(), target, pose)
    assert np.median(np.hypot(*(found.pixels - truth[found.point_index]).T)) < 0.1
