"""Views are told apart by where, how large and how tilted the board appears, not by its numbering."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.planning.view_selection import is_new, view_signature

SIZE = (2048, 2048)
BOARD = np.stack([axis.ravel() for axis in np.meshgrid(np.arange(11), np.arange(7))], axis=1) * 0.01
BOARD = np.column_stack([BOARD - BOARD.mean(axis=0), np.zeros(len(BOARD))])


def rotation(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[[i, j, i, j], [i, j, j, i]] = [c, c, -s, s]
    return matrix


def pixels_of(turned: np.ndarray, translation: tuple[float, float, float]) -> np.ndarray:
    """An equidistant fisheye, f = 590 px."""
    points = BOARD @ turned.T + np.array(translation)
    rho = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(rho, points[:, 2])
    return 1023.5 + 590 * (theta / np.maximum(rho, 1e-12))[:, None] * points[:, :2]


def signature(turned=None, translation=(0.0, 0.0, 0.12)):
    turned = np.eye(3) if turned is None else turned
    return view_signature(BOARD, pixels_of(turned, translation), SIZE)


@pytest.mark.parametrize(
    "other",
    [
        signature(translation=(0.05, 0.0, 0.12)),
        signature(translation=(0.0, 0.0, 0.18)),
        signature(rotation("y", 25)),
        signature(rotation("x", -25)),
    ],
    ids=["moved aside", "further away", "tilted about y", "tilted about x"],
)
def test_position_size_and_tilt_make_a_view_new(other) -> None:
    assert is_new(other, [signature()])


def test_opposite_tilts_differ() -> None:
    assert is_new(signature(rotation("y", 20)), [signature(rotation("y", -20))])


def test_the_same_view_is_not_new() -> None:
    rng = np.random.default_rng(1)
    noisy = pixels_of(np.eye(3), (0.001, 0.0, 0.121)) + rng.normal(0, 0.2, (len(BOARD), 2))
    assert not is_new(view_signature(BOARD, noisy, SIZE), [signature()])


@pytest.mark.parametrize("turned", [np.eye(3), rotation("y", 30) @ rotation("x", 15)])
def test_half_a_turn_of_the_numbering_is_the_same_view(turned: np.ndarray) -> None:
    pixels = pixels_of(turned, (0.03, 0.02, 0.12))
    assert not is_new(view_signature(BOARD, pixels[::-1], SIZE), [view_signature(BOARD, pixels, SIZE)])


def test_units_and_numbering_do_not_matter_but_a_line_of_points_says_nothing() -> None:
    row = BOARD[:, 1] == BOARD[0, 1]
    pixels = pixels_of(np.eye(3), (0.0, 0.0, 0.12))
    assert view_signature(BOARD[row], pixels[row], SIZE) is None
    assert view_signature(BOARD[:5], pixels[:5], SIZE) is None


def test_a_stream_of_a_slowly_moved_board_keeps_few() -> None:
    kept = []
    for step in range(300):
        view = signature(rotation("y", 20 * np.sin(step / 30)), (0.05 * np.sin(step / 40), 0, 0.12))
        if is_new(view, kept):
            kept.append(view)
    assert 4 <= len(kept) <= 25
