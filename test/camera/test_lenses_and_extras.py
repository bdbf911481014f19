"""Lenses and extras against their published formulas and against OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from known_cameras import LENS_FORMULAS, PUPIL_FORMULAS, decentered, tilted

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES, FisheyeCamera


@pytest.mark.parametrize("coefficients", [(-0.2, 0.6), (-0.35, 0.55), (0.0, 0.65), (0.3, 0.52), (-0.3, 0.4)])
def test_double_sphere_is_the_published_projection(coefficients) -> None:
    """π(x) of Usenko, Demmel and Cremers (2018), equations 40 to 45, where they call it valid."""
    xi, alpha = coefficients
    x, y, z = np.random.default_rng(1).normal(0, 1, (3, 4000))
    d1 = np.sqrt(x * x + y * y + z * z)
    d2 = np.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
    w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
    published = z > -w2 * d1
    denominator = alpha * d2 + (1 - alpha) * (xi * d1 + z)
    camera = FisheyeCamera((1000, 800), 300, 310, 500, 400, radial=coefficients, lens="double_sphere")
    pixels, valid = camera.project(np.stack([x, y, z], axis=-1))
    assert valid[published].all() and published.sum() > 2000
    expected = np.stack([300 * x / denominator + 500, 310 * y / denominator + 400], axis=-1)
    error = np.abs(pixels - expected)[published] / (1 + np.abs(expected[published]))
    assert error.max() < 1e-10
    if alpha > 0.5:
        assert camera.radius(camera.theta_limit) == pytest.approx(1 / np.sqrt(2 * alpha - 1), rel=1e-9)
    assert not camera.project([0.001, 0, -1.0])[1]


def test_a_double_sphere_of_no_use_starts_nowhere() -> None:
    camera = FisheyeCamera((100, 100), 50, 50, 50, 50, radial=(-1.5, 0.1), lens="double_sphere")
    assert not camera.project([0.1, 0.0, 1.0])[1]


def test_tilt_is_opencvs_tilted_sensor() -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-1, 1, (200, 2)), rng.uniform(1, 3, 200)])
    plane = points[:, :2] / points[:, 2:]
    for tau in [(0.0, 0.0), (0.03, -0.02), (-0.2, 0.1), (0.0, 0.3)]:
        distortion = np.zeros(14)
        distortion[12:] = tau
        expected, _ = cv2.projectPoints(points[None], np.zeros(3), np.zeros(3), np.eye(3), distortion)
        found = np.stack(LENS_EXTRAS["tilt"].apply(plane[:, 0], plane[:, 1], tau), axis=-1)
        assert np.abs(found - expected.reshape(-1, 2)).max() < 1e-12


def test_tangential_is_opencvs_decentering() -> None:
    points = np.column_stack([np.random.default_rng(3).uniform(-1.5, 1.5, (200, 2)), np.ones(200)])
    for p in [(0.0, 0.0), (0.01, -0.02), (-0.03, 0.005)]:
        distortion = np.array([0, 0, *p, 0], dtype=float)
        expected, _ = cv2.projectPoints(points[None], np.zeros(3), np.zeros(3), np.eye(3), distortion)
        found = np.stack(LENS_EXTRAS["tangential"].apply(points[:, 0], points[:, 1], p), axis=-1)
        assert np.abs(found - expected.reshape(-1, 2)).max() < 1e-12


@pytest.mark.parametrize("extras", [{"tangential": (0.2, 0.2)}, {"tilt": (0.9, -0.5)}], ids=["tangential", "tilt"])
def test_a_pixel_that_an_extra_does_not_reach_has_no_ray(extras) -> None:
    camera = FisheyeCamera((1000, 800), 300, 310, 500, 400, extras=extras)
    u, v = np.meshgrid(np.linspace(-4000, 5000, 91), np.linspace(-4000, 5000, 91))
    pixels = np.stack([u, v], axis=-1)
    origins, directions, valid = camera.unproject(pixels)
    assert valid.any() and not valid.all()
    back, _ = camera.project(origins[valid] + directions[valid])
    assert np.abs(back - pixels[valid]).max() < 1e-5


def test_extras_are_applied_in_order() -> None:
    """Decentering belongs to the lens, tilt to the sensor behind it, however they are listed."""
    p, tau = (0.01, -0.02), (0.05, 0.03)
    camera = FisheyeCamera((1000, 800), 300, 310, 500, 400, skew=0.5, extras={"tilt": tau, "tangential": p})
    x, y = tilted(*decentered(np.array(0.8), np.array(0.3), p), tau)
    theta = np.hypot(0.8, 0.3)
    pixel, _ = camera.project(np.array([np.sin(theta) * 0.8, np.sin(theta) * 0.3, np.cos(theta) * theta]))
    assert np.allclose(pixel, [300 * x + 0.5 * y + 500, 310 * y + 400], atol=1e-10)
    assert camera.parameter_names[9:] == ("p1", "p2", "tau_x", "tau_y")


@pytest.mark.parametrize("model", [name for name in PUPIL_FORMULAS if name != "kannala"])
def test_pupil_bases_are_their_formulas(model: str) -> None:
    """Gennery's series included: θ/sinθ − 1 loses digits near the axis, so there against the series itself."""
    family = PUPIL_FAMILIES[model]
    theta = np.concatenate([np.linspace(0.02, 1.8, 200), 0.05 + np.array([-1e-12, 0, 1e-12])])
    for terms in range(1, family.max_terms + 1):
        found = family.basis(theta, terms)
        expected = np.stack([PUPIL_FORMULAS[model](theta, unit) for unit in np.eye(terms)])
        np.testing.assert_allclose(found, expected, rtol=2e-12)
    tiny = np.array([0.0, 1e-8, 1e-4, 1e-3])
    power = {"ep_odd": tiny**3, "ep_even": tiny**2, "gennery": -(tiny**2 / 6 + 7 * tiny**4 / 360)}[model]
    np.testing.assert_allclose(family.basis(tiny, 1)[0], power, rtol=1e-12, atol=0)


@pytest.mark.parametrize("lens", LENS_FORMULAS)
def test_lenses_are_their_formulas(lens: str) -> None:
    theta = np.linspace(0, 1.9, 100)
    coefficients = np.array(LENSES[lens].start_coefficients) + 0.01
    np.testing.assert_allclose(
        LENSES[lens].radius(theta, coefficients), LENS_FORMULAS[lens](theta, coefficients), rtol=1e-13, atol=1e-16
    )
