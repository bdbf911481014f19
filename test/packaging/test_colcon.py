"""A colcon workspace with this package in it builds, and what it installs runs from there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PARTS = "config fisheye_ep_calib launch resource package.xml setup.py setup.cfg".split()


def run(command: list[str], folder: Path, **environment: str) -> str:
    """Standard output of a command that must succeed, with this environment's programs first on the path."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": path, **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace whose src/ holds a copy of this package, built."""
    workspace = tmp_path_factory.mktemp("workspace")
    source = workspace / "src" / "fisheye_ep_calib"
    source.mkdir(parents=True)
    for part in PARTS:
        origin = REPOSITORY / part
        if origin.is_dir():
            shutil.copytree(origin, source / part, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(origin, source / part)
    run(["colcon", "build", "--event-handlers", "console_direct-"], workspace)
    return workspace


def test_colcon_sees_an_ament_python_package(workspace: Path) -> None:
    assert "(ros.ament_python)" in run(["colcon", "list"], workspace)


@pytest.mark.parametrize("executable", ["fisheye_ep_calib", "calibrate_bag"])
def test_installed_executable_starts_from_the_install_space(workspace: Path, executable: str) -> None:
    installed = workspace / "install" / "fisheye_ep_calib"
    program = installed / "lib" / "fisheye_ep_calib" / executable
    help_text = run(["bash", "-c", f". install/local_setup.bash && {program} --help"], workspace)
    assert "usage" in help_text.lower()
    code = "import fisheye_ep_calib; print(fisheye_ep_calib.__file__)"
    loaded = run(["bash", "-c", f". install/local_setup.bash && {sys.executable} -c '{code}'"], workspace)
    assert str(installed) in loaded


def test_everything_a_ros_user_looks_for_is_installed(workspace: Path) -> None:
    installed = workspace / "install" / "fisheye_ep_calib"
    share = installed / "share" / "fisheye_ep_calib"
    programs = {path.name for path in (installed / "lib" / "fisheye_ep_calib").iterdir()}
    assert {"fisheye_ep_calib", "calibrator", "rectifier", "calibrate_bag"} <= programs
    assert list(installed.rglob("report/templates/*.html"))
    assert (installed / "share/ament_index/resource_index/packages/fisheye_ep_calib").is_file()
    assert (share / "package.xml").is_file()
    for node in ["calibrator", "rectifier"]:
        assert (share / "config" / f"{node}.yaml").is_file() and (share / "launch" / f"{node}.launch.py").is_file()
    targets = sorted(path.name for path in (REPOSITORY / "config/targets").glob("*.yaml"))
    assert sorted(path.name for path in (share / "config/targets").glob("*.yaml")) == targets
