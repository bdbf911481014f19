"""The board's shape through the whole of ``calibrate``: what is estimated, held, refused, kept and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import aligned, bent, seen_bent
from changing_boards import seen_changing
from known_scenes import BOARD, CAMERA, poses_of, seen, with_gross_errors

from fisheye_ep_calib import InputError, Observations, calibrate, compare, evaluate, load_target, save_camera
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.target_file import save_target
from fisheye_ep_calib.target.shape.measured import BoardShape

ANGLE = np.radians(60)


@pytest.fixture(scope="module")
def wavy():
    """A bent board's observations, its true points and what auto makes of it."""
    observations, true = seen_bent("wave", 2e-4)
    return observations, true, calibrate(observations)


def errors_in_sigmas(result) -> float:
    error = result.camera.entrance_pupil(ANGLE) - CAMERA.entrance_pupil(ANGLE)
    return abs(float(error / pupil_sigma(result.camera, result.uncertainty.covariance, ANGLE)))


def left(result, true: np.ndarray) -> float:
    """RMS distance, metres, of the points found from the true ones."""
    return float(np.sqrt(((aligned(result.board.points, true) - true) ** 2).sum(axis=1).mean()))


def test_auto_finds_the_shape_of_a_bent_board_and_says_so(wavy) -> None:
    observations, true, result = wavy
    board = result.board
    assert board.kind == "free" and board.bent
    assert left(result, true) < 0.3 * left(calibrate(observations, "ep_even"), true)
    assert errors_in_sigmas(result) < 3.5
    assert result.uncertainty.sigma_px == pytest.approx(0.1, rel=0.06)
    assert "bent by" in board.sentence and any("board shape kept" in reason for reason in result.reasons)
    error = aligned(board.points, true) - true
    assert 0.7 < np.sqrt(((error / board.sigma) ** 2).mean()) < 1.5
    told = {one.name: one for one in result.diagnosis.findings}
    assert told["board_bent"].concern and not told["board_scale"].concern


def test_a_named_model_takes_the_board_as_it_is_unless_asked(wavy) -> None:
    observations, true, _ = wavy
    plain = calibrate(observations, "ep_even")
    assert plain.board.kind == "flat" and not plain.board.bent
    asked = calibrate(observations, "ep_even", board_shape="free")
    assert asked.board.kind == "free" and asked.model == "ep_even"
    assert left(asked, true) < 0.3 * left(plain, true)
    bow = calibrate(observations, "ep_even", board_shape="bow")
    assert bow.board.kind == "bow"
    assert np.array_equal(bow.board_warp, calibrate(observations, "ep_even", board_warp=True).board_warp)


def test_a_flat_board_is_called_flat_and_costs_nothing() -> None:
    observations, _ = seen_bent("bow", 0.0)
    result = calibrate(observations)
    assert result.board.kind == "flat" and not result.board.bent and not result.board.bends


def test_a_stretched_print_is_a_finding() -> None:
    observations, _ = seen_bent("stretched", 3e-3)
    result = calibrate(observations)
    told = {one.name: one for one in result.diagnosis.findings}
    assert result.board.aspect_percent == pytest.approx(0.3, abs=0.03)
    assert told["board_scale"].concern and "longer in x" in told["board_scale"].sentence
    assert not told["board_bent"].concern


@pytest.mark.parametrize("discs", [False, True], ids=["chessboard", "circle grid"])
@pytest.mark.parametrize(("views", "seed"), [(25, 1), (25, 2), (8, 1), (8, 2)])
def test_a_lifted_corner_loses_no_good_point(discs, views, seed) -> None:
    target = paper_target() if discs else BOARD
    true, poses = bent(target.object_points, "corner", 5e-4), poses_of(views, seed)
    if discs:
        observations = observe(CAMERA, replace(target, object_points=true), poses, 0.1, seed=seed)
    else:
        observations = seen(CAMERA, true, poses, 0.1, seed)
    result = calibrate(replace(observations, object_points=target.object_points), "ep_even", board_shape="auto")
    assert not result.rejected and not result.wrong_views
    assert result.board.kind == "free"
    assert left(result, true) < 5e-5


def test_wrong_points_on_a_bent_board_are_cut_and_good_ones_are_not() -> None:
    observations, true = seen_bent("corner", 5e-4)
    spoilt, wrong = with_gross_errors(observations, 0.05)
    result = calibrate(spoilt)
    cut = {(one.view, one.point) for one in result.rejected}
    places = np.stack([spoilt.image_index, spoilt.point_index], axis=-1)
    is_cut = np.array([tuple(place) in cut for place in places.tolist()])
    moved = np.hypot(*(spoilt.pixels - observations.pixels).T) > 3
    assert not (is_cut & ~wrong).any()
    assert is_cut[moved].all()
    assert left(result, true) < 3e-5


def test_few_views_keep_only_what_proves_itself() -> None:
    observations, true = seen_bent("bow", 4e-4, views=5)
    result = calibrate(observations, "ep_even", board_shape="free")
    assert "z2" in result.board.groups and len(result.board.groups) <= 2
    assert left(result, true) < 0.4 * left(calibrate(observations, "ep_even"), true)


@pytest.fixture(scope="module")
def saved(wavy, tmp_path_factory):
    """The camera's file and a target file with the measured shape."""
    _, _, result = wavy
    folder = tmp_path_factory.mktemp("saved")
    save_camera(folder / "front.yaml", result, "front")
    keys = {"type": "chessboard", "columns": 9, "rows": 6, "spacing": 0.02}
    save_target(folder / "board.yaml", keys, result.board)
    return folder


def test_the_camera_file_holds_the_board_and_evaluate_uses_it(wavy, saved) -> None:
    _, _, result = wavy
    file = read_camera_file(saved / "front.yaml")
    assert file.board is not None and np.abs(file.board.points - result.board.points).max() < 2e-9
    other, _ = seen_bent("wave", 2e-4, seed=1)
    fresh = replace(other, pixels=other.pixels + np.random.default_rng(3).normal(0, 0.02, other.pixels.shape))
    judged = evaluate(saved / "front.yaml", fresh)
    assert judged.rms_px < 0.16 and not judged.flat
    assert judged.chosen.source == "measured"
    assert evaluate_camera(result.camera, fresh).rms_px > 1.2 * judged.rms_px
    # Another target's shape is not taken for this one's.
    smaller = replace(fresh, object_points=fresh.object_points * 0.9)
    assert "measured" not in evaluate(saved / "front.yaml", smaller).chosen.held_out_px


def test_compare_says_which_boards_two_cameras_were_calibrated_with(wavy, saved) -> None:
    _, _, result = wavy
    other = calibrate(seen_bent("bow", 4e-4, seed=4)[0])
    told = compare(saved / "front.yaml", other)
    boards = told.to_dict()["boards"]
    assert boards["same_target"] and boards["difference_mm"] > 0.05
    assert boards["first"]["bent"] and boards["second"]["bent"]
    assert "the same target, whose shapes differ by" in repr(told)
    same = compare(saved / "front.yaml", result).to_dict()["boards"]
    assert same["difference_mm"] < 1e-5
    alone = compare(result.camera, other).to_dict()["boards"]
    assert alone["first"] is None and alone["same_target"] is None and alone["difference_mm"] is None


@pytest.mark.parametrize("file", ["front.yaml", "board.yaml"])
def test_a_measured_shape_is_held(file, wavy, saved) -> None:
    observations, _, result = wavy
    held = calibrate(observations, "ep_even", board_shape=saved / file)
    assert np.abs(held.board.points - result.board.points).max() < 2e-9
    assert held.fit.problem.shape_size == 0
    assert held.rms_px < 1.1 * result.rms_px
    shape = held.board
    assert calibrate(observations, "ep_even", board_shape=shape).rms_px == held.rms_px


def test_a_target_with_a_measured_shape_is_known_from_the_start(wavy, saved, tmp_path) -> None:
    observations, true, result = wavy
    target = load_target(saved / "board.yaml")
    with_shape = replace(observations, board=target.shape)
    assert calibrate(with_shape, "ep_even").rms_px < 1.1 * result.rms_px
    auto = calibrate(with_shape)
    assert left(auto, true) < 1.3 * left(result, true)
    from fisheye_ep_calib.storage.observation_file import save_observations

    save_observations(tmp_path / "seen.npz", with_shape)
    again = Observations.load(tmp_path / "seen.npz")
    assert again.board is not None and np.abs(again.board.deviation - target.shape.deviation).max() < 1e-12


def test_points_that_are_nearly_but_not_quite_flat_start_from_nothing() -> None:
    observations, true = seen_bent("wave", 4e-4)
    result = calibrate(replace(observations, object_points=true), "ep_even")
    assert result.rms_px < 0.16 and result.board.kind == "flat"
    assert errors_in_sigmas(result) < 3.5


def test_what_cannot_be_held_is_refused(wavy, tmp_path) -> None:
    observations, _, _ = wavy
    with pytest.raises(InputError, match="unknown board_shape 'wavy'; known: flat, bow, free, auto"):
        calibrate(observations, board_shape="wavy")
    with pytest.raises(InputError, match="another target"):
        calibrate(observations, board_shape=BoardShape.flat(BOARD.object_points * 2))
    (tmp_path / "plain.yaml").write_text("type: chessboard\ncolumns: 9\nrows: 6\nspacing: 0.02\n")
    with pytest.raises(InputError, match="no shape was measured"):
        calibrate(observations, board_shape=tmp_path / "plain.yaml")


def test_the_board_is_drawn_where_it_is_not_flat(wavy) -> None:
    from matplotlib.figure import Figure

    _, _, result = wavy
    axes = result.plot.board(Figure().add_subplot())
    heights = axes.collections[0].get_array()
    assert np.allclose(heights, 1e3 * result.board.deviation[:, 2])
    flat = calibrate(seen_bent("bow", 0.0)[0], "ep_even")
    with pytest.raises(InputError, match="no shape to draw"):
        flat.plot.board()


def test_each_face_of_a_box_of_boards_has_its_own_shape() -> None:
    board = BOARD.object_points + [0.02, 0.02, 0.0]
    faces = [board, board[:, [2, 0, 1]], board[:, [1, 2, 0]]]
    bends = [bent(board, "bow", 4e-4), board, bent(board, "wave", 3e-4)]
    turned = [bends[0], bends[1][:, [2, 0, 1]], bends[2][:, [1, 2, 0]]]
    nominal, true = np.concatenate(faces), np.concatenate(turned)
    observations = replace(seen(CAMERA, true, poses_of(20)), object_points=nominal)
    plain = calibrate(observations, "ep_even")
    result = calibrate(observations, "ep_even", board_shape="auto")
    assert result.board.kind == "free" and result.board.bent
    assert result.rms_px < 0.16 < plain.rms_px
    assert left(result, true) < 0.5 * left(plain, true)
    heights = result.board.in_board_axes[:, 2]
    assert np.ptp(heights[54:108]) < 0.3 * np.ptp(heights[:54])
    surveyed = np.random.default_rng(2).uniform(-0.06, 0.06, (40, 3))
    assert calibrate(seen(CAMERA, surveyed, poses_of(12)), "ep_even", board_shape="free").board.kind == "flat"


@pytest.mark.parametrize("seed", range(8))
def test_a_flat_board_is_given_no_shape(seed) -> None:
    """Many groups of fields together gain by chance what one alone would not."""
    assert calibrate(seen_changing(seed=seed), "ep_even", board_shape="auto").fit.problem.shape_size == 0


@pytest.mark.parametrize("seed", [2, 10, 13, 25])
def test_a_board_whose_points_scatter_is_not_bent(seed) -> None:
    """Scatter of 0.02 mm is hardly seen in nine views; a smooth height would take its place."""
    target = replace(paper_target(), disc_radius=None)
    nominal = target.object_points
    scattered = nominal + np.random.default_rng([seed, 9]).normal(0, 2e-5, nominal.shape)
    views = observe(
        paper_camera(), replace(target, object_points=scattered), paper_poses(target, seed)[::3], 0.15, seed
    )
    result = calibrate(replace(views, object_points=nominal), "ep_odd", board_shape="free")
    assert result.fit.problem.shape_size and not result.board.bent
