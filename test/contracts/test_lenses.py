"""What every lens promises: r(θ) for unit focal length, zero on the axis and rising, with its derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from differences import central_differences
from known_cameras import effect_of_coefficients, random_lens

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES
from fisheye_ep_calib.camera.lenses.lens import increasing_limit, solve_angle

EDGE = 1.75  # rad


@pytest.fixture
def lens(lens_name):
    return LENSES[lens_name]


@pytest.fixture
def coefficients(lens_name) -> list[np.ndarray]:
    """Where a calibration starts, and three sets near it."""
    rng = np.random.default_rng(4)
    start = np.array(LENSES[lens_name].start_coefficients, dtype=float)
    return [start, *(np.array(random_lens(rng, lens_name)) for _ in range(3))]


def test_it_goes_by_its_own_name(lens, lens_name) -> None:
    assert lens.name == lens_name and lens_name.isidentifier()


def test_each_coefficient_has_a_name_and_a_start(lens) -> None:
    names = lens.coefficient_names
    assert len(names) == len(lens.start_coefficients) == len(set(names)) > 0
    assert np.isfinite(lens.start_coefficients).all()


def test_no_coefficient_is_called_as_another_parameter(lens) -> None:
    others = {"fx", "fy", "skew", "cx", "cy", *(name for one in LENS_EXTRAS.values() for name in one.coefficient_names)}
    assert not others & set(lens.coefficient_names)
    assert not [name for name in lens.coefficient_names if name[0] == "e" and name[1:].isdigit()], "a pupil's names"


def test_shapes(lens, coefficients, shape) -> None:
    theta = np.random.default_rng(1).uniform(0, EDGE, shape)
    theta.flags.writeable = False
    for values in coefficients:
        values.flags.writeable = False
        assert np.shape(lens.radius(theta, values)) == shape
        assert np.shape(lens.radius_derivative(theta, values)) == shape
        assert lens.radius_jacobian(theta, values).shape == (len(values), *shape)


def test_an_angle_among_others_is_as_alone(lens, coefficients) -> None:
    theta = np.random.default_rng(2).uniform(0, EDGE, (2, 3))
    for function in (lens.radius, lens.radius_derivative, lens.radius_jacobian):
        together = function(theta, coefficients[1])
        for place in np.ndindex(theta.shape):
            alone = function(np.array(theta[place]), coefficients[1])
            np.testing.assert_allclose(together[(..., *place)], alone, rtol=1e-13)


def test_on_the_axis_it_is_zero_and_rises(lens, coefficients) -> None:
    for values in coefficients:
        assert lens.radius(np.zeros(1), values)[0] == 0
        assert lens.radius_derivative(np.zeros(1), values)[0] > 0.1
        assert increasing_limit(lens, values, np.pi) > np.radians(60)


def test_the_derivative_by_the_angle(lens, coefficients) -> None:
    theta = np.linspace(1e-3, EDGE, 200)
    for values in coefficients:
        numeric = central_differences(
            lambda at, values=values: lens.radius(at, values), theta[:, None], np.array([[2e-4]])
        )
        np.testing.assert_allclose(lens.radius_derivative(theta, values), numeric[:, 0, 0], rtol=1e-7, atol=1e-9)


def test_the_derivative_by_each_coefficient(lens, lens_name, coefficients) -> None:
    theta = np.linspace(0, EDGE, 200)
    for values in coefficients:
        steps = 3e-4 / effect_of_coefficients(lens_name, values)
        numeric = central_differences(lambda moved: lens.radius(theta, moved), values, steps)
        for name, found, expected in zip(
            lens.coefficient_names, lens.radius_jacobian(theta, values), numeric.T, strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=2e-6, atol=2e-7 * np.abs(expected).max(), err_msg=name)


def test_no_coefficient_is_a_mixture_of_the_others(lens, coefficients) -> None:
    jacobian = lens.radius_jacobian(np.linspace(0, EDGE, 300), coefficients[0])
    shares = np.linalg.svd(jacobian / np.linalg.norm(jacobian, axis=1, keepdims=True), compute_uv=False)
    assert shares[-1] > 1e-7 * shares[0]


def test_the_angle_is_found_again_from_the_radius(lens, coefficients) -> None:
    for values in coefficients:
        limit = increasing_limit(lens, values, EDGE)
        theta = np.linspace(0, 0.999 * limit, 300)
        found, valid = solve_angle(lens, lens.radius(theta, values), values, limit)
        assert valid.all()
        np.testing.assert_allclose(found, theta, atol=1e-9)
