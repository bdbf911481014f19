"""The parameter files that come with the package and the tables that the nodes declare say the same."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from fisheye_ep_calib.live.settings import Tuning
from fisheye_ep_calib.ros.calibrator_parameters import CAMERA, NODE
from fisheye_ep_calib.ros.parameter_names import with_parameters
from fisheye_ep_calib.ros.rectifier_parameters import ENTRIES

REPOSITORY = Path(__file__).resolve().parents[2]


def flat(values: dict, prefix: str = "") -> dict:
    """Nested keys joined by dots, as ROS does."""
    items = {}
    for key, value in values.items():
        items |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return items


def test_the_parameter_file_names_known_parameters_and_keeps_their_defaults() -> None:
    content = yaml.safe_load((REPOSITORY / "config/calibrator.yaml").read_text())["/**"]["ros__parameters"]
    cameras = content["cameras"]
    defaults = {entry.name: entry.default for entry in NODE}
    for name, value in flat({key: value for key, value in content.items() if key not in cameras}).items():
        if name not in ("cameras", "target"):
            assert value == defaults[name], name
    known = {entry.name for entry in CAMERA}
    assert all(set(content[camera]) <= known for camera in cameras)


def test_the_rectifiers_parameter_file_too() -> None:
    content = yaml.safe_load((REPOSITORY / "config/rectifier.yaml").read_text())["/**"]["ros__parameters"]
    defaults = {entry.name: entry.default for entry in ENTRIES}
    assert content == {name: defaults[name] for name in content}


def test_every_parameter_has_a_description_and_a_default_in_its_range() -> None:
    for entry in NODE + CAMERA + ENTRIES:
        assert entry.description.endswith(".") and not entry.complaint(entry.default), entry.name
        if entry.low is not None:
            assert entry.low <= entry.default <= entry.high


def test_tuning_and_the_table_have_the_same_defaults() -> None:
    defaults, tuning = {entry.name: entry.default for entry in NODE}, Tuning()
    assert defaults["minimum_views"] == tuning.minimum_views
    assert defaults["goal_mm"] == tuning.goal_mm
    assert defaults["maximum_views"] == tuning.limits.maximum_views
    for name in ("position", "size", "tilt"):
        assert defaults[f"novelty.{name}"] == getattr(tuning.limits.novelty, name)


@pytest.mark.parametrize(
    ("said", "heard"),
    [
        ("`fov` must lie above 0°", "parameter fov must lie above 0°"),
        ("`size` 9×9: each side …", "parameter width and height 9×9: each side …"),
        ("front: unknown `model` x", "front: unknown parameter model x"),
        ("cannot write `a file`; call ~/save", "cannot write `a file`; call ~/save"),
    ],
)
def test_errors_name_the_nodes_parameters(said: str, heard: str) -> None:
    assert with_parameters(said) == heard
