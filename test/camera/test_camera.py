"""The camera as a value: what it refuses, what it keeps, what cannot be changed."""

from __future__ import annotations

import copy
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from known_cameras import random_camera

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError

PLAIN = {"image_size": (1000, 800), "fx": 300.0, "fy": 300.0, "cx": 500.0, "cy": 400.0}


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"fx": np.nan}, "finite"),
        ({"cy": np.inf}, "finite"),
        ({"fx": -300.0}, "positive"),
        ({"fy": 0.0}, "positive"),
        ({"fx": None}, "number"),
        ({"fx": "wide"}, "number"),
        ({"image_size": (0, 800)}, "0×800"),
        ({"image_size": (1000,)}, "image_size"),
        ({"image_size": (1000.5, 800)}, "image_size"),
        ({"model": "pinhole"}, "pinhole"),
        ({"model": ["ep_odd"]}, "ep_odd"),
        ({"lens": "pinhole"}, "pinhole"),
        ({"radial": (0.0, 0.0)}, "4"),
        ({"radial": 0.0}, "number"),
        ({"radial": (0.0, 0.0, 0.0, np.nan)}, "finite"),
        ({"lens": "double_sphere"}, "2"),
        ({"coefficients": (1e-3,)}, "at most 0"),
        ({"model": "ep_odd", "coefficients": (0.0,) * 5}, "at most 4"),
        ({"model": "gennery", "coefficients": (0.0,) * 4}, "at most 3"),
        ({"extras": {"prism": (0.0,)}}, "prism"),
        ({"extras": {"tilt": (0.0,)}}, "tilt"),
        ({"extras": None}, "number"),
        ({"theta_max": 0.0}, "theta_max"),
        ({"theta_max": 3.2}, "theta_max"),
        ({"theta_max": np.nan}, "theta_max"),
    ],
    ids=str,
)
def test_what_is_no_camera_is_refused(change, word) -> None:
    with pytest.raises(InputError, match=word):
        FisheyeCamera(**{**PLAIN, **change})


def test_a_camera_cannot_be_changed() -> None:
    radial, extras = [0.01, 0.0, 0.0, 0.0], {"tilt": [0.01, 0.0]}
    camera = FisheyeCamera(**PLAIN, radial=radial, extras=extras, model="ep_even", coefficients=np.array([-1e-3]))
    before, pixel = camera.parameters.copy(), camera.project([0.1, 0.2, 0.3])[0]
    radial[0], extras["tilt"][0] = 0.5, 0.5
    with pytest.raises(FrozenInstanceError):
        camera.fx = 1.0
    for array in (camera.parameters, camera.radial_array, camera.coefficients_array):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert np.array_equal(camera.parameters, before)
    assert np.array_equal(camera.project([0.1, 0.2, 0.3])[0], pixel)


def test_copies_are_equal() -> None:
    camera = random_camera(np.random.default_rng(2), "gennery", extras=("tilt",))
    camera.project([0.0, 0.0, 1.0])
    assert copy.deepcopy(camera) == camera == pickle.loads(pickle.dumps(camera))
    assert camera != camera.with_parameters(camera.parameters * 1.01)


def test_the_pupil_sits_where_its_rays_start() -> None:
    """The sign: a pupil that moves toward the scene has E < 0 and origins at z > 0."""
    camera = FisheyeCamera(**PLAIN, model="ep_even", coefficients=(-2e-3,))
    assert camera.entrance_pupil(np.array([0.0, 1.0, 2.0])) == pytest.approx([0, -2e-3, -8e-3])
    assert camera.entrance_pupil_derivative(1.0) == pytest.approx(-4e-3)
    origin, direction, _ = camera.unproject([800.0, 400.0])
    assert origin == pytest.approx([0, 0, 2e-3]) and direction == pytest.approx([np.sin(1), 0, np.cos(1)])
