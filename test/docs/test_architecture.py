"""The arrows of docs/architecture.md are those of the code."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = REPOSITORY / "fisheye_ep_calib"
SHARED = {
    "arrays",
    "errors",
    "arguments",
    "file_values",
    "outside",
    "plain_text",
    "rotation",
    "worker_processes",
    "yaml_file",
    "npz_file",
    "version",
    "moved_modules",
}  # modules that belong to no room


def drawn() -> dict[str, set[str]]:
    """Room → rooms it may know, from the drawing."""
    block = re.search(r"```text\n(.*?)```", (REPOSITORY / "docs" / "architecture.md").read_text("utf-8"), re.DOTALL)
    arrows = re.findall(r"^(\w+) ─+► (.*)$", block.group(1), re.MULTILINE)
    return {room: set(re.findall(r"\w+", re.sub(r"\(.*?\)", "", known))) for room, known in arrows}


def imported(room: str) -> set[str]:
    """The rooms that a room's modules import, wherever in them."""
    found = set()
    for path in (PACKAGE / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            found |= {name.split(".")[1] for name in names if name and name.startswith("fisheye_ep_calib.")}
    return found - {room} - SHARED


def test_every_room_is_drawn():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert rooms == set(drawn()) | {"camera"}


@pytest.mark.parametrize("room", sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py")))
def test_a_room_knows_what_is_drawn(room):
    assert imported(room) == drawn().get(room, set()), f"{room}: draw the new arrow or take the old one out"


def drawn_inside() -> dict[str, set[str]]:
    """Room within a room → rooms beside it that it may know, from the second drawing."""
    text = (REPOSITORY / "docs" / "architecture.md").read_text("utf-8")
    arrows = re.findall(r"^(\w+/\w+) ─+► (.*)$", text, re.MULTILINE)
    return {room: set(re.findall(r"\w+", others)) - {"none"} for room, others in arrows}


def test_rooms_within_rooms_know_what_is_drawn():
    rooms = {
        f"{outer}/{path.parent.name}"
        for outer in ("calibration", "target")
        for path in PACKAGE.glob(f"{outer}/*/__init__.py")
    }
    known = {}
    for room in rooms:
        outer, inner = room.split("/")
        names = "".join(path.read_text(encoding="utf-8") for path in (PACKAGE / room).rglob("*.py"))
        beside = set(re.findall(rf"^\s*from fisheye_ep_calib\.{outer}\.(\w+)", names, re.MULTILINE))
        known[room] = {name for name in beside - {inner} if f"{outer}/{name}" in rooms}
    assert known == drawn_inside()


def test_the_core_needs_no_ros():
    for room in drawn().keys() - {"ros"}:
        for path in (PACKAGE / room).rglob("*.py"):
            imports = re.findall(r"^\s*(?:import|from) (\w+)", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert not {"rclpy", "sensor_msgs", "std_msgs", "std_srvs"} & set(imports), path
