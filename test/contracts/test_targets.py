"""What every kind of target promises: file → target → artwork → image → its points, under their names."""

from __future__ import annotations

import pickle
from functools import lru_cache

import cv2
import numpy as np
import pytest
import yaml
from registered_targets import CAMERA, IMAGING, imaging, turns, whole_views

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.simulation import clutter_image, feature_pixels, look_pose, render
from fisheye_ep_calib.simulation.patterns import pattern
from fisheye_ep_calib.target import Detection, Target, load_target, parse_target
from fisheye_ep_calib.target.registry import TARGETS

NOT_NUMBERS = (None, [], {}, [1, 2], {"a": 1}, "x", "", True, float("nan"), float("inf"))
NONSENSE = (*NOT_NUMBERS, -1, 0, 0.5, 3, 49, 501, 1e9, 10**30)
QUARTERS = [0.0, np.pi / 2, np.pi, 3 * np.pi / 2]


@pytest.fixture
def target(board) -> Target:
    return board.target


@lru_cache(maxsize=1)
def detector_of(target: Target):
    return target.detector()


@lru_cache(maxsize=8)
def seen(target: Target, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An image of the whole target, where its points truly are (n, 2), and its pose."""
    pose = whole_views(target)[number]
    truth, valid = feature_pixels(CAMERA, target, pose)
    assert valid.all() and ((truth > 2) & (truth < np.array(CAMERA.image_size) - 3)).all()
    return render(CAMERA, target, pose, imaging(number)), truth, pose


def check_form(detection: Detection, target: Target) -> None:
    index, pixels = detection.point_index, detection.pixels
    assert index.ndim == 1 and index.dtype.kind == "i" and pixels.shape == (len(index), 2)
    assert len(np.unique(index)) == len(index) and np.isfinite(pixels).all()
    assert ((index >= 0) & (index < len(target.object_points))).all()
    assert bool(detection.reason) == (len(index) == 0), "a reason is given where nothing is found, and only there"
    assert detection.rejected.shape[1:] == (2,)


def names_right(detection: Detection, truth: np.ndarray, names: np.ndarray) -> bool:
    return bool((np.linalg.norm(detection.pixels - truth[names[detection.point_index]], axis=1) < 1.5).all())


def check_found(detection: Detection, target: Target, truth: np.ndarray, exact: bool) -> None:
    """At least 95 % of the points, under their names (or, where not exact, those of the board turned)."""
    check_form(detection, target)
    assert len(detection) >= 0.95 * len(truth), detection.reason
    allowed = [np.arange(len(truth))] if exact else turns(target)
    right = [names for names in allowed if names_right(detection, truth, names)]
    assert right, "points are found under wrong names"
    error = np.linalg.norm(detection.pixels - truth[right[0][detection.point_index]], axis=1)
    assert np.median(error) < 0.1


def test_it_goes_by_its_own_kind(target_kind) -> None:
    assert TARGETS[target_kind].kind == target_kind and target_kind.isidentifier()
    others = [kind.kalibr_kind for kind in TARGETS.values() if kind.kalibr_kind]
    assert len(set(others)) == len(others), "two kinds read Kalibr's files of one type"


def test_a_file_is_read_and_gives_the_name(board, tmp_path) -> None:
    path = tmp_path / "of_mine.yaml"
    path.write_text(yaml.safe_dump(board.keys))
    target = load_target(path)
    assert type(target) is TARGETS[board.keys["type"]] and target.name == "of_mine"
    assert np.array_equal(target.object_points, board.target.object_points)
    path.write_text(yaml.safe_dump({**board.keys, "name": "the_other"}))
    assert load_target(path).name == "the_other"


def test_its_points_lie_apart_on_its_board(target) -> None:
    points = target.object_points
    assert points.ndim == 2 and points.shape[1] == 3 and len(points) >= 4 and points.dtype == float
    assert np.isfinite(points).all() and not points[:, 2].any()
    apart = np.linalg.norm(points[:, None] - points, axis=-1) + np.eye(len(points))
    assert 1e-4 < apart.min() < np.ptp(points) < 50, "metres"
    assert target.disc_radius is None or 0 < target.disc_radius < apart.min() / 2
    artwork = target.artwork()
    for part in (points[:, :2], artwork.quads, artwork.discs[:, :2], artwork.holes[:, :2]):
        assert (part >= artwork.low - 1e-9).all() and (part <= artwork.high + 1e-9).all()
    assert (points[:, :2] > artwork.low).all() and (points[:, :2] < artwork.high).all()
    assert artwork.quads.shape[1:] == (4, 2) and artwork.discs.shape[1:] == artwork.holes.shape[1:] == (3,)
    assert len(artwork.quads) + len(artwork.discs) > 0
    assert pattern(target).prints


def refusal(values: dict) -> str:
    with pytest.raises(InputError) as refused:
        parse_target(values, "board.yaml")
    said = str(refused.value)
    assert said.startswith("board.yaml: ") and "\n" not in said
    return said


def test_a_key_that_it_does_not_know_is_refused(board) -> None:
    assert "colums_of_mine" in refusal({**board.keys, "colums_of_mine": 3})


def test_a_key_that_is_missing_is_named(board) -> None:
    needed = 0
    for key in board.keys:
        rest = {other: value for other, value in board.keys.items() if other != key}
        try:
            parse_target(rest, "board.yaml")
        except InputError:
            assert key in refusal(rest)
            needed += 1
    assert needed >= 2, "a file that says nothing is read"


def test_nonsense_in_any_key_is_refused_in_one_line_or_read(board) -> None:
    for key in board.keys:
        for value in NONSENSE:
            try:
                target = parse_target({**board.keys, key: value}, "board.yaml")
            except InputError as refused:
                assert str(refused).startswith("board.yaml: ") and "\n" not in str(refused), (key, value)
            else:
                assert 0 < len(target.object_points) <= 10**6 and np.isfinite(target.object_points).all(), (key, value)


@pytest.mark.parametrize("number", range(3))
def test_its_points_are_found_under_their_names(target, number) -> None:
    image, truth, pose = seen(target, number)
    detector = detector_of(target)
    before = image.copy()
    check_found(detector.detect(image), target, truth, exact=target.unmistakable)
    check_found(detector.detect_guided(image, CAMERA, pose), target, truth, exact=True)
    assert np.array_equal(image, before)


@pytest.mark.parametrize("quarter", QUARTERS, ids=["0", "90", "180", "270"])
def test_turned_it_keeps_its_names_if_it_says_so(target, quarter) -> None:
    distance = whole_views(target)[0, :3, 3]
    pose = look_pose(target, 0.1, 0.0, float(np.linalg.norm(distance)), 0.1, 0.5, quarter)
    image, truth = render(CAMERA, target, pose, IMAGING), feature_pixels(CAMERA, target, pose)[0]
    check_found(detector_of(target).detect(image), target, truth, exact=target.unmistakable)


@pytest.mark.parametrize("side", range(4))
def test_partly_hidden_no_name_is_wrong(target, side) -> None:
    """A third of the board behind something dark: what is found is right, be it nothing.

    Without an identity, what is seen may be taken for what is hidden; but points are where points are.
    """
    image, truth, _ = seen(target, 1)
    axis, order = side % 2, (1 if side < 2 else -1)
    edge = np.quantile(order * truth[:, axis], 0.33)
    hidden = image.copy()
    columns, rows = np.meshgrid(np.arange(image.shape[1]), np.arange(image.shape[0]))
    hidden[order * (columns, rows)[axis] < edge] = 60
    detection = detector_of(target).detect(hidden)
    check_form(detection, target)
    nearest = np.linalg.norm(detection.pixels[:, None] - truth, axis=-1)
    assert (nearest.min(axis=1) < 1.5).all()
    assert not target.unmistakable or np.array_equal(nearest.argmin(axis=1), detection.point_index)


def test_looking_twice_and_elsewhere_gives_the_same_bits(target) -> None:
    image, _, pose = seen(target, 2)
    elsewhere = pickle.loads(pickle.dumps(target))
    assert type(elsewhere) is type(target) and np.array_equal(elsewhere.object_points, target.object_points)
    looks = []
    for one in (target, target, elsewhere):
        detector = one.detector()
        looks.append([detector.detect(image), detector.detect_guided(image, CAMERA, pose)])
    for first, second in zip(looks[0] * 2, looks[1] + looks[2], strict=True):
        assert np.array_equal(first.point_index, second.point_index)
        assert first.pixels.tobytes() == second.pixels.tobytes()


def test_where_it_is_not_nothing_is_found(target) -> None:
    rng = np.random.default_rng(0)
    images = [np.zeros((300, 400), np.uint8), np.full((300, 400), 255, np.uint8), np.zeros((4, 4), np.uint8)]
    images += [rng.integers(0, 256, (300, 400), dtype=np.uint8), clutter_image(5, (480, 360))]
    away = np.eye(4)
    away[2, 3] = -0.3
    for image in images:
        for found in (detector_of(target).detect(image), detector_of(target).detect_guided(image, CAMERA, away)):
            check_form(found, target)
            assert len(found) == 0 and "\n" not in found.reason


def test_what_is_no_grey_image_is_no_target(target) -> None:
    image = seen(target, 2)[0]
    for other in (cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), image.astype(float), image[:0]):
        found = detector_of(target).detect(other)
        assert len(found) == 0 and found.reason


def test_it_is_printed(board, command, tmp_path) -> None:
    (tmp_path / "board.yaml").write_text(yaml.safe_dump(board.keys))
    ended = command("target", "board.yaml", "--output", "board.svg", "--page", "2000x2000")
    assert ended.code == 0, ended.err
    assert (tmp_path / "board.svg").stat().st_size > 2000
