"""Real photographs: partial boards, small boards, large discs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.target import parse_target


def read_set(folder, numbers=slice(None)):
    reference = np.load(folder / "observations.npz")
    names = [str(name) for name in reference["image_names"]]
    for path in sorted((folder / "images").iterdir())[numbers]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        seen = reference["image_index"] == names.index(path.name) if path.name in names else None
        yield image, (None if seen is None else reference["pixels"][seen]), path.name


def distances(pixels: np.ndarray, reference: np.ndarray) -> np.ndarray:
    nearest = np.linalg.norm(pixels[:, None] - reference, axis=-1).min(axis=1)
    return nearest[nearest < 3]


def test_a_board_never_wholly_in_view(shared_data):
    pytest.importorskip("calib_targets")
    detector = parse_target({"type": "chessboard", "columns": 22, "rows": 22, "spacing": 0.0075}).detector()
    found, errors = [], []
    for image, reference, name in read_set(shared_data / "ov_plane"):
        detection = detector.detect(image)
        assert len(detection) > 100, name
        found.append(len(detection))
        errors.append(distances(detection.pixels, reference))
    assert sum(found) >= 8400
    assert np.median(np.concatenate(errors)) <= 0.15


def test_a_small_chessboard(shared_data):
    pytest.importorskip("calib_targets")
    detector = parse_target({"type": "chessboard", "columns": 6, "rows": 8, "spacing": 0.117}).detector()
    found = [len(detector.detect(image)) for image, _, _ in read_set(shared_data / "urban_fisheye2")]
    assert min(found) >= 40 and sum(found) >= 760


def test_large_discs_in_a_perspective_lens(shared_data):
    detector = parse_target(
        {"type": "circle_grid", "columns": 4, "rows": 3, "spacing": 0.09, "radius": 0.035}
    ).detector()
    found = [len(detector.detect(image)) for image, _, _ in read_set(shared_data / "discocal_left")]
    assert len(found) == 13 and min(found) >= 9 and sum(found) >= 150


def test_without_calib_targets_a_whole_board_is_still_found(shared_data, monkeypatch, caplog):
    from fisheye_ep_calib.target.corners import chessboard_detector

    monkeypatch.setitem(__import__("sys").modules, "calib_targets", None)
    chessboard_detector._calib_targets.cache_clear()
    try:
        detector = parse_target({"type": "chessboard", "columns": 6, "rows": 8, "spacing": 0.117}).detector()
        found = [len(detector.detect(image)) for image, _, _ in read_set(shared_data / "urban_fisheye2")]
        assert sum(number > 40 for number in found) >= 5
        assert sum("calib-targets is not installed" in record.message for record in caplog.records) == 1
    finally:
        chessboard_detector._calib_targets.cache_clear()
