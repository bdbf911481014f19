"""The launch files, read with stand-ins for ROS's launch packages, which are not on PyPI, and by these if there."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

REPOSITORY = Path(__file__).resolve().parents[2]


class Recorded:
    """Any launch action or substitution: what it was made with."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options


COMMON = {"parameters", "namespace", "name", "use_sim_time", "log_level"}
COMMON_PART = "fisheye_ep_calib.ros.launching"
NODES = {"calibrator": COMMON, "rectifier": COMMON | {"camera_file", "topic", "distance"}}


@pytest.fixture(params=NODES)
def executable(request: pytest.FixtureRequest) -> str:
    return request.param


def launch_file(executable: str) -> str:
    return str(REPOSITORY / "launch" / f"{executable}.launch.py")


@pytest.fixture
def description(executable: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorded]:
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for name, members in names.items():
        module = ModuleType(name)
        for member in members:
            setattr(module, member, type(member, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    sys.modules.pop(COMMON_PART, None)
    yield runpy.run_path(launch_file(executable))["generate_launch_description"]()
    sys.modules.pop(COMMON_PART, None)


def test_the_node_gets_every_declared_argument(executable: str, description: Recorded) -> None:
    *arguments, node = description.arguments[0]
    declared = {argument.arguments[0] for argument in arguments}
    assert declared == NODES[executable]
    assert all(argument.options["description"] for argument in arguments)
    assert (node.options["package"], node.options["executable"]) == ("fisheye_ep_calib", executable)

    def used(value: Any) -> set[str]:
        if isinstance(value, Recorded):
            if type(value).__name__ == "LaunchConfiguration":
                return set(value.arguments)
            return used(list(value.arguments))
        values = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
        return set().union(*(used(part) for part in values)) if values else set()

    assert used(node.options) == declared


def test_ros_reads_it_too(executable: str) -> None:
    pytest.importorskip("launch_ros.actions", reason="ROS's launch_ros is not installed")
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    description = get_launch_description_from_python_launch_file(launch_file(executable))
    assert {argument.name for argument in description.get_launch_arguments()} == NODES[executable]


def test_the_default_parameters_name_targets_that_are_there() -> None:
    content = yaml.safe_load((REPOSITORY / "config/calibrator.yaml").read_text())["/**"]["ros__parameters"]
    assert (REPOSITORY / "config/targets" / content["target"]).is_file()
    assert set(content["cameras"]) <= set(content)
