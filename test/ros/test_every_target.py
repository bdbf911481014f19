"""Every registered kind of target before the live node: images over DDS, a camera near the true one."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from registered_targets import CAMERA, check_near_truth, imaging, named_target, spread_views
from std_srvs.srv import Trigger

from fisheye_ep_calib import load_camera
from fisheye_ep_calib.simulation import render
from fisheye_ep_calib.target.registry import TARGETS

pytestmark = [pytest.mark.live, pytest.mark.slow]
VIEWS = 13  # a prime: whoever takes only every second, third or fourth frame of the loop still sees each of them


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "kind" in metafunc.fixturenames:
        own = [kind for kind, target in TARGETS.items() if target.__module__.startswith("fisheye_ep_calib.")]
        metafunc.parametrize("kind", own)  # the node is a process of its own: it knows what the package registers


def test_images_of_it_become_a_camera(start_calibrator, start_publisher, probe, tmp_path, kind) -> None:
    target, keys = named_target(kind)
    file, images = tmp_path / "board.yaml", tmp_path / "images.npz"
    file.write_text(yaml.safe_dump(keys))
    views = enumerate(spread_views(target, VIEWS))
    np.savez(images, images=np.stack([render(CAMERA, target, pose, imaging(i)) for i, pose in views]))
    calibrator = start_calibrator(
        cameras="[front]", target=file, output_directory=tmp_path, auto_calibrate="false", model="ep_even"
    )
    start_publisher(images, 3, "/front/image_raw")
    calibrator.wait_to_say("view 10 kept")
    answer = probe.call(Trigger, "/calibrator/calibrate")
    assert answer.success, answer.message
    check_near_truth(load_camera(tmp_path / "front.yaml"))
    assert calibrator.interrupt()[0] == 0 and "Traceback" not in calibrator.output
