"""What the documentation shows works as it says."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib import FisheyeCamera, calibrate, load_camera, save_camera
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses
from fisheye_ep_calib.target.boards.chessboard import Chessboard

DOCS = Path(__file__).resolve().parents[2] / "docs"
CODE_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
OUTPUT_BLOCK = re.compile(r"^```text\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def consumers(tmp_path_factory):
    """The names that the code blocks of consumers.md leave behind, and what they print."""
    folder = tmp_path_factory.mktemp("consumers")
    blocks = CODE_BLOCK.findall((DOCS / "consumers.md").read_text(encoding="utf-8"))
    names: dict = {}
    printed: list[str] = []
    names["print"] = lambda text: printed.append(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in blocks:
            exec(compile(block, "consumers.md", "exec"), names)
    return names, printed


def test_rays_go_through_the_points_that_were_projected(consumers):
    names, _ = consumers
    np.testing.assert_array_equal(names["valid"], [True, True, False])
    assert names["missed_by"].max() < 1e-9


def test_triangulated_length_is_right_with_the_pupil_and_wrong_without(consumers):
    names, _ = consumers
    assert names["with_pupil"] < 0.1
    assert names["one_viewpoint"] > 5 * names["with_pupil"]


def test_printed_output_is_what_the_page_shows(consumers):
    _, printed = consumers
    shown = OUTPUT_BLOCK.findall((DOCS / "consumers.md").read_text(encoding="utf-8"))
    number = re.compile(r"\d+\.\d+")
    for line, expected in zip(printed, shown, strict=True):
        assert number.sub("#", line) == number.sub("#", expected.strip())
        values = [[float(value) for value in number.findall(text)] for text in (line, expected)]
        np.testing.assert_allclose(*values, rtol=0.1, atol=0.002)


def test_opencv_agrees_with_the_stand_in_within_the_stated_loss(consumers):
    names, _ = consumers
    assert names["difference_px"].max() < 3 * names["losses"][10.0]
    assert names["losses"][0.1] > names["losses"][1.0] > names["losses"][10.0]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The compiled C++ example."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no g++ to compile docs/examples/project.cpp with")
    program = tmp_path_factory.mktemp("cpp") / "project"
    source = DOCS / "examples" / "project.cpp"
    subprocess.run([compiler, "-std=c++17", "-O1", "-Wall", "-Werror", "-o", program, source], check=True, timeout=120)
    return program


def run_project(program: Path, camera_file: Path, points: np.ndarray) -> np.ndarray:
    text = "\n".join(" ".join(repr(float(value)) for value in point) for point in points)
    done = subprocess.run([program, camera_file], input=text, capture_output=True, text=True, check=True, timeout=60)
    return np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.parametrize("model", ["kannala", "gennery", "ep_odd", "ep_even"])
def test_cpp_example_projects_like_python(project, tmp_path, model):
    board = Chessboard.create("board", 11, 7, spacing=0.012)
    truth = paper_camera()
    kannala = FisheyeCamera(
        truth.image_size, truth.fx, truth.fy, truth.cx, truth.cy, radial=truth.radial, theta_max=truth.theta_max
    )
    observations = observe(kannala if model == "kannala" else truth, board, paper_poses(board), noise=0.05)
    path = tmp_path / "front.yaml"
    save_camera(path, calibrate(observations, model, tangential=True), "front")
    camera = load_camera(path)

    rng = np.random.default_rng(0)
    points = rng.normal(size=(2000, 3))
    points *= rng.uniform(0.05, 2.0, (2000, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    points[0] = [0, 0, 0.5]
    pixels, valid = camera.project(points)
    found = run_project(project, path, points)
    np.testing.assert_array_equal(found[:, 2].astype(bool), valid)
    assert 500 < valid.sum() < 1500
    np.testing.assert_allclose(found[valid, :2], pixels[valid], atol=1e-5)


def test_cpp_example_refuses_what_is_no_camera_file(project, tmp_path):
    path = tmp_path / "empty.yaml"
    path.write_text("image_width: 10\n", encoding="utf-8")
    done = subprocess.run([project, path], input="0 0 1", capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "entrance_pupil" in done.stderr


PAGES = sorted([*DOCS.parent.glob("*.md"), *DOCS.glob("*.md")])


def links(page: Path) -> list[tuple[str, str]]:
    """Path and anchor of each link that stays in the repository."""
    found = re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8"))
    return [link.partition("#")[::2] for link in found if not re.match(r"\w+:", link)]


def anchors(page: Path) -> set[str]:
    """What GitHub names the headings of a page."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    dead = []
    for path, anchor in links(page):
        place = page.parent / path if path else page
        if not place.exists() or (anchor and anchor not in anchors(place)):
            dead.append(f"{path}#{anchor}")
    assert not dead
