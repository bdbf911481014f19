"""A folder of small images of the shipped circle grid, rendered once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from fisheye_ep_calib.simulation import Imaging, paper_camera, paper_poses, render
from fisheye_ep_calib.target import load_target

VIEWS = 9


@pytest.fixture(scope="session")
def true_camera():
    """The paper's camera with a sixteenth of the pixels."""
    camera = paper_camera()
    smaller = {name: getattr(camera, name) / 4 for name in ("fx", "fy", "skew")}
    return replace(camera, image_size=(512, 512), cx=(camera.cx - 1.5) / 4, cy=(camera.cy - 1.5) / 4, **smaller)


@pytest.fixture(scope="session")
def images(true_camera, tmp_path_factory) -> Path:
    """The folder front/ with nine images."""
    folder = tmp_path_factory.mktemp("images") / "front"
    folder.mkdir()
    target = load_target("circle_grid_11x7")
    for number, pose in enumerate(paper_poses(target)[:: 25 // VIEWS][:VIEWS]):
        picture = render(true_camera, target, pose, Imaging(noise=1, blur=0.6, seed=number))
        cv2.imwrite(str(folder / f"{number:02d}.png"), picture)
    return folder
