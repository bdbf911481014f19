"""What every pupil family promises: E(θ) = Σ e_i basis_i(θ), zero on the axis, with its derivative."""

from __future__ import annotations

import numpy as np
import pytest
from differences import central_differences

from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import entrance_pupil_with_derivative

FAR = 1.9  # rad
ANGLES = np.concatenate([np.linspace(1e-3, FAR, 300), 0.05 + np.array([-2e-3, -1e-9, 0, 1e-9, 2e-3])])


@pytest.fixture
def family(pupil_name):
    return PUPIL_FAMILIES[pupil_name]


def read_only(values) -> np.ndarray:
    values = np.array(values, dtype=float)
    values.flags.writeable = False
    return values


def test_its_name_is_a_word_for_commands_and_files(pupil_name) -> None:
    assert pupil_name.isidentifier() and pupil_name == pupil_name.lower()
    assert pupil_name not in ("auto", "ep_odd_target_axis")


def test_its_usual_number_of_terms_is_one_it_has(family) -> None:
    assert 0 <= family.default_terms <= family.max_terms
    assert (family.default_terms == 0) == (family.max_terms == 0)


def test_shapes(family, shape) -> None:
    theta = read_only(np.random.default_rng(1).uniform(0, FAR, shape))
    for terms in range(family.max_terms + 1):
        for part in (family.basis(theta, terms), family.basis_derivative(theta, terms)):
            assert part.shape == (terms, *shape) and np.isfinite(part).all()


def test_an_angle_among_others_is_as_alone(family) -> None:
    theta = np.random.default_rng(2).uniform(0, FAR, (2, 3))
    for function in (family.basis, family.basis_derivative):
        together = function(theta, family.max_terms)
        for place in np.ndindex(theta.shape):
            alone = function(np.array(theta[place]), family.max_terms)
            np.testing.assert_allclose(together[(slice(None), *place)], alone, rtol=1e-13)


def test_zero_on_the_axis(family) -> None:
    assert not family.basis(np.zeros(1), family.max_terms).any()
    near = family.basis(np.array([1e-7]), family.max_terms)
    assert np.abs(near).max(initial=0) < 1e-5, "E(θ) does not go to zero on the axis"


def test_the_derivative_is_that_of_the_basis(family) -> None:
    for terms in range(family.max_terms + 1):
        numeric = central_differences(
            lambda at, terms=terms: np.moveaxis(family.basis(at[:, 0], terms), 0, -1),
            ANGLES[:, None],
            np.array([[1e-4]]),
        )
        np.testing.assert_allclose(family.basis_derivative(ANGLES, terms).T, numeric[..., 0], rtol=1e-6, atol=1e-12)


def test_the_projection_takes_that_value_and_that_derivative(family) -> None:
    for terms in range(1, family.max_terms + 1):
        coefficients = np.random.default_rng(terms).normal(0, 1e-3, terms)
        value, derivative = entrance_pupil_with_derivative(family, ANGLES, coefficients)
        np.testing.assert_allclose(value, coefficients @ family.basis(ANGLES, terms), rtol=1e-11, atol=1e-18)
        expected = coefficients @ family.basis_derivative(ANGLES, terms)
        np.testing.assert_allclose(derivative, expected, rtol=1e-11, atol=1e-18)


def test_no_term_is_a_mixture_of_the_others(family) -> None:
    for terms in range(1, family.max_terms + 1):
        basis = family.basis(np.linspace(0, FAR, 400), terms)
        shares = np.linalg.svd(basis / np.linalg.norm(basis, axis=1, keepdims=True), compute_uv=False)
        assert shares[-1] > 1e-7 * shares[0]
