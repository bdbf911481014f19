"""Every block of Python in README and docs runs as it stands, in a folder that has the files it names."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib import calibrate, save_camera
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.camera.pupils import entrance_pupil_with_derivative
from fisheye_ep_calib.simulation import (
    Imaging,
    SimulatedCamera,
    observe,
    paper_camera,
    paper_poses,
    paper_target,
    simulate_rig,
    views_at,
    write_bag,
)
from fisheye_ep_calib.storage.observation_file import save_observations

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
ELSEWHERE = {
    "consumers": "test_examples.py runs them and looks at what they print",
    "CONTRIBUTING": "a module to be registered, below",
}
SHRINK = 0.35


def blocks(page: Path) -> list[str]:
    return BLOCK.findall(page.read_text("utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """recording.mcap of a small camera, board.yaml, observations.npz, calibration/front.yaml."""
    folder = tmp_path_factory.mktemp("pages")
    large, board = paper_camera(), paper_target()
    size = tuple(round(SHRINK * side) for side in large.image_size)
    shrunk = {name: SHRINK * getattr(large, name) for name in ("fx", "fy", "cx", "cy")}
    camera = replace(large, image_size=size, **shrunk)
    views = views_at(camera, board, paper_poses(board)[::2], Imaging(blur=0.5, noise=1.0))
    write_bag(folder / "recording.mcap", simulate_rig([SimulatedCamera("front", views)], 2.0, 10**18, processes=1))
    (folder / "board.yaml").write_text("type: circle_grid\ncolumns: 11\nrows: 7\nspacing: 0.012\nradius: 0.004\n")
    observations = observe(large, board, paper_poses(board), noise=0.1)
    save_observations(folder / "observations.npz", observations)
    (folder / "calibration").mkdir()
    save_camera(folder / "calibration" / "front.yaml", calibrate(observations, "ep_odd"), "front")
    return folder


@pytest.mark.parametrize(
    "page", [page for page in PAGES if blocks(page) and page.stem not in ELSEWHERE], ids=lambda page: page.stem
)
def test_blocks_of_a_page_run_one_after_the_other(page, folder, tmp_path):
    for name in ("recording.mcap", "board.yaml", "observations.npz", "calibration"):
        (tmp_path / name).symlink_to(folder / name)
    (tmp_path / "page.py").write_text("\n".join(blocks(page)), encoding="utf-8")
    if page.stem == "python":  # which writes there
        (tmp_path / "calibration").unlink()
    done = subprocess.run(
        [sys.executable, "page.py"],
        cwd=tmp_path,
        env={**os.environ, "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_the_pupil_family_that_is_shown_is_one(monkeypatch):
    names: dict = {}
    (source,) = blocks(ROOT / "CONTRIBUTING.md")
    exec(compile(source, "CONTRIBUTING.md", "exec"), names)
    monkeypatch.setitem(PUPIL_FAMILIES, "versine", names["VERSINE"])
    theta, step = np.linspace(0.1, 1.5, 20), 1e-6
    coefficients = np.array([-1e-3, 2e-4])
    pupil, slope = entrance_pupil_with_derivative(names["VERSINE"], theta, coefficients)
    ahead, _ = entrance_pupil_with_derivative(names["VERSINE"], theta + step, coefficients)
    np.testing.assert_allclose((ahead - pupil) / step, slope, rtol=1e-4)
    truth, board = paper_camera(), paper_target()
    found = calibrate(observe(truth, board, paper_poses(board), noise=0.1), "versine")
    assert found.converged and found.camera.model == "versine"
