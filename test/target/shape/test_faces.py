"""Faces of targets that are not flat."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.base import rectangular_grid
from fisheye_ep_calib.target.shape.faces import faces_of


def box() -> np.ndarray:
    """Three boards that meet in a corner, points (162, 3)."""
    board = rectangular_grid(9, 6, 0.02, 0.02) + [0.02, 0.02, 0.0]
    return np.concatenate([board, board[:, [2, 0, 1]], board[:, [1, 2, 0]]])


def test_a_box_of_boards_has_its_faces() -> None:
    order = np.random.default_rng(0).permutation(162)
    faces = faces_of(box()[order])
    assert sorted(len(face) for face in faces) == [54, 54, 54]
    assert {frozenset((order[face] // 54).tolist()) for face in faces} == {
        frozenset({0}),
        frozenset({1}),
        frozenset({2}),
    }


def test_a_flat_target_is_one_face_and_surveyed_points_are_none() -> None:
    flat = rectangular_grid(9, 6, 0.02, 0.02)
    assert [len(face) for face in faces_of(flat)] == [54]
    bent = flat + np.array([0, 0, 1]) * 2e-4 * np.sin(50 * flat[:, :1])
    assert [len(face) for face in faces_of(bent)] == [54]
    assert faces_of(np.random.default_rng(1).uniform(-1, 1, (60, 3))) == ()
