"""Images of kept views: one file for each, whatever the driver calls them."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.frame import RawFrame
from fisheye_ep_calib.live.kept_images import KeptImages


def frame(grey: int, name: str) -> RawFrame:
    data = np.full((8, 10), grey, np.uint8).tobytes()
    message = SimpleNamespace(height=8, width=10, encoding="mono8", is_bigendian=0, step=10, data=data)
    return RawFrame.from_message(message, name)


def test_images_of_the_same_name_are_kept_beside_each_other(tmp_path: Path) -> None:
    images = KeptImages(tmp_path, True, Announcer(print, print))
    for grey, name in ((10, "0.0"), (20, "0.0"), (30, "1.0"), (40, "0.0")):
        images.offer("front", frame(grey, name))
        images.keep("front", name)
    kept = {path.name: int(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[0, 0]) for path in tmp_path.rglob("*.png")}
    assert kept == {"0.0.png": 10, "0.0_2.png": 20, "1.0.png": 30, "0.0_3.png": 40}


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan, 3e38])
def test_a_pixel_that_is_no_number_costs_the_others_nothing(tmp_path: Path, bad: float) -> None:
    scene = np.linspace(0.25, 0.75, 40 * 60, dtype="<f4").reshape(40, 60)
    hot = scene.copy()
    hot[20, 30] = bad
    images = KeptImages(tmp_path, True, Announcer(print, print))
    images.offer("front", RawFrame("0.0", hot.tobytes(), height=40, width=60, encoding="32FC1", step=240))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        images.keep("front", "0.0")
    kept = cv2.imread(str(tmp_path / "images" / "front" / "0.0.png"), cv2.IMREAD_UNCHANGED).astype(float)
    others = hot == scene
    slope, offset = np.polyfit(scene[others], kept[others], 1)
    assert slope * 0.5 > 20000
    assert np.abs(slope * scene + offset - kept)[others].max() < 1


def test_where_nothing_is_wanted_nothing_is_stored(tmp_path: Path) -> None:
    images = KeptImages(tmp_path, False, Announcer(print, print))
    images.offer("front", frame(10, "0.0"))
    images.keep("front", "0.0")
    assert list(tmp_path.iterdir()) == []
