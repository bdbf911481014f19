"""How two cameras differ, against differences and uncertainties that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.camera_difference import camera_difference, points_on_rays
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError

CAMERA = FisheyeCamera(
    (800, 600), 220.0, 221.0, 401.0, 298.0, 0.1, (0.01, -0.002, 0.0, 0.0), "ep_even", (-1e-3, 1e-4), theta_max=1.5
)


def test_same_camera_does_not_differ():
    found = camera_difference(CAMERA, CAMERA, (0.1, 1.0, np.inf), alignment="none")
    assert np.nanmax(found.length_px) < 1e-6
    assert np.isfinite(found.length_px).mean() > 0.95
    assert found.covariances_given == (False, False)


def test_turn_that_looks_like_a_shift_of_the_centre_is_taken_out():
    shifted = replace(CAMERA, cx=CAMERA.cx + 0.5)
    plain = camera_difference(CAMERA, shifted, (np.inf,), alignment="none")
    turned = camera_difference(CAMERA, shifted, (np.inf,))
    np.testing.assert_allclose(plain.length_px, 0.5, atol=1e-6)
    assert np.sqrt(np.nanmean(turned.length_px**2)) < 0.2
    assert abs(turned.rotation[1]) == pytest.approx(0.5 / CAMERA.fx, rel=0.3)


def test_alignment_is_the_best_one():
    other = replace(CAMERA, cy=CAMERA.cy - 0.3, radial=(0.012, -0.002, 0.0, 0.0))
    cost = {
        alignment: np.nansum(camera_difference(CAMERA, other, (0.1, 0.3), alignment=alignment).length_px ** 2)
        for alignment in ("none", "rotation", "rigid")
    }
    assert cost["rigid"] < cost["rotation"] < cost["none"]


def test_a_shift_is_not_sought_at_infinity():
    other = replace(CAMERA, radial=(0.012, -0.002, 0.0, 0.0))
    found = camera_difference(CAMERA, other, (np.inf,), alignment="rigid")
    np.testing.assert_array_equal(found.shift, 0)


@pytest.mark.parametrize("alignment", ["none", "rotation", "rigid"])
def test_expected_difference_is_that_of_drawn_cameras(alignment):
    """Both cameras drawn from a covariance: the RMS over draws is what is expected."""
    rng = np.random.default_rng(1)
    sigma = np.array([0.05, 0.05, 0.01, 0.05, 0.05, 1e-4, 1e-4, 1e-5, 1e-6, 3e-5, 1e-5])
    mixing = rng.normal(size=(len(sigma), len(sigma)))
    covariance = 0.2 * sigma[:, None] * (mixing @ mixing.T) / len(sigma) * sigma
    root = np.linalg.cholesky(covariance)
    square, expected = 0.0, None
    draws = 120
    for _ in range(draws):
        pair = [CAMERA.with_parameters(CAMERA.parameters + root @ rng.normal(size=len(sigma))) for _ in range(2)]
        found = camera_difference(*pair, (0.15, np.inf), (covariance, covariance), alignment, grid=9)
        square += np.nanmean(found.length_px**2, axis=1) / draws
        expected = np.nanmean(found.sigma_px**2, axis=1)
    np.testing.assert_allclose(np.sqrt(square), np.sqrt(expected), rtol=0.15)


def test_only_the_field_that_both_know_is_compared():
    narrow = replace(CAMERA, theta_max=0.8)
    assert camera_difference(CAMERA, narrow, (1.0,)).theta.max() <= 0.8
    assert camera_difference(narrow, CAMERA, (1.0,)).theta.max() <= 0.8


def test_other_image_size_is_refused():
    with pytest.raises(InputError, match="800×600"):
        camera_difference(CAMERA, replace(CAMERA, image_size=(640, 480)), (1.0,))


def test_a_point_lies_ahead_on_its_ray_or_there_is_none():
    rng = np.random.default_rng(1)
    origins = np.zeros((500, 3))
    origins[:, 2] = rng.uniform(-0.05, 0.05, 500)
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    distance = rng.uniform(0.005, 0.1, 500)
    points, seen = points_on_rays(origins, directions, distance)
    np.testing.assert_allclose(np.linalg.norm(points[seen], axis=-1), distance[seen], rtol=1e-9)
    ahead = ((points - origins) * directions).sum(axis=-1)
    assert (ahead[seen] > 0).all()
    inside = np.abs(origins[:, 2]) < distance
    assert seen[inside].all() and 0 < seen[~inside].sum() < (~inside).sum()


def test_a_strong_pupil_does_not_differ_from_itself_at_any_distance():
    camera = replace(CAMERA, coefficients=(-10e-3, -3e-3))
    for distance in (0.005, 0.02, 0.05, 0.1):
        found = camera_difference(camera, camera, (distance,))
        assert not (found.length_px > 1e-6).any()
    assert np.isfinite(found.length_px).any()
