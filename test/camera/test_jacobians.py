"""Every derivative against central differences."""

from __future__ import annotations

import numpy as np
import pytest
from differences import central_differences
from known_cameras import (
    KINDS,
    TERMS,
    effect_of_coefficients,
    pupil,
    random_camera,
    random_rays,
    ray_points,
    true_pixels,
)

from fisheye_ep_calib.camera import LENS_EXTRAS, FisheyeCamera


def parameter_steps(camera: FisheyeCamera) -> np.ndarray:
    """(P,): 0.1 px, 0.01 of skew, 3e-4 of r by a lens coefficient, of an extra's coefficient 1e-4, or what moves
    the image plane by 1e-5, 3 µm of E, both at 100°."""
    shifts = [abs(pupil(camera.model, np.radians(100), unit)) for unit in np.eye(len(camera.coefficients))]
    lens = 3e-4 / effect_of_coefficients(camera.lens, np.array(camera.radial))
    extras = []
    for name, values in camera.active_extras:
        _, columns = LENS_EXTRAS[name].jacobian(np.array(1.0), np.array(0.7), values)
        extras += [1e-4 * max(1.0, 0.1 / np.hypot(*column)) for column in np.moveaxis(columns, 1, 0)]
    return np.array([0.1, 0.1, 0.01, 0.1, 0.1, *lens, *extras, *[3e-6 / shift for shift in shifts]])


def assert_same(found: np.ndarray, expected: np.ndarray) -> None:
    """(n, rows, columns), to 1e-6 of each column's length, and of what all points show where it nearly vanishes."""
    length = np.linalg.norm(expected, axis=-2)
    error = np.linalg.norm(found - expected, axis=-2)
    assert (error <= 1e-6 * length + 1e-10 * length.max(axis=0)).all()


@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_projection_by_point_and_by_every_parameter(kind, seed) -> None:
    rng = np.random.default_rng([11, seed])
    camera = random_camera(rng, *kind)
    theta, phi, distance = random_rays(rng, camera, 200, least=2e-3)
    points = ray_points(camera, theta, phi, distance.clip(max=1.0))
    _, valid, d_point, d_parameters = camera.project_with_jacobian(points)
    assert valid.all()
    steps = np.broadcast_to(2e-4 * distance.clip(max=1.0)[:, None], points.shape)
    assert_same(d_point, central_differences(lambda moved: camera.project(moved)[0], points, steps))
    numeric = central_differences(
        lambda values: camera.with_parameters(values).project(points)[0],
        camera.parameters,
        parameter_steps(camera),
    )
    assert_same(d_parameters, numeric)


@pytest.mark.parametrize("kind", KINDS, ids=str)
@pytest.mark.parametrize("seed", range(3))
def test_rays_by_pixel(kind, seed) -> None:
    rng = np.random.default_rng([12, seed])
    camera = random_camera(rng, *kind)
    theta, phi, _ = random_rays(rng, camera, 200)
    pixels = true_pixels(camera, theta, phi)
    origins, directions, valid, d_origins, d_directions = camera.unproject_with_jacobian(pixels)
    plain = camera.unproject(pixels)
    assert valid.all() and np.array_equal(origins, plain[0]) and np.array_equal(directions, plain[1])
    steps = np.full(pixels.shape, 0.2)
    for part, found in enumerate((d_origins, d_directions)):
        numeric = central_differences(lambda moved, part=part: camera.unproject(moved)[part], pixels, steps)
        assert_same(np.swapaxes(found, -1, -2), np.swapaxes(numeric, -1, -2))


@pytest.mark.parametrize("model", TERMS)
def test_on_and_beside_the_axis(model: str) -> None:
    """φ is undefined there, the projection is smooth nevertheless."""
    camera = random_camera(np.random.default_rng(2), model, extras=tuple(LENS_EXTRAS))
    points = np.array([[0, 0, 0.1], [1e-16, 0, 0.1], [1e-9, -1e-9, 0.1], [1e-6, 2e-6, 0.1], [0, 0, 3.0]])
    _, valid, d_point, _ = camera.project_with_jacobian(points)
    assert valid.all()
    numeric = central_differences(lambda moved: camera.project(moved)[0], points, np.full(points.shape, 1e-5))
    assert np.abs(d_point - numeric).max() < 1e-6 * np.abs(numeric).max()
    centre = camera.project(points[0])[0]
    _, _, _, d_origins, d_directions = camera.unproject_with_jacobian(centre)
    assert np.abs(d_origins).max() < 1e-12
    # There and back: the direction moves by the point's step over its distance.
    assert np.allclose(d_directions[:2] @ d_point[0][:, :2] * 0.1, np.eye(2), atol=1e-9)
