"""What is estimated comes out as it went in: extras, lenses, bent, solid and tilted targets, any unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA, deviation, poses_of, rows, seen, seen_board

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.storage.observation_file import load_observations

pytestmark = pytest.mark.filterwarnings("error")
THETA = np.radians([30, 60, 85])
BENT = {
    "tangential": {"tangential": (0.003, -0.002)},
    "tilt": {"tilt": (0.010, -0.015)},
    "tangential and tilt": {"tangential": (0.003, -0.002), "tilt": (0.010, -0.015)},
}


def assert_true(result, truth) -> None:
    """Within 4.5 σ in every parameter and in E, and at the noise."""
    assert result.converged and result.uncertainty.sigma_px == pytest.approx(0.1, rel=0.06)
    worst = deviation(result, truth)
    assert max(map(abs, worst.values())) < 4.5, worst
    sigma = pupil_sigma(result.camera, result.uncertainty.covariance, THETA)
    error = result.camera.entrance_pupil(THETA) - truth.entrance_pupil(THETA)
    assert (np.abs(error) < 4.5 * sigma).all() and sigma.max() < 0.2e-3


@pytest.mark.parametrize("extras", BENT.values(), ids=BENT)
def test_lens_extras(extras) -> None:
    camera = replace(CAMERA, extras=extras)
    observations = seen_board(camera)
    result = calibrate(observations, "ep_even", **dict.fromkeys(extras, True))
    assert_true(result, camera)
    for name, values in extras.items():
        assert result.camera.extras[name] == pytest.approx(values, abs=2e-3)
    without = calibrate(observations, "ep_even")
    assert without.rms_px > 1.5 * result.rms_px and not without.camera.extras


def test_auto_finds_decentering() -> None:
    result = calibrate(seen_board(replace(CAMERA, extras=BENT["tangential"])))
    assert result.camera.extras["tangential"] == pytest.approx((0.003, -0.002), abs=3e-4)


@pytest.mark.parametrize("model", ["ep_even", "auto"])
def test_a_double_sphere_lens(model) -> None:
    camera = replace(CAMERA, lens="double_sphere", radial=(-0.2, 0.6))
    result = calibrate(seen_board(camera), model, lens="double_sphere")
    assert result.camera.lens == "double_sphere"
    assert result.camera.radial == pytest.approx((-0.2, 0.6), abs=0.01)
    assert result.rms_px == pytest.approx(0.137, abs=0.006)
    if model == "ep_even":
        assert_true(result, camera)


@pytest.mark.parametrize("model", ["ep_odd", "ep_even", "gennery"])
def test_every_family_by_its_own_model(model) -> None:
    coefficients = {
        "ep_odd": (-0.3e-3, -0.1e-3, 0.0, 0.0),
        "ep_even": (-0.6e-3, -0.1e-3),
        "gennery": (3e-3, 0.5e-3),
    }[model]
    camera = replace(CAMERA, model=model, coefficients=coefficients)
    result = calibrate(seen_board(camera, views=40), model)
    assert_true(result, camera)
    assert result.comparison[model].cross_validated_rms_px < 0.9 * result.comparison["kannala"].cross_validated_rms_px


@pytest.mark.parametrize("bow_mm", [(0.4, 0.2, 0.0), (-0.3, 0.5, 0.2)])
def test_the_bow_of_a_board(bow_mm) -> None:
    """w_x (1 − (x/h)²) + w_y (1 − (y/h)²) + w_xy (x/h)(y/h) about the middle."""
    flat = BOARD.object_points
    x, y = ((flat[:, :2] - flat[:, :2].mean(axis=0)) / (np.ptp(flat[:, :2], axis=0) / 2)).T
    bent = flat + np.column_stack(
        [0 * x, 0 * y, 1e-3 * (bow_mm[0] * (1 - x * x) + bow_mm[1] * (1 - y * y) + bow_mm[2] * x * y)]
    )
    observations = replace(seen(CAMERA, bent, poses_of()), object_points=flat)
    for model in ("ep_even", "auto"):
        result = calibrate(observations, model, board_warp=True if model != "auto" else None)
        if model == "ep_even":
            assert_true(result, CAMERA)
        assert 1e3 * result.board_warp == pytest.approx(bow_mm, abs=0.03)
    assert calibrate(observations, "ep_even", board_warp=False).rms_px > 1.4 * result.rms_px


def solids() -> dict[str, np.ndarray]:
    flat = BOARD.object_points
    rng = np.random.default_rng(5)
    return {
        "two steps": flat + np.where(np.arange(54)[:, None] % 9 > 4, [0, 0, 0.03], 0.0),
        "a corner of two boards": np.concatenate([flat, flat[:, [0, 2, 1]] * [1, 1, -1]]),
        "a cloud": rng.uniform(-0.08, 0.08, (60, 3)),
        "a bumpy board": flat + rng.normal(0, 1e-3, flat.shape) * [0, 0, 1],
    }


@pytest.mark.parametrize("points", solids().values(), ids=solids())
def test_targets_with_depth(points) -> None:
    observations = seen(CAMERA, points, poses_of())
    result = calibrate(observations, "ep_even")
    assert_true(result, CAMERA)
    assert result.points == len(observations.pixels)
    assert calibrate(observations).entrance_pupil_supported


def test_the_frame_of_the_target_does_not_matter() -> None:
    """A board whose own axes lie anywhere, far from the origin."""
    rotation, _ = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))
    rotation *= np.linalg.det(rotation)
    moved = BOARD.object_points @ rotation.T + [1.0, 2.0, 3.0]
    observations = seen_board()
    plain = calibrate(observations, "ep_even")
    turned = calibrate(replace(observations, object_points=moved), "ep_even")
    assert turned.camera.parameters == pytest.approx(plain.camera.parameters, rel=1e-5, abs=1e-6)
    assert turned.rms_px == pytest.approx(plain.rms_px, rel=1e-9)
    place = turned.camera_from_target @ np.block([[rotation, np.array([[1.0], [2.0], [3.0]])], [np.eye(4)[3:]]])
    assert np.abs(place - plain.camera_from_target).max() < 1e-5


def test_poses_come_out_too() -> None:
    poses = poses_of()
    result = calibrate(seen(CAMERA, BOARD.object_points, poses, noise=0.01), "ep_even")
    moved = np.linalg.inv(poses[result.view_images]) @ result.camera_from_target
    angle = np.arccos(np.clip((np.trace(moved[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert angle.max() < 2e-3 and np.linalg.norm(moved[:, :3, 3], axis=1).max() < 0.5e-3


def test_views_of_very_unequal_numbers_of_points() -> None:
    observations = seen_board(views=40)
    rng, keep = np.random.default_rng(2), []
    for view in range(40):
        own = np.flatnonzero(observations.image_index == view)
        keep += rng.permutation(own)[: 6 + view % 5 * 12].tolist()
    result = calibrate(rows(observations, np.sort(keep)), "ep_even")
    assert_true(result, CAMERA)


def test_the_order_of_the_sightings_and_gaps_in_the_numbering_do_not_matter() -> None:
    observations = seen_board()
    order = np.random.default_rng(3).permutation(len(observations.pixels))
    shuffled = Observations.create(
        observations.object_points,
        3 * observations.image_index[order] + 7,
        observations.point_index[order],
        observations.pixels[order],
        observations.image_size,
    )
    plain, other = calibrate(observations, "ep_even"), calibrate(shuffled, "ep_even")
    assert other.camera.parameters == pytest.approx(plain.camera.parameters, rel=1e-6, abs=1e-7)
    assert other.view_images.tolist() == (3 * plain.view_images + 7).tolist()


@pytest.mark.parametrize("model", ["kannala", "ep_even", "auto"])
def test_millimetres_and_metres_give_the_same_camera(tmp_path, model) -> None:
    observations = seen_board()
    arrays = {key: getattr(observations, key) for key in ("image_index", "point_index", "pixels", "image_size")}
    cameras = []
    for unit, scale in (("m", 1.0), ("mm", 1e3)):
        np.savez(tmp_path / f"{unit}.npz", object_points=scale * observations.object_points, unit=unit, **arrays)
        cameras.append(calibrate(load_observations(tmp_path / f"{unit}.npz"), model).camera)
    assert cameras[0].parameters == pytest.approx(cameras[1].parameters, rel=1e-9, abs=1e-15)
    assert cameras[0].theta_max == pytest.approx(cameras[1].theta_max, rel=1e-9)


def test_weights_count_and_zero_leaves_out() -> None:
    observations = seen_board(noise=0.1)
    poor = np.random.default_rng(4).random(len(observations.pixels)) < 0.5
    noisy = observations.pixels + np.where(
        poor[:, None], np.random.default_rng(5).normal(0, 2, observations.pixels.shape), 0
    )
    weighted = replace(observations, pixels=noisy, weights=np.where(poor, 0.05, 1.0))
    result = calibrate(weighted, "ep_even")
    assert_true(result, CAMERA)
    error = result.reprojection_error * weighted.weights[:, None]
    assert result.rms_px == pytest.approx(np.sqrt((error**2).sum(axis=1).mean()), rel=1e-9)
    left_out = calibrate(replace(observations, pixels=noisy, weights=np.where(poor, 0.0, 1.0)), "ep_even")
    alone = calibrate(rows(observations, ~poor), "ep_even")
    assert left_out.points == alone.points == (~poor).sum()
    assert left_out.camera.parameters == pytest.approx(alone.camera.parameters, rel=1e-7, abs=1e-8)
