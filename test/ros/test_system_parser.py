"""A camera file in ROS's own C++ reader, camera_calibration_parsers, from Debian's package."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.camera.camera_info import plain_camera_info
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target
from fisheye_ep_calib.simulation.truth import feature_pixels
from fisheye_ep_calib.storage.camera_file import save_camera

SYSTEM_PYTHON = "/usr/bin/python3"
READ = """
import json, sys
from camera_calibration_parsers import readCalibration
name, info = readCalibration(sys.argv[1])
print(json.dumps([name, info.width, info.height, info.distortion_model, info.D, info.K, info.R, info.P]))
"""


def system_reader(*arguments: str) -> subprocess.CompletedProcess:
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "LD_LIBRARY_PATH")}
    command = [SYSTEM_PYTHON, "-c", READ, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)


def has_reader() -> bool:
    if not Path(SYSTEM_PYTHON).exists():
        return False
    command = [SYSTEM_PYTHON, "-c", "import camera_calibration_parsers"]
    return subprocess.run(command, capture_output=True, timeout=60).returncode == 0


@pytest.mark.skipif(not has_reader(), reason="install Debian's python3-camera-calibration-parsers")
def test_every_field_arrives_in_the_reader_of_ros(tmp_path: Path) -> None:
    camera, target = paper_camera(), paper_target()
    pixels, seen = feature_pixels(camera, target, paper_poses(target))
    seen &= ((pixels > 0) & (pixels < 2047)).all(axis=-1)
    image_index, point_index = np.nonzero(seen)
    observations = Observations.create(
        target.object_points,
        image_index,
        point_index,
        pixels[seen],
        camera.image_size,
        disc_radius=target.disc_radius,
    )
    result = calibrate(observations, model="ep_odd")
    path = tmp_path / "front.yaml"
    save_camera(path, result, "front")
    assert "entrance_pupil" in yaml.safe_load(path.read_text())

    done = system_reader(str(path))
    assert done.returncode == 0, done.stderr
    name, width, height, model, d, k, r, p = json.loads(done.stdout)
    info = plain_camera_info(result.stand_in.camera)
    assert (name, width, height, model) == ("front", info.width, info.height, info.distortion_model)
    for read, written in ((d, info.d), (k, info.k), (r, info.r), (p, info.p)):
        np.testing.assert_allclose(read, written, rtol=1e-12, atol=1e-15)
