"""A plain board whose views count its points from different corners: its own shape tells which point is which."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import aligned, bent
from known_scenes import CAMERA, rows, seen, with_gross_errors

from fisheye_ep_calib import Observations, calibrate, evaluate, save_camera
from fisheye_ep_calib.calibration.estimating.point_names import Lattice
from fisheye_ep_calib.simulation import random_poses
from fisheye_ep_calib.storage.observation_file import save_observations
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid

ANGLE = np.radians(60)
BOARDS = {"oblong": Chessboard.create("oblong", 9, 6, 0.02), "square": Chessboard.create("square", 8, 8, 0.02)}


def seen_in_part(board, true: np.ndarray, views: int = 20, seed: int = 1, parts: int = 6) -> Observations:
    """What the camera sees of a board's true points (n, 3); the last views show a part of it."""
    observations = seen(
        CAMERA, true, random_poses(board, views, seed, (0.12, 0.3), (0.0, 75.0), (5.0, 50.0)), 0.05, seed
    )
    cell = Lattice.of(board.object_points).cell[observations.point_index]
    cut = (observations.image_index >= views - parts) & ((cell[:, 0] < 2) | (cell[:, 1] < 1))
    return replace(rows(observations, ~cut), object_points=board.object_points)


def counted_anyhow(observations: Observations, seed: int = 0) -> tuple[Observations, int]:
    """Each view but the fullest counted in a way of its own, and how many are not counted as they were."""
    rng, lattice = np.random.default_rng(seed), Lattice.of(observations.object_points)
    names, changed = observations.point_index.copy(), 0
    fullest = np.argmax(np.bincount(observations.image_index))
    for image in np.unique(observations.image_index):
        if image == fullest:
            continue
        of_view = np.flatnonzero(observations.image_index == image)
        ways = lattice.recounts(names[of_view])
        way = rng.integers(len(ways))
        names[of_view] = ways.point_index[way]
        changed += way > 0
    return replace(observations, point_index=names, mistakable=True), changed


def shape_error(result, true: np.ndarray) -> float:
    """RMS distance, metres, of the points found from the true ones."""
    return float(np.sqrt(((aligned(result.board.points, true) - true) ** 2).sum(axis=1).mean()))


def recount_told(result) -> list[str]:
    return [reason for reason in result.reasons if "count the board's points" in reason]


@pytest.mark.parametrize("kind", BOARDS)
@pytest.mark.parametrize(("bend", "amount"), [("wave", 3e-4), ("jitter", 1e-4)])
def test_the_camera_is_that_of_views_that_count_alike(kind, bend, amount) -> None:
    board = BOARDS[kind]
    true = bent(board.object_points, bend, amount)
    alike = seen_in_part(board, true)
    mixed, changed = counted_anyhow(alike)
    assert changed > 8
    known = calibrate(alike, "ep_even", board_shape="free")
    found = calibrate(mixed, "ep_even", board_shape="free")
    left_alone = calibrate(replace(mixed, mistakable=False), "ep_even", board_shape="free")
    assert found.rms_px == pytest.approx(known.rms_px, rel=0.02)
    assert left_alone.rms_px > 1.5 * found.rms_px
    assert shape_error(found, true) < 1.2 * shape_error(known, true) < 0.5 * shape_error(left_alone, true)
    assert found.camera.entrance_pupil(ANGLE) == pytest.approx(known.camera.entrance_pupil(ANGLE), abs=2e-5)


def test_auto_says_how_many_views_counted_otherwise() -> None:
    board = BOARDS["oblong"]
    mixed, changed = counted_anyhow(seen_in_part(board, bent(board.object_points, "jitter", 1e-4)))
    assert f"{changed} of 20 views" in recount_told(calibrate(mixed))[0]


@pytest.mark.parametrize("seed", range(4))
def test_a_flat_board_keeps_its_counts(seed) -> None:
    board = BOARDS["square"]
    observations = replace(seen_in_part(board, board.object_points, seed=seed), mistakable=True)
    plain = calibrate(replace(observations, mistakable=False), "ep_even", board_shape="free")
    result = calibrate(observations, "ep_even", board_shape="free")
    assert np.array_equal(result.observations.point_index, plain.observations.point_index)
    assert np.array_equal(result.camera.parameters, plain.camera.parameters)


def test_wrong_points_name_no_view() -> None:
    board = BOARDS["oblong"]
    alike, _ = with_gross_errors(seen_in_part(board, bent(board.object_points, "wave", 5e-4)), 0.02)
    mixed, changed = counted_anyhow(alike)
    assert changed > 8
    known, found = (calibrate(each, "ep_even", board_shape="free") for each in (alike, mixed))
    np.testing.assert_allclose(found.camera.parameters, known.camera.parameters, rtol=1e-3, atol=1e-5)


def test_discs_are_counted_alike_too() -> None:
    board = CircleGrid.create("discs", 9, 6, 0.02, 0.005)
    true = bent(board.object_points, "jitter", 1e-4)
    mixed, _ = counted_anyhow(seen_in_part(board, true))
    mixed = replace(mixed, disc_radius=1e-6)  # of centres that were projected as points
    assert shape_error(calibrate(mixed, "ep_even", board_shape="free"), true) < 4e-5


def test_a_file_keeps_that_the_board_is_mistakable(tmp_path) -> None:
    board = BOARDS["oblong"]
    mixed, _ = counted_anyhow(seen_in_part(board, board.object_points, views=5))
    for mistakable in (False, True):
        save_observations(tmp_path / "seen.npz", replace(mixed, mistakable=mistakable))
        assert Observations.load(tmp_path / "seen.npz").mistakable is mistakable


def test_a_measured_shape_names_the_points_of_the_next_recording(tmp_path) -> None:
    board = BOARDS["square"]
    true = bent(board.object_points, "wave", 3e-4)
    known = calibrate(seen_in_part(board, true), "ep_even", board_shape="free")
    mixed, _ = counted_anyhow(seen_in_part(board, true, seed=7), seed=3)
    result = calibrate(mixed, "ep_even", board_shape=known.board)
    assert result.rms_px == pytest.approx(np.sqrt(2) * 0.05, rel=0.1)
    save_camera(tmp_path / "camera.yaml", known)
    judged = evaluate(tmp_path / "camera.yaml", mixed)
    assert judged.rms_px == pytest.approx(np.sqrt(2) * 0.05, rel=0.1)
    assert evaluate(tmp_path / "camera.yaml", replace(mixed, mistakable=False)).rms_px > 2 * judged.rms_px


def test_only_lattices_have_other_counts() -> None:
    rng = np.random.default_rng(0)
    assert Lattice.of(rng.normal(size=(30, 3))) is None
    assert Lattice.of(np.pad(rng.normal(size=(30, 2)), ((0, 0), (0, 1)))) is None
    oblong, square = (Lattice.of(BOARDS[kind].object_points) for kind in ("oblong", "square"))
    assert len(oblong.recounts(np.arange(54))) == 2 and len(square.recounts(np.arange(64))) == 4
    asymmetric = CircleGrid.create("a", 4, 11, 0.02, 0.005, asymmetric=True).object_points
    for way in Lattice.of(asymmetric).recounts(np.arange(20)).point_index:
        gaps = [np.linalg.norm(np.diff(asymmetric[names], axis=0), axis=1) for names in (np.arange(20), way)]
        np.testing.assert_allclose(*gaps)
