"""package.xml and setup.py: what colcon, rosdep and pip read."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import subprocess
import sys
from pathlib import Path

import yaml
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package

import fisheye_ep_calib

REPOSITORY = Path(__file__).resolve().parents[2]


def test_package_xml_is_accepted_and_complete() -> None:
    warnings: list[str] = []
    package = parse_package(str(REPOSITORY / "package.xml"), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    assert package.package_format == 3
    assert package.get_build_type() == "ament_python"
    wanted = {f"python3-{name}" for name in ("numpy", "scipy", "opencv", "yaml")}
    wanted |= {"rclpy", "sensor_msgs", "std_msgs", "std_srvs", "diagnostic_msgs"}
    assert wanted <= {dependency.name for dependency in package.exec_depends}


def test_every_import_is_declared_or_named_as_having_no_rosdep_key() -> None:
    apt = {"cv2": "opencv", "yaml": "yaml", "markupsafe": "jinja2"}  # markupsafe is a part of jinja2
    text = (REPOSITORY / "package.xml").read_text("utf-8")
    without_key = set(re.findall(r"[\w-]+", re.search(r"Without a rosdep key.*?:(.*?)\. -->", text, re.DOTALL)[1]))
    declared = {dependency.name for dependency in parse_package(str(REPOSITORY / "package.xml")).exec_depends}
    found = set()
    for path in (REPOSITORY / "fisheye_ep_calib").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found |= {str(name).partition(".")[0] for name in names}
    foreign = found - set(sys.stdlib_module_names) - {"fisheye_ep_calib", *without_key}
    assert {"numpy", "rclpy"} <= foreign
    assert not {name for name in foreign if not {name, f"python3-{apt.get(name, name)}"} & declared}


def test_one_version_everywhere() -> None:
    """package.xml's. What installs or cites the package reads it or is compared with it here."""
    version = parse_package(str(REPOSITORY / "package.xml")).version
    assert re.fullmatch(r"\d+\.\d+\.\d+", version)
    assert importlib.metadata.version("fisheye_ep_calib") == version, "install anew: make environment"
    assert fisheye_ep_calib.__version__ == version
    assert yaml.safe_load((REPOSITORY / "CITATION.cff").read_text("utf-8"))["version"] == version
    ended = subprocess.run([sys.executable, "setup.py", "--version"], cwd=REPOSITORY, capture_output=True, text=True)
    assert ended.stdout.splitlines()[-1:] == [version], ended.stderr
    assert version not in (REPOSITORY / "setup.py").read_text("utf-8")


def test_the_changelog_is_read_by_ros_tools(tmp_path) -> None:
    """They pass over what is forthcoming until it has a version and a date."""
    version = parse_package(str(REPOSITORY / "package.xml")).version
    text = (REPOSITORY / "CHANGELOG.rst").read_text("utf-8")
    named = f"{version} (2026-01-01)"
    released = text.replace("Forthcoming\n-----------\n", f"{named}\n{'-' * len(named)}\n")
    (tmp_path / "CHANGELOG.rst").write_text(released, "utf-8")
    newest, _, items = next(get_changelog_from_path(str(tmp_path), "fisheye_ep_calib").foreach_version(reverse=True))
    assert newest == version and items


def test_entry_points_exist() -> None:
    entries = importlib.metadata.distribution("fisheye_ep_calib").entry_points
    assert {"fisheye_ep_calib", "calibrator", "rectifier", "calibrate_bag"} <= {entry.name for entry in entries}
    for entry in entries:
        assert callable(entry.load()), entry.name


def test_core_installs_without_ros() -> None:
    requirements = importlib.metadata.requires("fisheye_ep_calib") or []
    always = [requirement for requirement in requirements if "extra ==" not in requirement]
    assert not [requirement for requirement in always if re.match("ros-|rclpy", requirement)]
    assert any(requirement.startswith("ros-jazzy-rclpy") for requirement in requirements)


def test_every_extra_that_is_named_somewhere_is_offered() -> None:
    pages = [REPOSITORY / "README.md", *(REPOSITORY / "docs").glob("*.md")]
    pages += (REPOSITORY / "fisheye_ep_calib").rglob("*.py")
    naming = re.compile(r"(?:extra `|'\.|fisheye_ep_calib)\[([a-z]+)\]")
    named = {name for page in pages for name in naming.findall(page.read_text("utf-8"))}
    offered = {*importlib.metadata.distribution("fisheye_ep_calib").metadata.get_all("Provides-Extra", [])}
    assert {"ros", "web"} <= named
    assert named <= offered, f"{named - offered}: in setup.py? then install anew: make environment"


def test_every_folder_of_modules_is_a_package() -> None:
    folders = {module.parent for module in (REPOSITORY / "fisheye_ep_calib").rglob("*.py")}
    assert [str(folder) for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_the_package_gives_its_names_and_rooms_when_they_are_asked_for() -> None:
    program = (
        "import sys, fisheye_ep_calib\n"
        "assert 'numpy' not in sys.modules\n"
        "assert {*fisheye_ep_calib.__all__} <= {*dir(fisheye_ep_calib)}\n"
        "from fisheye_ep_calib import *\n"
        "assert fisheye_ep_calib.calibrate is calibrate and callable(calibrate)\n"
        "assert fisheye_ep_calib.storage.camera_file.load_camera is load_camera\n"
        "assert fisheye_ep_calib.camera.FisheyeCamera is FisheyeCamera\n"
        "assert fisheye_ep_calib.calibration.Observations is Observations\n"
        "assert issubclass(InputError, CalibrationError) and not hasattr(fisheye_ep_calib, 'nothing')\n"
        "from fisheye_ep_calib import simulation\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
