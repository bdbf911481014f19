"""Projection and unprojection against cameras written down a second time, and against OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from known_cameras import (
    KINDS,
    TERMS,
    kannala_brandt,
    random_camera,
    random_rays,
    ray_points,
    true_pixels,
    true_pupil,
)

from fisheye_ep_calib.camera import FisheyeCamera


def cameras(kind, count: int = 3):
    rng = np.random.default_rng(7)
    return [(rng, random_camera(rng, *kind)) for _ in range(count)]


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_point_on_a_ray_lands_on_the_rays_pixel(kind) -> None:
    for rng, camera in cameras(kind):
        theta, phi, distance = random_rays(rng, camera, 500)
        points = ray_points(camera, theta, phi, distance)
        pixels, valid = camera.project(points)
        assert valid.all()
        assert np.abs(pixels - true_pixels(camera, theta, phi)).max() < 1e-9
        assert np.abs(camera.incidence_angle(points) - theta).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_a_pixel_unprojects_to_its_own_ray_with_its_own_origin(kind) -> None:
    for rng, camera in cameras(kind):
        theta, phi, _ = random_rays(rng, camera, 500)
        origins, directions, valid = camera.unproject(true_pixels(camera, theta, phi))
        truth = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
        assert valid.all()
        assert np.abs(directions - truth).max() < 1e-11
        assert np.abs(origins[:, 2] + true_pupil(camera, theta)).max() < 1e-12
        assert not origins[:, :2].any()


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_project_of_unproject_is_the_same_pixel(kind) -> None:
    for rng, camera in cameras(kind):
        theta, phi, distance = random_rays(rng, camera, 500)
        pixels = true_pixels(camera, theta, phi)
        origins, directions, _ = camera.unproject(pixels)
        again, valid = camera.project(origins + distance[:, None] * directions)
        assert valid.all() and np.abs(again - pixels).max() < 1e-9


@pytest.mark.parametrize("model", [name for name in TERMS if name != "kannala"])
def test_without_a_pupil_shift_every_family_is_kannala_brandt(model: str) -> None:
    rng = np.random.default_rng(3)
    camera = random_camera(rng, "kannala")
    points = rng.normal(0, 1, (2000, 3)) * 10 ** rng.uniform(-2, 2, (2000, 1))
    points = points[np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]) < np.radians(100)]
    theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    radius, phi = kannala_brandt(theta, camera.radial), np.arctan2(points[:, 1], points[:, 0])
    x, y = radius * np.cos(phi), radius * np.sin(phi)
    truth = np.stack([camera.fx * x + camera.skew * y + camera.cx, camera.fy * y + camera.cy], axis=-1)
    shifted = FisheyeCamera(
        camera.image_size,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        camera.skew,
        camera.radial,
        model,
        (0.0,) * TERMS[model],
    )
    for one in (camera, shifted):
        pixels, valid = one.project(points)
        assert valid.all() and np.abs(pixels - truth).max() < 2e-12  # a few units of the last place


def test_kannala_brandt_is_opencvs_fisheye() -> None:
    """OpenCV knows no skew and is wrong past 90°."""
    rng = np.random.default_rng(5)
    for _ in range(5):
        camera = random_camera(rng, "kannala")
        theta, phi, distance = random_rays(rng, camera, 400)
        keep = theta < np.radians(86)
        points = ray_points(camera, theta[keep], phi[keep], distance[keep])
        matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
        expected, _ = cv2.fisheye.projectPoints(points[None], np.zeros(3), np.zeros(3), matrix, np.array(camera.radial))
        straight = camera.with_parameters(np.where(np.arange(len(camera.parameters)) == 2, 0, camera.parameters))
        assert np.abs(straight.project(points)[0] - expected.reshape(-1, 2)).max() < 1e-9


@pytest.mark.parametrize("model", TERMS)
def test_leading_axes_broadcast(model: str) -> None:
    rng = np.random.default_rng(9)
    camera = random_camera(rng, model, extras=("tangential",))
    points = ray_points(camera, *random_rays(rng, camera, 24))
    count = len(camera.parameters)
    pixels, valid, d_point, d_parameters = camera.project_with_jacobian(points)
    rays = camera.unproject(pixels)
    for shape in [(24,), (4, 6), (2, 3, 4), (1, 24)]:
        found = camera.project_with_jacobian(points.reshape(*shape, 3))
        assert [part.shape[len(shape) :] for part in found] == [(2,), (), (2, 3), (2, count)]
        assert all(part.shape[: len(shape)] == shape for part in found)
        for part, flat in zip(found, (pixels, valid, d_point, d_parameters), strict=True):
            np.testing.assert_allclose(part.reshape(flat.shape), flat, rtol=1e-12)
        shaped = camera.unproject(pixels.reshape(*shape, 2))
        assert [part.shape for part in shaped] == [(*shape, 3), (*shape, 3), shape]
        for part, flat in zip(shaped, rays, strict=True):
            np.testing.assert_allclose(part.reshape(flat.shape), flat, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("model", TERMS)
def test_one_point_no_points_and_lists_of_integers(model: str) -> None:
    camera = random_camera(np.random.default_rng(1), model)
    pixel, valid = camera.project([0, 1, 2])
    assert pixel.shape == (2,) and np.shape(valid) == () and valid
    assert [part.shape for part in camera.project_with_jacobian(np.array([0.0, 1.0, 2.0]))] == [
        (2,),
        (),
        (2, 3),
        (2, len(camera.parameters)),
    ]
    assert np.allclose(camera.project(np.array([[0.0, 1.0, 2.0]]))[0][0], pixel, rtol=1e-14)
    origin, direction, seen = camera.unproject([1000, 700])
    assert origin.shape == direction.shape == (3,) and seen
    empty = camera.project_with_jacobian(np.empty((0, 3)))
    assert [part.shape for part in empty] == [(0, 2), (0,), (0, 2, 3), (0, 2, len(camera.parameters))]
    assert [part.shape for part in camera.unproject(np.empty((5, 0, 2)))] == [(5, 0, 3), (5, 0, 3), (5, 0)]
    assert camera.entrance_pupil(0.5).shape == ()
