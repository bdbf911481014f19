"""A live calibrator without ROS, shown the images of an .npz over and over until its process is killed.

python endless_camera.py IMAGES.npz FOLDER
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

import numpy as np
from test_calibrator import Listener, message, settings

from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.settings import Limits, Tuning
from fisheye_ep_calib.planning.view_selection import Novelty


def main(images_file: str, folder: str) -> None:
    def say(text: str) -> None:
        print(text, flush=True)

    every_view = Limits(Novelty(0.0, 0.0, 0.0), maximum_views=1000)
    live = LiveCalibrator(
        settings(Path(folder), "front"), Tuning(minimum_views=5, limits=every_view), Announcer(say, say), Listener()
    )
    messages = [message(image) for image in np.load(images_file)["images"]]
    for turn in itertools.count():
        live.offer("front", messages[turn % len(messages)], f"{time.time_ns()}")
        time.sleep(0.03)


if __name__ == "__main__":
    main(*sys.argv[1:])
