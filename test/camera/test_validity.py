"""Where a projection exists, against a search for every root of the implicit equation."""

from __future__ import annotations

import numpy as np
import pytest
from known_cameras import (
    TERMS,
    caustic_distance,
    kannala_brandt,
    pupil,
    random_camera,
    ray_points,
    true_pixels,
    true_pupil,
)

from fisheye_ep_calib.camera import FisheyeCamera

MOVING = [model for model, terms in TERMS.items() if terms]


def camera_with_shift(model: str, shift: float, theta_max_deg: float) -> FisheyeCamera:
    """Of |E(90°)| = shift metres, toward the scene where negative, mostly by the first term."""
    shares = (0.8, 0.2) if TERMS[model] > 1 else (1.0,)
    units = [pupil(model, np.array(np.pi / 2), unit) for unit in np.eye(len(shares))]
    coefficients = tuple(float(share * shift / unit) for share, unit in zip(shares, units, strict=True))
    return FisheyeCamera(
        (2048, 2048),
        590,
        590,
        1023.5,
        1023.5,
        model=model,
        coefficients=coefficients,
        theta_max=np.radians(theta_max_deg),
    )


def regular_roots(camera: FisheyeCamera, rho: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A grid of θ (m,) up to theta_max, and where on it ρ cosθ − (z + E) sinθ falls through zero (n, m)."""
    theta = np.linspace(1e-7, camera.theta_max, 8001)
    value = rho[:, None] * np.cos(theta) - (z[:, None] + true_pupil(camera, theta)) * np.sin(theta)
    return theta[:-1], (value[:, :-1] > 0) & (value[:, 1:] <= 0)


@pytest.mark.parametrize("theta_max", [70, 100])
@pytest.mark.parametrize("shift", [-17e-3, -2e-3, 6e-3])
@pytest.mark.parametrize("model", MOVING)
def test_close_points_are_valid_exactly_where_a_regular_root_exists(model, shift, theta_max) -> None:
    camera = camera_with_shift(model, shift, theta_max)
    rng = np.random.default_rng(1)
    around = np.stack([rng.uniform(1e-5, 0.04, 200), np.zeros(200), rng.uniform(-0.02, 0.06, 200)], axis=-1)
    theta = rng.uniform(0.2, camera.theta_max, 200)
    near = np.abs(caustic_distance(camera, theta)) * rng.choice([0.8, 0.9, 0.98, 1.02, 1.1, 1.2], 200)
    points = np.concatenate([around, ray_points(camera, theta, np.zeros(200), near)])
    _, valid = camera.project(points)
    angles, falls = regular_roots(camera, points[:, 0], points[:, 2])
    assert np.array_equal(valid, falls.any(axis=1))
    assert 50 < valid.sum() < 400
    found = camera.incidence_angle(points)[valid, None]
    assert (np.abs(np.where(falls[valid], angles, np.inf) - found).min(axis=1) < angles[1]).all()


@pytest.mark.parametrize("model", MOVING)
def test_the_caustic_divides_valid_from_invalid(model: str) -> None:
    camera = camera_with_shift(model, -17e-3, 100)
    theta = np.radians(np.linspace(20, 99, 80))
    caustic = caustic_distance(camera, theta)
    assert (caustic > 1e-4).all()
    for factor, regular in ((1.02, True), (0.98, False)):
        points = ray_points(camera, theta, np.full(80, 0.7), factor * caustic)
        found = camera.incidence_angle(points)
        _, valid = camera.project(points)
        assert ((valid & (np.abs(found - theta) < 1e-6)) == regular).all()


@pytest.mark.parametrize("model", TERMS)
def test_nothing_beyond_theta_max(model: str) -> None:
    camera = random_camera(np.random.default_rng(3), model)
    for offset, inside in ((-1e-5, True), (1e-5, False)):
        theta = np.full(3, camera.theta_max + offset)
        _, valid = camera.project(ray_points(camera, theta, np.array([0.0, 2.0, 4.0]), np.array([0.5, 1.0, 10.0])))
        assert (valid == inside).all()
        _, _, valid = camera.unproject(true_pixels(camera, theta, np.array([0.0, 2.0, 4.0])))
        assert (valid == inside).all()


@pytest.mark.parametrize("model", TERMS)
def test_nothing_where_the_image_radius_no_longer_grows(model: str) -> None:
    radial = (-0.2, 0.0, 0.0, 0.0)
    turn = np.sqrt(1 / 0.6)  # r′ = 1 + 3 k1 θ² = 0
    camera = FisheyeCamera(
        (1000, 1000),
        400,
        400,
        500,
        500,
        radial=radial,
        model=model,
        coefficients=(-1e-3,) * min(TERMS[model], 1),
    )
    assert camera.theta_limit == pytest.approx(turn, abs=1e-9)
    for offset, inside in ((-1e-6, True), (1e-6, False)):
        point = ray_points(camera, np.array([turn + offset]), np.zeros(1), np.ones(1))
        assert camera.project(point)[1] == inside
    highest = float(kannala_brandt(turn, radial))
    _, _, valid = camera.unproject([[500 + 400 * highest * (1 - 1e-9), 500], [500 + 400 * highest * (1 + 1e-9), 500]])
    assert valid.tolist() == [True, False]


@pytest.mark.parametrize("model", TERMS)
def test_the_axis_ahead_is_valid_and_behind_is_not(model: str) -> None:
    camera = random_camera(np.random.default_rng(6), model, extras=("tangential", "tilt"))
    ahead = np.array([[0, 0, 0.05], [0, 0, 1.0], [1e-18, 0, 1.0], [0, 0, 1e4]])
    pixels, valid = camera.project(ahead)
    assert valid.all() and np.abs(pixels - [camera.cx, camera.cy]).max() < 1e-9
    behind = np.array([[0, 0, -1.0], [0, 0, -0.02], [0.01, 0, -1.0], [0, 0, 0.0]])
    assert not camera.project(behind)[1].any()


@pytest.mark.parametrize("model", TERMS)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_what_is_not_a_number_is_not_valid(model: str) -> None:
    camera = random_camera(np.random.default_rng(6), model)
    points = np.array([[np.nan, 0, 1], [0, 0, np.nan], [0.1, 0.2, 1.0]])
    assert camera.project(points)[1].tolist() == [False, False, True]
    assert camera.unproject([[np.nan, 3], [np.inf, 3], [1000, 700]])[2].tolist() == [False, False, True]
    alone, _ = camera.project(points[2])
    assert np.allclose(camera.project(points)[0][2], alone, rtol=1e-14)
