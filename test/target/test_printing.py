"""Prints are true to scale: what a detector finds in the picture lies where the target file says."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.target import load_target
from fisheye_ep_calib.target.circle_grid import CircleGrid
from fisheye_ep_calib.target.printing import DOTS_PER_MM, lay_out, ruler_lines, write_target

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "config" / "targets").glob("*.yaml"))


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def target(request):
    target = load_target(request.param)
    if target.kind in ("charuco", "aprilgrid") and not hasattr(cv2, "aruco"):
        pytest.skip("this OpenCV has no aruco")
    return target


def test_the_png_is_found_and_to_scale(target, tmp_path):
    path = tmp_path / "print.png"
    write_target(target, path)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    detection = target.detector().detect(image)
    assert len(detection) == len(target.object_points)
    metres = target.object_points[detection.point_index, :2]
    design = np.column_stack([metres, np.ones(len(metres))])
    scale = np.linalg.lstsq(design, detection.pixels, rcond=None)[0]
    lengths = np.linalg.norm(scale[:2], axis=1) / (1000 * DOTS_PER_MM)
    np.testing.assert_allclose(lengths, 1, atol=2e-4)
    assert np.abs(design @ scale - detection.pixels).max() < 0.3


def test_svg_and_pdf_hold_every_shape(target, tmp_path):
    artwork = target.artwork()
    write_target(target, tmp_path / "t.svg")
    svg = (tmp_path / "t.svg").read_text()
    assert svg.count("<polygon") == len(artwork.quads)
    assert svg.count("<circle") == len(artwork.discs) + len(artwork.holes)
    assert f"{target.name}.yaml" in svg
    write_target(target, tmp_path / "t.pdf")
    pdf = (tmp_path / "t.pdf").read_bytes()
    stream = re.search(rb"stream\n(.*?)\nendstream", pdf, re.DOTALL)
    drawing = zlib.decompress(stream.group(1)).decode("cp1252")
    assert drawing.count(" f\n") == len(artwork.quads) + len(artwork.discs) + len(artwork.holes)
    assert f"{target.name}.yaml" in drawing


def test_the_ruler_is_100_mm(target):
    first, last = ruler_lines(lay_out(target, "a4", "t"))[0]
    assert last[0] - first[0] == pytest.approx(100)
    assert last[1] == first[1]


def test_what_does_not_fit_is_refused(tmp_path):
    large = CircleGrid.create("wall", 11, 7, spacing=0.05, radius=0.015)
    with pytest.raises(InputError, match="does not fit on a4"):
        write_target(large, tmp_path / "t.pdf")
    assert not (tmp_path / "t.pdf").exists()
    write_target(large, tmp_path / "t.pdf", page="800x600")
    assert (tmp_path / "t.pdf").stat().st_size > 1000


@pytest.mark.parametrize("page", ["b5", "10x10", "-5x300", "1e9x3", "nanxnan", ""])
def test_unknown_pages(tmp_path, page):
    small = CircleGrid.create("t", 4, 3, spacing=0.01, radius=0.003)
    with pytest.raises(InputError):
        write_target(small, tmp_path / "t.pdf", page=page)


def test_unknown_format(tmp_path):
    with pytest.raises(InputError, match="must end in"):
        write_target(CircleGrid.create("t", 4, 3, 0.01, 0.003), tmp_path / "t.doc")
