"""What a measured shape says in numbers and in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.target.base import rectangular_grid
from fisheye_ep_calib.target.shape.basis import smooth_fields
from fisheye_ep_calib.target.shape.frame import board_frame
from fisheye_ep_calib.target.shape.measured import BoardShape

POINTS = rectangular_grid(11, 7, 0.012, 0.012)


def test_a_stretched_board_says_by_how_much_and_along_which_axis() -> None:
    change = np.zeros_like(POINTS)
    change[:, 1] = 0.0012 * POINTS[:, 1]
    shape = BoardShape("free", POINTS, change - change.mean(axis=0))
    assert shape.aspect_percent == pytest.approx(-0.12)
    assert shape.height_rms_mm == 0
    assert "0.12 % longer in y than in x" in shape.sentence
    assert "bent" not in shape.sentence


def test_a_bent_board_says_how_far_and_a_flat_one_nothing() -> None:
    change = np.zeros_like(POINTS)
    change[:, 2] = 0.4e-3 * ((POINTS[:, 0] / POINTS[:, 0].max()) ** 2)
    shape = BoardShape("free", POINTS, change, bent=True, scatter=(2e-5, 2e-5, 1e-5))
    assert "bent by 0.40 mm" in shape.sentence
    assert "corners scatter by 0.03 mm" in shape.sentence
    assert "discs scatter by 0.03 mm" in replace(shape, discs=True).sentence
    flat = BoardShape.flat(POINTS)
    assert flat.to_dict() == {
        "shape": "flat",
        "bent": False,
        "height_rms_mm": 0.0,
        "in_plane_rms_mm": 0.0,
        "rough_rms_mm": 0.0,
        "aspect_percent": 0.0,
    }


def test_slopes_that_are_not_given_are_those_of_the_deviation() -> None:
    fields = smooth_fields(board_frame(POINTS), POINTS, np.ones(len(POINTS), bool), 3)
    weights = np.random.default_rng(0).normal(0, 1e-4, fields.value.shape[-1])
    shape = BoardShape("free", POINTS, fields.value @ weights)
    assert np.allclose(shape.local[:, 3:].reshape(-1, 2, 3), fields.slope @ weights, atol=1e-9)


def test_the_target_is_known_again_by_its_points() -> None:
    shape = BoardShape.flat(POINTS)
    assert shape.same_target(POINTS + 1e-9)
    assert not shape.same_target(POINTS * 1.001)
    assert not shape.same_target(POINTS[:-1])


def test_a_print_that_a_printer_distorts_is_told() -> None:
    place = POINTS - POINTS.mean(axis=0)
    change = -0.005 * place * ((place**2).sum(axis=1) / (place**2).sum(axis=1).max())[:, None]
    shape = BoardShape("free", POINTS, change)
    assert 0.02 < shape.distortion_rms_mm < 0.1
    assert "distorted in its plane by" in shape.sentence
    scattered = replace(shape, scatter=(1e-3, 1e-3, 0.0))
    assert "distorted" not in scattered.sentence
    sheared = BoardShape("free", POINTS, 1e-3 * place[:, [1, 0, 2]] * [1, 1, 0])
    assert sheared.aspect_percent == pytest.approx(0, abs=1e-9) and "distorted in its plane by" in sheared.sentence
