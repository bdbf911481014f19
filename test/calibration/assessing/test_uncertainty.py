"""What the calibration says about its own errors, against the scatter of repeated calibrations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA, poses_of, seen, seen_board

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.calibration.assessing.uncertainty import projection_uncertainty
from fisheye_ep_calib.camera.bands import pupil_sigma, radius_sigma
from fisheye_ep_calib.rotation import moved_poses, rotation_from_vector

pytestmark = pytest.mark.filterwarnings("error")
THETA = np.radians([30, 60, 80])
NOISE = 0.1


def draws(count: int, **options):
    """The clean scene's calibration, and those of ``count`` draws of its noise."""
    clean = seen(CAMERA, BOARD.object_points, poses_of(), noise=0.0)
    for seed in range(count):
        noise = np.random.default_rng([seed, 9]).normal(0, NOISE, clean.pixels.shape)
        yield calibrate(replace(clean, pixels=clean.pixels + noise), "ep_even", **options)


def test_sigma_is_the_noise_and_halves_with_four_times_the_views() -> None:
    """Four times as much of the same kind; the same place again would be no view of its own."""
    step = np.random.default_rng(5).normal(0, 0.02, (4, len(poses_of()), 6)) * [1, 1, 1, 0.1, 0.1, 0.1]
    poses = np.concatenate([moved_poses(poses_of(), each) for each in step])
    results = [
        calibrate(seen(CAMERA, BOARD.object_points, poses[: times * len(poses_of())], NOISE), "ep_even")
        for times in (1, 4)
    ]
    assert results[1].views == len(poses)
    for result in results:
        assert result.uncertainty.sigma_px == pytest.approx(NOISE, rel=0.05)
    once, four_times = (np.sqrt(np.diag(result.uncertainty.covariance)) for result in results)
    assert once / four_times == pytest.approx(np.full(11, 2.0), rel=0.1)


def test_covariance_is_that_of_the_parameters_and_zero_where_they_are_fixed() -> None:
    result = calibrate(seen_board(), "ep_even", skew=False, board_warp=True)
    covariance, names = result.uncertainty.covariance, result.camera.parameter_names
    assert covariance.shape == (11, 11) and np.allclose(covariance, covariance.T)
    skew = names.index("skew")
    assert not covariance[skew].any() and not covariance[:, skew].any()
    assert np.linalg.eigvalsh(np.delete(np.delete(covariance, skew, 0), skew, 1))[0] > 0
    assert result.uncertainty.shared.shape == (13, 13)


def test_bands_are_the_propagated_covariance() -> None:
    """By sampling parameters from it."""
    result = calibrate(seen_board(), "ep_even")
    camera, covariance = result.camera, result.uncertainty.covariance
    drawn = np.random.default_rng(1).multivariate_normal(camera.parameters, covariance, 4000)
    cameras = [camera.with_parameters(values) for values in drawn]
    shifts = np.std([one.entrance_pupil(THETA) for one in cameras], axis=0)
    radii = np.std([one.fx * one.radius(THETA) for one in cameras], axis=0)
    assert pupil_sigma(camera, covariance, THETA) == pytest.approx(shifts, rel=0.05)
    assert radius_sigma(camera, covariance, THETA) == pytest.approx(radii, rel=0.05)
    assert pupil_sigma(camera, covariance, np.array(0.0)) == 0
    central = calibrate(seen_board(), "kannala")
    assert not pupil_sigma(central.camera, central.uncertainty.covariance, THETA).any()


def aligned_error(camera, points: np.ndarray) -> np.ndarray:
    """Pixel errors (n, 2) of a camera at points over the field once the best rigid motion of all boards is taken out.

    The motion is the one that brings the camera's prediction of the boards nearest to the truth.
    """
    boards = BOARD.object_points @ np.swapaxes(poses_of()[:, :3, :3], 1, 2) + poses_of()[:, None, :3, 3]
    boards = boards.reshape(-1, 3)
    target, valid = CAMERA.project(boards)
    boards, target = boards[valid], target[valid]
    motion = np.zeros(6)
    for _ in range(4):
        moved = boards @ rotation_from_vector(motion[:3]).T + motion[3:]
        pixels, _, d_point, _ = camera.project_with_jacobian(moved)
        x, y, z = moved.T
        zero = 0 * x
        turn = np.stack(
            [np.stack([zero, z, -y], -1), np.stack([-z, zero, x], -1), np.stack([y, -x, zero], -1)], axis=-2
        )
        columns = np.concatenate([d_point @ turn, d_point], axis=-1).reshape(-1, 6)
        motion = motion - np.linalg.lstsq(columns, (pixels - target).ravel(), rcond=None)[0]
    moved = points @ rotation_from_vector(motion[:3]).T + motion[3:]
    return camera.project(moved)[0] - CAMERA.project(points)[0]


@pytest.mark.slow
def test_projection_uncertainty_is_the_scatter_of_projections() -> None:
    """Near, inside and far beyond the recorded distances, in the frame that the boards define."""
    angle, turn = np.meshgrid(np.radians([0, 40, 75]), np.radians([20, 140, 260]))
    direction = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], -1).reshape(-1, 3)
    points = np.concatenate([distance * direction for distance in (0.07, 0.2, 1e4)])
    errors, claimed = [], []
    for result in draws(150):
        errors.append(aligned_error(replace(result.camera, theta_max=np.pi), points))
        claimed.append(projection_uncertainty(result.camera, result.uncertainty, result.fit.problem.free, points))
    scatter = np.sqrt((np.array(errors) ** 2).mean(axis=(0, 2)))
    ratio = np.mean(claimed, axis=0) / scatter
    assert ((ratio > 0.8) & (ratio < 1.25)).all(), ratio


@pytest.mark.slow
def test_one_sigma_covers_68_per_cent() -> None:
    covered, scatter, claimed = [], [], []
    for result in draws(300):
        sigma = np.sqrt(np.diag(result.uncertainty.covariance))
        error = result.camera.parameters - CAMERA.parameters
        band = pupil_sigma(result.camera, result.uncertainty.covariance, THETA)
        shift = result.camera.entrance_pupil(THETA) - CAMERA.entrance_pupil(THETA)
        covered.append(np.concatenate([np.abs(error) < sigma, np.abs(shift) < band]))
        scatter.append(np.concatenate([error, shift]))
        claimed.append(np.concatenate([sigma, band]))
    assert 0.63 <= np.mean(covered) <= 0.73
    # Each by itself: 300 draws scatter by 2.7 % in coverage and 4 % in σ.
    assert (np.abs(np.mean(covered, axis=0) - 0.683) < 0.09).all()
    ratio = np.std(scatter, axis=0) / np.mean(claimed, axis=0)
    assert ((ratio > 0.88) & (ratio < 1.12)).all(), ratio
    assert (np.abs(np.mean(scatter, axis=0)) < 0.25 * np.mean(claimed, axis=0)).all()


def test_a_few_draws_scatter_as_claimed() -> None:
    normalised = []
    for result in draws(12):
        sigma = np.sqrt(np.diag(result.uncertainty.covariance))
        normalised.append((result.camera.parameters - CAMERA.parameters) / sigma)
    assert 0.75 < np.sqrt(np.mean(np.square(normalised))) < 1.3


def test_projection_uncertainty_grows_outside_the_recorded_distances() -> None:
    result = calibrate(seen_board(), "ep_even")
    table = result.projection_table
    assert table.distance_m.tolist() == [0.1, 0.3, 1.0, 10.0, np.inf]
    assert table.sigma_px.shape == (len(table.theta_deg), 5) and np.isfinite(table.sigma_px).all()
    rim = table.sigma_px[-1]
    assert rim[0] > rim[1] < rim[2] < rim[4]
    # At 0.3 m, among the boards, it is a small part of one corner's noise.
    assert table.sigma_px[:, 1].max() < NOISE


def bent(seed: int) -> Observations:
    """Each view's points are also moved by a smooth field of its own, as by a board that is not quite flat."""
    clean = seen(CAMERA, BOARD.object_points, poses_of(), noise=0.0)
    rng = np.random.default_rng([seed, 11])
    x, y = (BOARD.object_points[clean.point_index, :2] / np.ptp(BOARD.object_points[:, :2], axis=0)).T
    shapes = np.stack([np.cos(np.pi * a * x) * np.cos(np.pi * b * y) for a in range(3) for b in range(3)], axis=-1)
    field = rng.normal(0, 0.05, (25, 9, 2))[clean.image_index]
    moved = (shapes[..., None] * field).sum(axis=1) + rng.normal(0, 0.05, clean.pixels.shape)
    return replace(clean, pixels=clean.pixels + moved)


def test_residuals_that_hang_together_widen_the_bands_and_independent_ones_do_not() -> None:
    known = calibrate(bent(0), "ep_even").uncertainty
    assert known.clustering > 3
    independent = [result.uncertainty.clustering for result in draws(10)]
    assert independent == [1.0] * 10


@pytest.mark.slow
def test_bands_hold_where_residuals_hang_together() -> None:
    off = []
    for seed in range(60):
        result = calibrate(bent(seed), "ep_even")
        sigma = pupil_sigma(result.camera, result.uncertainty.covariance, THETA)
        off.append((result.camera.entrance_pupil(THETA) - CAMERA.entrance_pupil(THETA)) / sigma)
    spread = np.sqrt(np.mean(np.square(off), axis=0))
    assert (spread > 0.6).all() and (spread < 1.5).all()  # taken as independent: 2 and more


def test_a_family_that_was_chosen_knows_less_than_one_that_was_given() -> None:
    observations = seen_board(noise=0.3)
    chosen = calibrate(observations)
    given = calibrate(observations, chosen.model, skew="skew" in chosen.fit.shared_parameters[0])
    names = given.camera.parameter_names
    assert chosen.entrance_pupil_supported and chosen.camera.parameter_names == (*names, "e3", "e4")
    common = np.arange(len(names))
    more = chosen.uncertainty.covariance[np.ix_(common, common)] - given.uncertainty.covariance
    assert np.linalg.eigvalsh(more)[-1] > 0
    wider = pupil_sigma(chosen.camera, chosen.uncertainty.covariance, THETA)
    assert (wider >= pupil_sigma(given.camera, given.uncertainty.covariance, THETA)).all()
    assert chosen.comparison[chosen.model].covariance is chosen.uncertainty.covariance


@pytest.mark.slow
def test_bands_hold_whatever_family_is_chosen() -> None:
    off = []
    for seed in range(40):
        clean = seen(CAMERA, BOARD.object_points, poses_of(), noise=0.0)
        noise = np.random.default_rng([seed, 12]).normal(0, 0.15, clean.pixels.shape)
        result = calibrate(replace(clean, pixels=clean.pixels + noise))
        assert result.entrance_pupil_supported
        sigma = pupil_sigma(result.camera, result.uncertainty.covariance, THETA)
        off.append(np.abs(result.camera.entrance_pupil(THETA) - CAMERA.entrance_pupil(THETA)) / sigma)
    assert (np.mean(np.array(off) > 2, axis=0) <= 0.1).all()


def test_noise_free_views_are_known_exactly() -> None:
    result = calibrate(seen(CAMERA, BOARD.object_points, poses_of(), noise=0.0), "ep_even")
    assert result.uncertainty.sigma_px < 1e-6 and np.isfinite(result.uncertainty.covariance).all()
    assert result.camera.parameters == pytest.approx(CAMERA.parameters, rel=1e-6, abs=1e-6)


def test_weights_scale_the_noise_not_the_camera() -> None:
    observations = seen_board()
    plain = calibrate(observations, "ep_even")
    scaled: Observations = replace(observations, weights=np.full(len(observations.pixels), 2.0))
    double = calibrate(scaled, "ep_even")
    assert double.camera.parameters == pytest.approx(plain.camera.parameters, rel=1e-6, abs=1e-7)
    assert double.uncertainty.covariance == pytest.approx(plain.uncertainty.covariance, rel=1e-3, abs=1e-12)
