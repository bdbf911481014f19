"""The smooth fields: orthonormal, blind to what no camera sees, and with the slopes that they have."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.target.base import rectangular_grid
from fisheye_ep_calib.target.shape.basis import SMOOTH_GROUPS, smooth_fields
from fisheye_ep_calib.target.shape.frame import board_frame

BOARDS = {
    "large": rectangular_grid(22, 22, 0.0075, 0.0075),
    "paper's": rectangular_grid(11, 7, 0.012, 0.012),
    "small": rectangular_grid(4, 3, 0.09, 0.09),
    "one row off": rectangular_grid(9, 6, 0.02, 0.03)[3:-4],
}


@pytest.mark.parametrize("name", BOARDS)
def test_fields_are_orthonormal_over_the_points_seen_and_hold_no_similarity(name) -> None:
    points = BOARDS[name]
    seen = np.ones(len(points), bool)
    seen[[0, -1]] = False
    frame = board_frame(points)
    fields = smooth_fields(frame, points, seen)
    value = fields.value[seen].reshape(-1, fields.value.shape[-1])
    assert np.abs(value.T @ value / seen.sum() - np.eye(value.shape[1])).max() < 1e-10
    x, y = (points - points.mean(axis=0)).T[:2]
    zero, one = np.zeros_like(x), np.ones_like(x)
    similarities = [
        np.stack(one_of, axis=-1)
        for one_of in (
            *((zero, zero, z) for z in (one, x, y)),
            (one, zero, zero),
            (zero, one, zero),
            (-y, x, zero),
            (x, y, zero),
        )
    ]
    for similarity in similarities:
        along = similarity[seen].ravel() @ value
        assert np.abs(along).max() < 1e-10 * max(np.linalg.norm(similarity) * np.sqrt(len(points)), 1e-9)


def test_a_large_board_has_every_group_in_full() -> None:
    points = BOARDS["large"]
    fields = smooth_fields(board_frame(points), points, np.ones(len(points), bool))
    counts = np.bincount(fields.group, minlength=len(SMOOTH_GROUPS)).tolist()
    assert counts == [3, 4, 5, 6, 7, 8, 9, 2, 6, 8, 10, 12, 14]


@pytest.mark.parametrize("name", BOARDS)
def test_slopes_are_the_derivatives_of_the_fields(name) -> None:
    points = BOARDS[name]
    frame, step, count = board_frame(points), 1e-7, len(points)
    seen = np.ones(count, bool)
    fields = smooth_fields(frame, points, seen)
    for axis in range(2):
        shift = np.zeros(3)
        shift[axis] = step
        # Points beside the real ones that are not seen take no part in what makes the fields orthonormal.
        both = np.concatenate([points, points + shift, points - shift])
        beside = smooth_fields(frame, both, np.concatenate([seen, ~seen, ~seen])).value
        found = (beside[count : 2 * count] - beside[2 * count :]) / (2 * step)
        scale = np.abs(fields.slope[:, axis]).max()
        assert np.abs(fields.slope[:, axis] - found).max() < 1e-5 * scale


def test_a_bent_board_keeps_its_axes_and_its_plane() -> None:
    points = BOARDS["paper's"].copy()
    points[:, 2] = 0.4e-3 * np.sin(40 * points[:, 0])
    frame = board_frame(points)
    assert frame.planar
    assert np.abs(frame.axes - np.eye(3)).max() < 0.01
    assert not board_frame(np.random.default_rng(0).normal(0, 0.05, (40, 3))).planar
