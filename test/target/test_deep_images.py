"""Deep images are measured in the second look by levels that are not rounded, whatever the target."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from registered_targets import CAMERA, IMAGING, named_target

from fisheye_ep_calib.collection.look import Job, look
from fisheye_ep_calib.simulation import look_pose, render
from fisheye_ep_calib.simulation.truth import feature_pixels
from fisheye_ep_calib.storage.grey_levels import to_eight_bits, to_levels
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target.registry import TARGETS


def scene(kind: str):
    target, _ = named_target(kind)
    width = np.ptp(target.object_points[:, 0])
    pose = look_pose(target, theta=0.4, azimuth=0.6, distance=0.9 * width, tilt=0.3, tilt_azimuth=1.0, roll=0.2)
    return target, pose, render(CAMERA, target, pose, IMAGING)


@pytest.mark.parametrize("kind", TARGETS)
@pytest.mark.parametrize("contrast", [1.0, 0.4])
def test_the_second_look_takes_levels(kind, contrast):
    target, pose, image = scene(kind)
    image = np.rint(contrast * image).astype(np.uint8)
    detector = target.detector()
    whole, levels = (detector.detect_guided(one, CAMERA, pose) for one in (image, image.astype(np.float32)))
    assert len(whole) > 10 and np.array_equal(whole.point_index, levels.point_index)
    np.testing.assert_allclose(whole.pixels, levels.pixels, atol=0.02)


@pytest.mark.parametrize("kind", TARGETS)
def test_a_deep_image_with_a_lamp_and_hot_pixels_through_a_recording(tmp_path, kind):
    target, pose, image = scene(kind)
    deep = 900 + 12 * image.astype(np.uint16)
    deep[5:60, 5:60] = 65535
    deep[:2] = 65535
    deep[np.random.default_rng(0).integers(0, 700, 20), 700] = 65535
    cv2.imwrite(str(tmp_path / "a.png"), deep)
    truth = feature_pixels(CAMERA, target, pose[None])[0][0]
    with open_recording(tmp_path) as recording:
        for job in (Job(tmp_path.name, 0), Job(tmp_path.name, 0, CAMERA, pose)):
            found = look(recording, target.detector(), job)
            assert found.error == "" and len(found.detection) > 10, found.reason
            off = found.detection.pixels - truth[found.detection.point_index]
            assert np.sqrt(np.mean(off**2)) < 0.15


def test_levels_are_those_of_eight_bits_without_rounding():
    deep = np.random.default_rng(0).integers(1000, 3000, (64, 80)).astype(np.uint16)
    levels = to_levels(deep)
    assert levels.dtype == np.float32
    np.testing.assert_allclose(np.rint(np.clip(levels, 0, 255)), to_eight_bits(deep), atol=1)
    assert len(np.unique(levels)) > 1000
    whole = (deep // 16).astype(np.uint8)
    assert to_levels(whole) is whole
