"""The ray tracer against closed forms, its own rays, and an independent trace of the same lens."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fisheye_ep_calib.simulation.poses import look_pose, paper_poses
from fisheye_ep_calib.simulation.ray_traced_camera import laikin_camera
from fisheye_ep_calib.simulation.ray_traced_lens import Prescription, chief_rays, laikin_170, refract
from fisheye_ep_calib.simulation.rendering import render
from fisheye_ep_calib.simulation.scenes import paper_target
from fisheye_ep_calib.simulation.truth import feature_pixels, observe, points_in_camera


@pytest.fixture(scope="module")
def camera():
    return laikin_camera()


@pytest.fixture(scope="module")
def oracle(shared_data):
    return np.load(shared_data / "oracle_laikin" / "oracle.npz", allow_pickle=False)


def test_refraction_obeys_snell():
    angle = np.array([0.1, 0.7, 1.2])
    z, y = refract(np.cos(angle), np.sin(angle), np.ones(3), np.zeros(3), 1 / 1.5)
    assert np.allclose(y, np.sin(angle) / 1.5) and np.allclose(z, np.sqrt(1 - y**2))
    assert np.isnan(refract(np.cos(1.2), np.sin(1.2), 1.0, 0.0, 1.5)[0])


def test_a_single_surface_images_its_stop_where_optics_says():
    lens = Prescription(radii=(10.0, np.inf), thicknesses=(4.0, 5.0), indices=(1.5, 1.5), stop=1)
    # n'/s' = n/s + (n' − n)/R seen from inside the glass: 1/p = 1.5/4 − 0.5/10
    assert lens.entrance_pupil == pytest.approx(1 / (1.5 / 4 - 0.05))
    assert lens.focal_length == pytest.approx(1.5 * 10 / 0.5)
    theta, shift, _ = chief_rays(lens, np.array([1e-4]))
    assert shift[0] == pytest.approx(0, abs=1e-6) and 0 < theta[0] < 3e-4


def test_the_lens_is_the_published_one():
    lens = laikin_170(3.5e-3)
    assert lens.focal_length == pytest.approx(3.5e-3, rel=1e-12)
    assert lens.entrance_pupil == pytest.approx(23.907304663514644e-3, rel=1e-9)


def test_the_pupil_moves_to_the_scene_and_starts_as_a_square(camera):
    pupil = camera.entrance_pupil(np.radians([0, 1, 2, 30, 60, 88]))
    assert pupil[0] == 0 and (np.diff(pupil) < 0).all()
    assert pupil[2] / pupil[1] == pytest.approx(4, rel=1e-2)


def test_projected_points_lie_on_their_chief_rays(camera):
    """Independent of the splines: the very ray is traced and its distance from the point measured."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.3, 0.3, (200, 3))
    points[:, 2] = rng.uniform(0.06, 0.4, 200)
    theta, valid = camera.incidence_angle(points)
    assert valid.all()
    fine = np.linspace(0, np.radians(35), 400_001)[1:]
    traced, shift, radius = chief_rays(camera.lens, fine)
    miss = np.hypot(points[:, 0], points[:, 1]) * np.cos(theta)
    miss -= (points[:, 2] - np.interp(theta, traced, shift)) * np.sin(theta)
    assert np.abs(miss).max() < 2e-9
    assert np.abs(np.interp(theta, traced, radius) / camera.pixel_pitch - camera.radius_px(theta)).max() < 1e-5


def test_jacobian_and_unprojection_agree_with_projection(camera):
    rng = np.random.default_rng(1)
    points = np.concatenate([rng.uniform(-0.2, 0.2, (100, 3)) + [0, 0, 0.25], [[0, 0, 0.1]]])
    pixels, valid, jacobian, _ = camera.project_with_jacobian(points)
    assert valid.all()
    step = 1e-6
    numeric = np.stack(
        [(camera.project(points + d)[0] - camera.project(points - d)[0]) / (2 * step) for d in step * np.eye(3)],
        axis=-1,
    )
    assert np.abs(jacobian - numeric).max() < 1e-5 * np.abs(jacobian).max()
    origins, directions, seen = camera.unproject(pixels)
    assert seen.all()
    across = np.cross(points - origins, directions)
    assert np.abs(across).max() < 1e-10


def test_points_out_of_view_are_marked(camera):
    _, valid = camera.project([[0.1, 0, -0.1], [0, 0, -0.1], [0, 0, 0.1]])
    assert valid.tolist() == [False, False, True]


def test_curves_equal_an_independent_trace(camera, oracle):
    theta = oracle["curve_theta"]
    assert np.abs(-camera.entrance_pupil(theta) * 1e3 - oracle["curve_shift_mm"]).max() < 1e-7
    assert np.abs(camera.radius_px(theta) * camera.pixel_pitch * 1e3 - oracle["curve_r_mm"]).max() < 1e-7


@pytest.mark.parametrize("part", ["calib", "heldout"])
def test_pixels_equal_an_independent_trace(camera, oracle, part):
    poses = np.tile(np.eye(4), (len(oracle[f"{part}_rvec"]), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(oracle[f"{part}_rvec"]).as_matrix()
    poses[:, :3, 3] = oracle[f"{part}_tvec"] / 1e3
    pixels, valid = camera.project(points_in_camera(poses, oracle["object_points"] / 1e3))
    assert valid.all()
    assert np.abs(pixels - oracle[f"{part}_uv_clean"]).max() < 1e-5


def test_a_target_is_observed_and_rendered_through_it(camera):
    target = paper_target()
    observations = observe(camera, target, paper_poses(target))
    assert observations.view_count == 25
    pose = look_pose(target, 0.8, 0.3, 0.15)
    image = render(camera, target, pose)
    middles, _ = feature_pixels(camera, target, pose)
    column, row = np.round(middles).astype(int).T
    assert (image[row, column] == 25).all()
