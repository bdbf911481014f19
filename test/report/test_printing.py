"""Prints are true to scale: what a detector finds in the picture lies where the target file says."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.report.printing import DOTS_PER_MM, lay_out, ruler_bars, write_target
from fisheye_ep_calib.target import load_target
from fisheye_ep_calib.target.boards.circle_grid import CircleGrid

SHIPPED = sorted((Path(__file__).resolve().parents[2] / "config" / "targets").glob("*.yaml"))


@pytest.fixture(params=SHIPPED, ids=lambda path: path.stem)
def target(request):
    target = load_target(request.param)
    if target.kind in ("charuco", "aprilgrid") and not hasattr(cv2, "aruco"):
        pytest.skip("this OpenCV has no aruco")
    return target


def check_scale(target, image: np.ndarray, dots: float = 0.1) -> None:
    """Whether the detector finds all of the target in a print of 300 dots per inch, to within ``dots``."""
    detection = target.detector().detect(image)
    assert len(detection) == len(target.object_points)
    metres = target.object_points[detection.point_index, :2]
    design = np.column_stack([metres, np.ones(len(metres))])
    scale = np.linalg.lstsq(design, detection.pixels, rcond=None)[0]
    lengths = np.linalg.norm(scale[:2], axis=1) / (1000 * DOTS_PER_MM)
    np.testing.assert_allclose(lengths, 1, atol=5e-3 * dots)
    assert np.abs(design @ scale - detection.pixels).max() < dots


def ruler_length(image: np.ndarray) -> float:
    """Of the longest dark line in the page's lowest centimetre and a half, mm."""
    foot = image[-round(15 * DOTS_PER_MM) :] < 160
    row = foot[np.argmax(foot.sum(axis=1))]
    dark = np.flatnonzero(row)
    return (dark[-1] - dark[0] + 1) / DOTS_PER_MM


def test_the_png_is_found_and_to_scale(target, tmp_path):
    path = tmp_path / "print.png"
    write_target(target, path)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    check_scale(target, image)
    assert ruler_length(image) == pytest.approx(100, abs=0.05)
    content = path.read_bytes()
    resolution = content[content.index(b"pHYs") + 4 :][:9]
    assert resolution == (11811).to_bytes(4, "big") * 2 + b"\x01"  # dots per metre


def test_the_pdf_is_found_and_to_scale(target, tmp_path):
    path = tmp_path / "print.pdf"
    write_target(target, path)
    assert f"{target.name}.yaml".encode("utf-16-be") in path.read_bytes()  # the document's title
    tool = shutil.which("pdftoppm")
    if tool is None:
        pytest.skip("pdftoppm, of poppler-utils, is not here")
    subprocess.run([tool, "-r", "300", "-gray", "-singlefile", path, tmp_path / "page"], check=True)
    image = cv2.imread(str(tmp_path / "page.pgm"), cv2.IMREAD_GRAYSCALE)
    check_scale(target, image, dots=0.3)  # poppler moves edges to whole dots
    assert ruler_length(image) == pytest.approx(100, abs=0.05)


def test_the_svg_holds_every_shape(target, tmp_path):
    write_target(target, tmp_path / "t.svg")
    svg = (tmp_path / "t.svg").read_text(encoding="utf-8")
    size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt" viewBox="0 0 ([\d.]+) ([\d.]+)"', svg)
    points = np.array([float(number) for number in size.groups()])
    assert (points[:2] == points[2:]).all()
    layout = lay_out(target, "a4", "t")
    np.testing.assert_allclose(points[:2] * 25.4 / 72, [layout.width, layout.height], atol=0.01)
    assert f"{target.name}.yaml" in svg
    outlines = " ".join(re.findall(r'\bd="([^"]*)"', svg))
    corners = np.array(re.findall(r"[ML] (-?[\d.]+) (-?[\d.]+)", outlines), dtype=float) * 25.4 / 72
    for wanted in layout.quads.reshape(-1, 2):
        assert np.abs(corners - wanted).max(axis=1).min() < 1e-3


def test_the_same_target_gives_the_same_file(tmp_path):
    target = CircleGrid.create("t", 4, 3, spacing=0.01, radius=0.003)
    for kind in ("pdf", "svg", "png"):
        paths = [tmp_path / f"{number}.{kind}" for number in range(2)]
        for path in paths:
            write_target(target, path)
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_a_users_settings_do_not_move_the_print(tmp_path):
    target = CircleGrid.create("$t$", 11, 7, spacing=0.012, radius=0.004)
    with matplotlib.rc_context({"savefig.bbox": "tight", "savefig.dpi": 50, "figure.autolayout": True}):
        write_target(target, tmp_path / "t.png")
    image = cv2.imread(str(tmp_path / "t.png"), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (2480, 3507) or image.shape == (3507, 2480)
    check_scale(target, image)


def test_printing_and_figures_alone_need_matplotlib():
    modules = (
        "fisheye_ep_calib.report.printing, fisheye_ep_calib.commands.target, fisheye_ep_calib.report.from_calibration"
    )
    code = f"import sys, {modules}; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_ruler_is_100_mm(target):
    bars = ruler_bars(lay_out(target, "a4", "t"))
    assert np.ptp(bars[..., 0]) == pytest.approx(100)  # from tip to tip
    assert np.ptp(bars[0, :, 0]) == pytest.approx(100)


def test_what_does_not_fit_is_refused(tmp_path):
    large = CircleGrid.create("wall", 11, 7, spacing=0.05, radius=0.015)
    with pytest.raises(InputError, match="does not fit on a4"):
        write_target(large, tmp_path / "t.pdf")
    assert not (tmp_path / "t.pdf").exists()
    write_target(large, tmp_path / "t.pdf", page="800x600")
    assert (tmp_path / "t.pdf").stat().st_size > 1000


@pytest.mark.parametrize("page", ["b5", "10x10", "100x300", "-5x300", "1e9x3", "nanxnan", ""])
def test_unknown_pages(tmp_path, page):
    small = CircleGrid.create("t", 4, 3, spacing=0.01, radius=0.003)
    with pytest.raises(InputError):
        write_target(small, tmp_path / "t.pdf", page=page)


def test_a_picture_of_a_wall_is_refused(tmp_path):
    with pytest.raises(InputError, match="too large; take .pdf or .svg"):
        write_target(CircleGrid.create("t", 4, 3, 0.01, 0.003), tmp_path / "t.png", page="5000x5000")


def test_unknown_format(tmp_path):
    with pytest.raises(InputError, match="must end in"):
        write_target(CircleGrid.create("t", 4, 3, 0.01, 0.003), tmp_path / "t.doc")
