"""Real processes over real DDS: a domain of its own for each test, and everything ended afterwards."""

from __future__ import annotations

import fcntl
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install '.[ros]'")
from known_scenes import half_size  # noqa: E402
from live_processes import Probe, Program  # noqa: E402

from fisheye_ep_calib.camera import FisheyeCamera  # noqa: E402
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target, render  # noqa: E402

LARGE_IMAGES = Path(__file__).resolve().parents[2] / "config" / "fastdds_large_images.xml"
PUBLISHER = Path(__file__).with_name("image_publisher.py")


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A domain id that no other run of these tests uses at the time, nor is a robot likely to; in the environment."""
    number, lock = _free_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(LARGE_IMAGES))
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.environ.get("AMENT_PREFIX_PATH", sys.prefix))
    yield number
    lock.close()


def _free_domain() -> tuple[int, IO[str]]:
    """A domain id, and a file that holds it until it is closed."""
    first = os.getpid() * 31 + time.monotonic_ns()
    for number in (20 + (first + step) % 80 for step in range(80)):
        lock = (Path(tempfile.gettempdir()) / f"ros_domain_{number}_{os.getuid()}").open("w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        return number, lock
    raise RuntimeError("every domain id is in use")


@pytest.fixture
def probe(domain: int) -> Iterator[Probe]:
    probe = Probe(domain)
    yield probe
    probe.close()


@pytest.fixture
def start(domain: int) -> Iterator[Callable[..., Program]]:
    """Starts programs and ends them after the test."""
    programs: list[Program] = []

    def begin(*command: str, **environment: str) -> Program:
        programs.append(Program([str(part) for part in command], **environment))
        return programs[-1]

    yield begin
    for program in programs:
        program.end()


@pytest.fixture
def start_calibrator(start: Callable[..., Program]) -> Callable[..., Program]:
    """Starts the node with parameters given as ``name: value``."""

    def begin(*arguments: str, **parameters: Any) -> Program:
        command = [sys.executable, "-m", "fisheye_ep_calib.ros.calibrator", "--ros-args", *arguments]
        for name, value in parameters.items():
            command += ["-p", f"{name.replace('__', '.')}:={value}"]
        return start(*command)

    return begin


@pytest.fixture
def start_publisher(start: Callable[..., Program]) -> Callable[..., Program]:
    return lambda *arguments: start(sys.executable, str(PUBLISHER), *[str(value) for value in arguments])


@pytest.fixture(scope="session")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 images (1024²) of the paper's target through half the paper's camera, as an .npz with the key ``images``."""
    return _rendered(half_size(paper_camera()), tmp_path_factory.mktemp("rendered") / "images.npz")


@pytest.fixture(scope="session")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same through the paper's camera itself, 2048²: more than a slow machine looks at."""
    return _rendered(paper_camera(), tmp_path_factory.mktemp("large") / "images.npz")


def _rendered(camera: FisheyeCamera, path: Path) -> Path:
    target = paper_target()
    np.savez(path, images=np.stack([render(camera, target, pose) for pose in paper_poses(target)[:12]]))
    return path
