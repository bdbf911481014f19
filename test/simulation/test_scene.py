"""Poses, ideal observations and bags."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.simulation import (
    Imaging,
    SimulatedCamera,
    StampedImage,
    feature_pixels,
    look_pose,
    observe,
    paper_camera,
    paper_poses,
    paper_target,
    random_poses,
    render_views,
    simulate_rig,
    views_at,
    write_bag,
)
from fisheye_ep_calib.storage.recording import open_recording
from fisheye_ep_calib.target.boards.chessboard import Chessboard


def test_look_pose_puts_the_middle_where_it_is_told():
    target = paper_target()
    pose = look_pose(target, theta=1.0, azimuth=0.5, distance=0.2, tilt=0.4, tilt_azimuth=1.0, roll=2.0)
    assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3)) and np.linalg.det(pose[:3, :3]) > 0
    middle = pose[:3, :3] @ target.object_points.mean(axis=0) + pose[:3, 3]
    expected = 0.2 * np.array([np.sin(1.0) * np.cos(0.5), np.sin(1.0) * np.sin(0.5), np.cos(1.0)])
    assert np.allclose(middle, expected)
    assert pose[:3, 2] @ middle / 0.2 == pytest.approx(np.cos(0.4))


def test_the_papers_poses_reach_the_edge_with_depth():
    camera, target = paper_camera(), paper_target()
    poses = paper_poses(target)
    assert poses.shape == (25, 4, 4)
    middles = poses[:, :3, :3] @ target.object_points.mean(axis=0) + poses[:, :3, 3]
    distance = np.linalg.norm(middles, axis=1)
    assert distance.min() >= 0.0999 and distance.max() <= 0.1501
    observations = observe(camera, target, poses)
    assert observations.view_count == 25
    assert len(observations.pixels) > 0.8 * 25 * 77
    radius = np.hypot(*(observations.pixels - [camera.cx, camera.cy]).T)
    assert np.percentile(radius, 97) > 592 * np.radians(85)
    assert np.bincount(observations.image_index).min() >= 25


def test_observations_are_the_truth_plus_seeded_noise():
    camera, target = paper_camera(), Chessboard.create("board", 9, 6, 0.01)
    poses = random_poses(target, 12, seed=4)
    clean, noisy = observe(camera, target, poses), observe(camera, target, poses, noise=0.2, seed=1)
    again = observe(camera, target, poses, noise=0.2, seed=1)
    assert np.array_equal(noisy.pixels, again.pixels)
    truth, _ = feature_pixels(camera, target, poses)
    assert np.allclose(clean.pixels, truth[clean.image_index, clean.point_index])
    error = noisy.pixels - truth[noisy.image_index, noisy.point_index]
    assert error.std() == pytest.approx(0.2, rel=0.1)


def test_siblings_of_the_papers_camera_differ():
    cameras = [paper_camera(index) for index in range(4)]
    assert cameras[0].fx == 591.7301 and len({camera.fx for camera in cameras}) == 4


def test_a_bag_holds_what_was_written(tmp_path):
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (4, 30, 40), dtype=np.uint8)
    stamped = [
        StampedImage(f"/{name}/image_raw", 1_700_000_000_123_456_789 + 10 * i, f"{name}_optical", images[i])
        for i, name in enumerate(["front", "rear", "front"])
    ]
    last = 1_700_000_001_000_000_000
    stamped.append(StampedImage("/left/image_raw/compressed", last, "left", images[3], "png"))
    path = tmp_path / "new" / "images.mcap"
    assert write_bag(path, stamped) == 4
    assert list(path.parent.iterdir()) == [path]
    store = get_typestore(Stores.ROS2_JAZZY)
    with open(path, "rb") as file:
        read = [
            (channel.topic, schema.name, message.log_time, store.deserialize_cdr(message.data, schema.name))
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages()
        ]
    assert [topic for topic, *_ in read] == [item.topic for item in stamped]
    for (_, kind, stamp, message), item in zip(read, stamped, strict=True):
        assert stamp == item.stamp_ns
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == item.stamp_ns
        assert message.header.frame_id == item.frame_id
        if kind.endswith("/Image"):
            assert np.array_equal(message.data.reshape(30, 40), item.image)
            assert (message.encoding, message.step) == ("mono8", 40)


def test_a_bag_is_read_back_as_a_recording(tmp_path):
    image = np.arange(6, dtype=np.uint8).reshape(2, 3)
    write_bag(tmp_path / "a.mcap", [StampedImage("/c/image_raw", 5, "c", image)])
    with open_recording(tmp_path / "a.mcap") as recording:
        assert [topic.name for topic in recording.image_topics()] == ["/c/image_raw"]
        frame = recording.frame("/c/image_raw", 0)
        assert (frame.stamp_ns, frame.taken_ns) == (5, 5) and np.array_equal(frame.image(), image)


def test_a_bag_needs_its_suffix_and_leaves_nothing_when_it_fails(tmp_path):
    with pytest.raises(InputError, match=r"\.mcap"):
        write_bag(tmp_path / "bag", [])

    def broken():
        yield StampedImage("/c/image_raw", 5, "c", np.zeros((2, 3), np.uint8))
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError):
        write_bag(tmp_path / "a.mcap", broken())
    assert list(tmp_path.iterdir()) == []


def test_views_are_the_same_from_one_process_and_from_two():
    camera, target = FisheyeCamera((160, 120), 40, 40, 80, 60, theta_max=1.5), paper_target()
    poses = random_poses(target, 7, seed=2)
    views = views_at(camera, target, poses, Imaging(noise=3, seed=5))
    alone, together = (list(render_views(views, processes=n)) for n in (1, 2))
    assert len(alone) == 7 and not np.array_equal(alone[0], alone[1])
    assert np.array_equal(alone, together)


def test_a_rig_s_cameras_are_in_step_and_in_order():
    target = paper_target()
    small = FisheyeCamera((64, 48), 16, 16, 32, 24, theta_max=1.5)
    poses = random_poses(target, 3, seed=2)
    rig = [SimulatedCamera(name, views_at(small, target, poses[:count])) for name, count in (("a", 3), ("b", 2))]
    images = list(simulate_rig(rig, rate=4.0, start_ns=10**18, processes=1))
    assert [(image.topic, image.stamp_ns - 10**18) for image in images] == [
        ("/a/image_raw", 0),
        ("/b/image_raw", 0),
        ("/a/image_raw", 250_000_000),
        ("/b/image_raw", 250_000_000),
        ("/a/image_raw", 500_000_000),
    ]
    assert images[1].frame_id == "b_optical_frame"
    assert np.array_equal(images[0].image, images[1].image)
