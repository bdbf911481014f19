"""Rendered images against truths computed another way."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation.patterns import pattern
from fisheye_ep_calib.simulation.rendering import Imaging, render, visible_mask
from fisheye_ep_calib.simulation.scenes import paper_camera, paper_target
from fisheye_ep_calib.simulation.truth import feature_pixels
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid


def pose(rotation_vector, middle, target) -> np.ndarray:
    """camera_from_target that turns the target about the middle of its points, and puts that at middle."""
    transform = np.eye(4)
    transform[:3, :3] = cv2.Rodrigues(np.array(rotation_vector, dtype=float))[0]
    transform[:3, 3] = middle - transform[:3, :3] @ target.object_points.mean(axis=0)
    return transform


POSES = {
    "frontal": ([0.0, 0.0, 0.3], [0.01, 0.0, 0.12]),
    "tilted": ([0.7, 0.3, 0.0], [0.0, 0.02, 0.11]),
    "edge": ([0.0, 1.35, 0.0], [0.13, 0.01, 0.03]),
    "far": ([0.3, -0.4, 0.1], [-0.1, 0.1, 0.35]),
}


def rendered_centroids(image, expected, imaging, reach=60):
    """Grey-weighted centre of gravity of the dark blob around each expected pixel."""
    share = (imaging.white - image.astype(float)) / (imaging.white - imaging.black)
    found = []
    for u, v in np.round(expected).astype(int):
        left, top = max(u - reach, 0), max(v - reach, 0)
        area = share[top : v + reach + 1, left : u + reach + 1]
        labels = cv2.connectedComponents((area > 0.004).astype(np.uint8))[1]
        own = np.where(labels == labels[v - top, u - left], area, 0)
        y, x = np.indices(own.shape)
        found.append([(own * x).sum() / own.sum() + left, (own * y).sum() / own.sum() + top])
    return np.array(found)


@pytest.mark.parametrize("name", POSES)
def test_disc_centre_of_gravity_is_right_to_three_thousandths_of_a_pixel(name):
    camera, target = paper_camera(), paper_target()
    transform = pose(*POSES[name], target)
    truth, valid = feature_pixels(camera, target, transform)
    assert valid.all()
    image = render(camera, target, transform)
    error = rendered_centroids(image, truth, Imaging()) - truth
    assert np.abs(error).max() < 0.006
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.003


def test_a_disc_centroid_is_not_the_projection_of_its_centre():
    camera, target = paper_camera(), paper_target()
    transform = pose(*POSES["tilted"], target)
    centroid, _ = feature_pixels(camera, target, transform)
    center, _ = camera.project(target.object_points @ transform[:3, :3].T + transform[:3, 3])
    assert 0.1 < np.linalg.norm(centroid - center, axis=1).max() < 2


def test_the_hole_of_a_disc_and_its_neighbours_are_drawn_where_they_are():
    camera = paper_camera()
    target = CircleGrid.create("holed", 5, 4, 0.02, 0.007, holed=(0, 7, 13), hole_radius=0.003)
    transform = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.15], target)
    image = render(camera, target, transform)
    middle, _ = feature_pixels(camera, target, transform)
    column, row = np.round(middle).astype(int).T
    expected = np.full(20, 25)
    expected[[0, 7, 13]] = 225
    assert np.array_equal(image[row, column], expected)


def test_edge_pixels_equal_a_dense_integral_along_the_camera_s_own_rays():
    camera, target = paper_camera(), Chessboard.create("board", 8, 6, 0.015)
    transform = pose([0.2, 0.9, 0.1], [0.06, 0.0, 0.09], target)
    image = render(camera, target, transform)
    truth, _ = feature_pixels(camera, target, transform)
    corners = np.round(truth).astype(int)
    assert len(corners) == 48
    step = (np.arange(40) + 0.5) / 40 - 0.5
    samples = corners[:, None, None] + np.stack(np.meshgrid(step, step), axis=-1)
    origins, directions, _ = camera.unproject(samples)
    origins = (origins - transform[:3, 3]) @ transform[:3, :3]
    directions = directions @ transform[:3, :3]
    points = origins - directions * (origins[..., 2] / directions[..., 2])[..., None]
    white = pattern(target).white(points[..., 0], points[..., 1]).mean(axis=(1, 2))
    rendered = (image[corners[:, 1], corners[:, 0]] - 25.0) / 200
    assert np.abs(rendered - white).max() < 0.03
    assert np.abs(rendered - white).mean() < 0.008


def test_reflection_of_a_square_pattern_agrees_with_its_definition():
    target = Chessboard.create("board", 4, 3, 0.01)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-0.01, 0.04, 2000), rng.uniform(-0.01, 0.03, 2000)
    black = (np.floor(x / 0.01) + np.floor(y / 0.01)) % 2 == 0
    assert np.array_equal(pattern(target).white(x, y), ~black)


def test_the_back_of_a_board_is_not_seen():
    camera, target = paper_camera(), paper_target()
    transform = pose([0.0, np.pi, 0.0], [0.0, 0.0, 0.12], target)
    assert render(camera, target, transform).max() == round(Imaging().background)


def test_without_a_pupil_a_pixel_sees_what_its_ray_meets():
    camera = FisheyeCamera((640, 480), 150, 150, 320, 240, theta_max=1.6)
    target = paper_target()
    transform = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.1], target)
    image = render(camera, target, transform)
    outside = np.hypot(*(np.indices(image.shape) - np.array([240, 320])[:, None, None])) > 150 * 1.6 + 1
    assert (image[outside] == 0).all()
    assert image[240, 320] == 25 and image[10, 320] == round(Imaging().background)


def test_noise_and_texture_repeat_with_their_seed():
    camera, target = FisheyeCamera((320, 240), 80, 80, 160, 120, theta_max=1.5), paper_target()
    transform = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.12], target)
    first, again, other = (
        render(camera, target, transform, Imaging(noise=5, texture=30, seed=seed)) for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    clean, noisy = (render(camera, target, transform, Imaging(noise=noise)) for noise in (0, 5))
    difference = (noisy.astype(float) - clean)[(clean > 20) & (clean < 235)]
    assert difference.std() == pytest.approx(5, rel=0.05)


def test_occluders_are_drawn_and_masked():
    camera, target = FisheyeCamera((320, 240), 80, 80, 160, 120, theta_max=1.5), paper_target()
    transform = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.12], target)
    polygon = np.array([[100.0, 100], [140, 100], [140, 130], [100, 130]])
    imaging = Imaging(occluders=(polygon,), occluder=77)
    assert render(camera, target, transform, imaging)[115, 120] == 77
    mask = visible_mask(imaging, camera.image_size)
    assert not mask[115, 120] and mask[115, 150]
