"""Target files: this project's keys, Kalibr's keys, and one clear line for whatever is wrong."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.target import load_target, parse_target, shipped
from fisheye_ep_calib.target.boards.charuco import Charuco
from fisheye_ep_calib.target.markers.aruco import MARKERS, aruco_dictionary
from fisheye_ep_calib.target.registry import TARGETS

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "config" / "targets").glob("*.yaml"))
DISCS = {"type": "circle_grid", "columns": 11, "rows": 7, "spacing": 0.012, "radius": 0.004}
needs_aruco = pytest.mark.skipif(not hasattr(cv2, "aruco"), reason="this OpenCV has no aruco")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_files_load_and_lie_on_their_board(path):
    target = load_target(path)
    assert target.name == path.stem
    assert np.all(target.object_points[:, 2] == 0)
    if target.kind in ("charuco", "aprilgrid") and not hasattr(cv2, "aruco"):
        return
    artwork = target.artwork()
    assert (target.object_points[:, :2] > artwork.low).all()
    assert (target.object_points[:, :2] < artwork.high).all()
    assert (artwork.quads >= artwork.low).all() and (artwork.quads <= artwork.high).all()


def test_every_kind_is_shipped():
    assert {load_target(path).kind for path in SHIPPED} == set(TARGETS)


def test_asymmetric_grid_as_opencv_has_it():
    target = parse_target({**DISCS, "columns": 4, "rows": 3, "asymmetric": True, "spacing": 0.02})
    first, second_row = target.object_points[0], target.object_points[4]
    np.testing.assert_allclose(target.object_points[1] - first, [0.04, 0, 0])
    np.testing.assert_allclose(second_row - first, [0.02, 0.02, 0])
    # In the lattice of nearest neighbours they are a step apart.
    steps = np.abs(target.lattice[4] - target.lattice[0]).sum()
    assert steps == 1 and len(np.unique(target.lattice, axis=0)) == 12


def test_kalibr_files():
    board = parse_target(
        {
            "target_type": "checkerboard",
            "targetCols": 6,
            "targetRows": 7,
            "rowSpacingMeters": 0.06,
            "colSpacingMeters": 0.05,
        }
    )
    assert board.kind == "chessboard" and len(board.object_points) == 42
    np.testing.assert_allclose(board.object_points[7], [0.05, 0.06, 0])
    discs = parse_target(
        {
            "target_type": "circlegrid",
            "targetCols": 4,
            "targetRows": 5,
            "spacingMeters": 0.03,
            "asymmetricGrid": True,
        }
    )
    assert discs.disc_radius is None and discs.asymmetric
    tags = parse_target({"target_type": "aprilgrid", "tagCols": 6, "tagRows": 5, "tagSize": 0.088, "tagSpacing": 0.3})
    # Kalibr's order: the corners of a row of tags, from the bottom up.
    np.testing.assert_allclose(tags.object_points[1], [0.088, 0, 0])
    np.testing.assert_allclose(tags.object_points[2], [1.3 * 0.088, 0, 0])
    np.testing.assert_allclose(tags.object_points[12], [0, 0.088, 0])


@pytest.mark.parametrize(
    "change, words",
    [
        ({"spacing": -0.012}, "spacing must be a positive number"),
        ({"spacing": float("nan")}, "spacing must be a positive number"),
        ({"spacing": "wide"}, "spacing must be a positive number"),
        ({"spacing": True}, "spacing must be a positive number"),
        ({"spacing": 12}, "spacing is in metres, and 12 looks like millimetres: write 0.012"),
        ({"radius": 4}, "4 looks like millimetres: write 0.004"),
        ({"radius": 0.0061}, "touch"),
        ({"columns": 0}, "columns must be a whole number"),
        ({"columns": 1.5}, "columns must be a whole number"),
        ({"rows": 10**9}, "rows must be a whole number"),
        ({"type": "hexagons"}, "unknown type 'hexagons'"),
        ({"type": ["circle_grid"]}, "unknown type"),
        ({"spacin": 1}, "did you mean spacing"),
        ({"target_type": "circlegrid"}, "not both"),
        ({"holed": [[11, 0]]}, "no \\[column, row\\]"),
        ({"holed": [[1, 0], [1, 0]]}, "twice"),
        ({"asymmetric": "perhaps"}, "true or false"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(change, words):
    values = {**DISCS, **change}
    with pytest.raises(InputError, match=words) as caught:
        parse_target(values, "board.yaml")
    assert "\n" not in str(caught.value) and "board.yaml" in str(caught.value)


def test_what_is_too_large_for_kalibrs_spacing_or_a_dictionary_is_refused():
    grid = {"target_type": "circlegrid", "targetCols": 4, "targetRows": 5, "spacingMeters": 0.012, "radius": 0.04}
    with pytest.raises(InputError, match="touch"):
        parse_target(grid)
    board = {"type": "charuco", "columns": 12, "rows": 9, "spacing": 0.02, "marker_size": 0.015}
    with pytest.raises(InputError, match="DICT_APRILTAG_16h5 has too few markers for 65"):
        parse_target({**board, "dictionary": "DICT_APRILTAG_16h5"})
    assert parse_target({**board, "dictionary": "DICT_APRILTAG_36h11"}).kind == "charuco"


@pytest.mark.parametrize(
    "keys",
    [
        {"type": "chessboard", "columns": 9, "rows": 6, "spacing": 7.5},
        {"type": "charuco", "columns": 9, "rows": 6, "spacing": 0.02, "marker_size": 7.5},
        {"type": "aprilgrid", "columns": 6, "rows": 5, "tag_size": 7.5, "tag_gap": 0.006},
        {"target_type": "aprilgrid", "tagCols": 6, "tagRows": 5, "tagSize": 7.5, "tagSpacing": 0.3},
        {"target_type": "circlegrid", "targetCols": 6, "targetRows": 5, "spacingMeters": 7.5},
        {
            "target_type": "checkerboard",
            "targetCols": 6,
            "targetRows": 5,
            "rowSpacingMeters": 7.5,
            "colSpacingMeters": 7.5,
        },
    ],
    ids=lambda keys: "-".join(str(value) for value in list(keys.values())[:1]) + "-".join(list(keys)[:1]),
)
def test_millimetres_are_told_in_metres(keys):
    with pytest.raises(InputError, match=r"7\.5 looks like millimetres: write 0\.0075"):
        parse_target(keys)


@pytest.mark.parametrize("key, value", [("type", "checkerboard"), ("type", "CheckerBoard"), ("type", "chess_board")])
def test_a_chessboard_by_any_name(key, value):
    assert parse_target({key: value, "columns": 9, "rows": 6, "spacing": 0.02}).kind == "chessboard"


@needs_aruco
@pytest.mark.parametrize(
    "name", ["DICT_APRILTAG_36H11", "cv2.aruco.DICT_APRILTAG_36h11", "aruco::DICT_APRILTAG_36h11", "APRILTAG_36h11"]
)
def test_dictionaries_by_opencvs_names(name):
    board = parse_target(
        {"type": "charuco", "columns": 5, "rows": 4, "spacing": 0.02, "marker_size": 0.01, "dictionary": name}
    )
    assert board.dictionary == "DICT_APRILTAG_36h11"
    assert len(board.tag_bits) == 15


@needs_aruco
@pytest.mark.parametrize("name, count", MARKERS.items())
def test_the_dictionaries_are_as_large_as_opencvs(name, count):
    if not hasattr(cv2.aruco, name):
        pytest.skip("this OpenCV does not know it yet")
    assert len(aruco_dictionary(name, "a test").bytesList) == count


@needs_aruco
def test_kalibrs_code_offset_and_the_first_tag():
    kalibr = {"target_type": "aprilgrid", "tagCols": 6, "tagRows": 5, "tagSize": 0.02, "tagSpacing": 0.3}
    own = {"type": "aprilgrid", "columns": 6, "rows": 5, "tag_size": 0.02, "tag_gap": 0.006}
    plain = parse_target(own)
    for keys in ({**kalibr, "codeOffset": 48}, {**kalibr, "first_tag": 48}, {**own, "first_tag": 48}):
        later = parse_target(keys)
        assert later.first_tag == 48
        np.testing.assert_array_equal(later.object_points, plain.object_points)
        assert not np.array_equal(later.tag_bits, plain.tag_bits)
    assert parse_target({**kalibr, "codeOffset": 0}).first_tag == 0
    with pytest.raises(InputError, match="first_tag must be a whole number from 0 to 557, not 558"):
        parse_target({**own, "first_tag": 558})


def test_a_bare_name_finds_a_shipped_target(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_target("chessboard_9x6").columns == 9
    assert load_target(Path("chessboard_9x6.yaml")).columns == 9
    Path("chessboard_9x6.yaml").write_text("type: chessboard\ncolumns: 4\nrows: 3\nspacing: 0.02\n")
    assert load_target("chessboard_9x6.yaml").columns == 4  # one's own comes first
    with pytest.raises(InputError, match="shipped, by name: aprilgrid_6x5, "):
        load_target("chessboard_9x7")
    with pytest.raises(InputError, match="cannot read"):
        load_target("elsewhere/chessboard_9x6")


def test_shipped_targets_are_found_where_they_are_installed(tmp_path, monkeypatch):
    module = tmp_path / "lib" / "python3" / "site-packages" / "fisheye_ep_calib" / "target" / "shipped.py"
    folder = tmp_path / "share" / "fisheye_ep_calib" / "config" / "targets"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("type: chessboard\n")
    monkeypatch.setattr(shipped, "__file__", str(module))
    shipped.shipped_folder.cache_clear()
    try:
        assert shipped.shipped_files() == {"mine": folder / "mine.yaml"}
    finally:
        shipped.shipped_folder.cache_clear()


@pytest.mark.parametrize("missing", ["type", "columns", "rows", "spacing", "radius"])
def test_a_missing_key_is_named(missing):
    with pytest.raises(InputError, match=missing):
        parse_target({key: value for key, value in DISCS.items() if key != missing})


@pytest.mark.parametrize("text", ["", "just words", "a: [1", "- 1\n- 2", "\x00", "a: &a [*a]"])
def test_files_that_are_no_target(tmp_path, text):
    path = tmp_path / "t.yaml"
    path.write_text(text)
    with pytest.raises(InputError):
        load_target(path)


def test_unreadable_files(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        load_target(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match="cannot read"):
        load_target(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(bytes(range(128, 256)))
    with pytest.raises(InputError):
        load_target(tmp_path / "binary.yaml")


@needs_aruco
@pytest.mark.parametrize("columns, rows, legacy", [(5, 4, False), (5, 4, True), (4, 5, True), (5, 5, True)])
def test_charuco_print_is_opencvs(columns, rows, legacy):
    target = Charuco.create("c", columns, rows, 0.04, 0.03, "DICT_5X5_100", legacy)
    board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), 0.04, 0.03, aruco_dictionary("DICT_5X5_100", "a test"))
    board.setLegacyPattern(legacy)
    side = 56
    theirs = board.generateImage(((columns + 1) * side, (rows + 1) * side), marginSize=0)
    ours = np.full(theirs.shape, 255, np.uint8)
    for quad in np.rint((target.artwork().quads + 0.04) / 0.04 * side).astype(int):
        (left, top), (right, bottom) = quad.min(axis=0), quad.max(axis=0)
        ours[top:bottom, left:right] = 0
    assert np.array_equal(ours, theirs)


def test_aruco_targets_say_what_is_missing(monkeypatch):
    monkeypatch.delattr(cv2, "aruco", raising=False)
    for path in SHIPPED:
        target = load_target(path)
        if target.kind in ("charuco", "aprilgrid"):
            with pytest.raises(InputError, match=r"needs cv2.aruco.*pip install"):
                target.detector()


def test_a_circle_grid_without_a_radius_is_told_to_be_biased(caplog):
    keys = {"target_type": "circlegrid", "targetCols": 6, "targetRows": 5, "spacingMeters": 0.018}
    parse_target(keys, "kalibr.yaml")
    assert ["kalibr.yaml" in record.message and "add radius" in record.message for record in caplog.records] == [True]
    caplog.clear()
    assert parse_target({**keys, "radius": 0.006}).disc_radius == 0.006
    assert not caplog.records
