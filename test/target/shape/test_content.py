"""Measured shapes in files: what was written is read, and what cannot be is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from registered_targets import named_target

from fisheye_ep_calib import InputError, load_target
from fisheye_ep_calib.storage.target_file import save_target
from fisheye_ep_calib.target.registry import TARGETS, load_shape, parse_target
from fisheye_ep_calib.target.shape.content import board_content, parse_board, parse_shape, shape_content
from fisheye_ep_calib.target.shape.measured import BoardShape

POINTS = named_target("chessboard")[0].object_points


def some_shape(points: np.ndarray) -> BoardShape:
    rng = np.random.default_rng(0)
    deviation, sigma = rng.normal(0, 2e-4, points.shape), rng.uniform(1e-6, 1e-5, points.shape)
    return BoardShape("free", points, deviation, sigma, True, (2e-5, 2e-5, 1e-5))


@pytest.mark.parametrize("kind", TARGETS)
def test_every_kind_of_target_file_takes_a_measured_shape(kind, tmp_path) -> None:
    target = parse_target(named_target(kind)[1])
    assert target.shape is None
    shape = some_shape(target.object_points)
    file = tmp_path / "boards" / "front.yaml"
    save_target(file, target.keys, shape)
    again = load_target(file)
    assert type(again) is type(target)
    assert np.array_equal(again.object_points, target.object_points)
    assert again.shape is not None and again.shape.bent
    assert np.abs(again.shape.deviation - shape.deviation).max() < 1e-9
    assert np.abs(again.shape.sigma - shape.sigma).max() < 1e-9
    assert load_shape(file).same_target(target.object_points)


def test_a_shape_with_its_points_comes_back() -> None:
    shape = some_shape(POINTS)
    found = parse_board(yaml.safe_load(yaml.safe_dump(board_content(shape))))
    assert found.same_target(POINTS)
    assert found.scatter == pytest.approx(shape.scatter)
    assert np.abs(found.points - shape.points).max() < 2e-9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"deviation": [[0, 0, 0]]}, "rows"),
        ({"deviation": "none"}, "rows"),
        ({"deviation": None}, "deviation"),
        ({"kind": "wavy"}, "kind"),
        ({"bent": "yes"}, "bent"),
        ({"scatter": [1, 2]}, "scatter"),
        ({"sigma": [["x"]]}, "sigma"),
    ],
)
def test_what_cannot_be_a_shape_is_refused_by_its_key(change, words) -> None:
    content = shape_content(some_shape(POINTS)) | change
    with pytest.raises(InputError, match=words):
        parse_shape(content, POINTS)


def test_a_deviation_in_millimetres_or_not_finite_is_refused() -> None:
    content = shape_content(some_shape(POINTS))
    for factor in (1e3, np.nan, np.inf):
        rows = (factor * np.array(content["deviation"])).tolist()
        with pytest.raises(InputError, match="deviation"):
            parse_shape(content | {"deviation": rows}, POINTS)


def test_a_file_without_a_shape_says_so(tmp_path) -> None:
    file = tmp_path / "plain.yaml"
    file.write_text(yaml.safe_dump(named_target("chessboard")[1]))
    with pytest.raises(InputError, match="no shape was measured"):
        load_shape(file)
