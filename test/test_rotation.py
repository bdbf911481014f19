"""Rotation vectors and matrices against SciPy's, at every angle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fisheye_ep_calib.rotation import rotation_from_vector, vector_from_rotation


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-7, 1e-3, 1.0, 3.0, np.pi - 1e-9])
def test_a_rotation_vector_comes_back_at_every_angle(angle):
    vector = np.random.default_rng(0).normal(size=(200, 3))
    vector *= angle / np.linalg.norm(vector, axis=1, keepdims=True)
    rotation = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_from_vector(vector), rotation, atol=4e-16)
    np.testing.assert_allclose(vector_from_rotation(rotation), vector, rtol=1e-13, atol=1e-14)


def test_half_a_turn_comes_back_about_the_same_axis():
    axis = np.random.default_rng(1).normal(size=(200, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    found = vector_from_rotation(Rotation.from_rotvec(np.pi * axis).as_matrix())
    np.testing.assert_allclose(np.abs((found * axis).sum(axis=1)), np.pi, rtol=1e-14)


def test_one_matrix_gives_one_vector():
    assert vector_from_rotation(np.eye(3)).tolist() == [0.0, 0.0, 0.0]
