"""Images of kept views: one file for each, whatever the driver calls them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

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


def test_where_nothing_is_wanted_nothing_is_stored(tmp_path: Path) -> None:
    images = KeptImages(tmp_path, False, Announcer(print, print))
    images.offer("front", frame(10, "0.0"))
    images.keep("front", "0.0")
    assert list(tmp_path.iterdir()) == []
