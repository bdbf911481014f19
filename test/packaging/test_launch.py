"""The launch file, read with stand-ins for ROS's launch packages, which are not on PyPI."""

from __future__ import annotations

import runpy
import sys
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


@pytest.fixture
def description(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    names = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for name, members in names.items():
        module = ModuleType(name)
        for member in members:
            setattr(module, member, type(member, (Recorded,), {}))
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(REPOSITORY / "launch/calibrator.launch.py"))["generate_launch_description"]()


def test_the_node_gets_every_declared_argument(description: Recorded) -> None:
    *arguments, node = description.arguments[0]
    declared = {argument.arguments[0] for argument in arguments}
    assert declared == {"parameters", "namespace", "name", "use_sim_time", "log_level"}
    assert all(argument.options["description"] for argument in arguments)
    assert (node.options["package"], node.options["executable"]) == ("fisheye_ep_calib", "calibrator")

    def used(value: Any) -> set[str]:
        if isinstance(value, Recorded):
            return set(value.arguments) if type(value).__name__ == "LaunchConfiguration" else set()
        values = value.values() if isinstance(value, dict) else value if isinstance(value, list) else []
        return set().union(*(used(part) for part in values)) if values else set()

    assert used(node.options) == declared


def test_the_default_parameters_name_targets_that_are_there() -> None:
    content = yaml.safe_load((REPOSITORY / "config/calibrator.yaml").read_text())["/**"]["ros__parameters"]
    assert (REPOSITORY / "config/targets" / content["target"]).is_file()
    assert set(content["cameras"]) <= set(content)
