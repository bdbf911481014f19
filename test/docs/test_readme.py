"""The README's tables say what the code says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fisheye_ep_calib.commands.parser import COMMANDS

README = Path(__file__).resolve().parents[2] / "README.md"


def tables() -> list[list[list[str]]]:
    """The tables, each a list of rows of cells, head and rule left out."""
    found, lines = [], README.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines):
        if re.fullmatch(r"\|(-+\|)+", line):
            rows = []
            for row in lines[number + 1 :]:
                if not row.startswith("|"):
                    break
                rows.append([cell.strip() for cell in row.strip("|").split("|")])
            found.append(rows)
    return found


def rows_by_name() -> dict[str, list[str]]:
    """Rows by what their first cell names; a cell may name several."""
    return {name.strip("`* "): row for table in tables() for row in table for name in row[0].split(", ")}


def test_every_command_is_listed():
    listed = [[row[0].strip("`") for row in table] for table in tables() if ["calibrate"] == [table[0][0].strip("`")]]
    assert sorted(listed[0]) == sorted(COMMANDS)


def test_parameters_are_those_of_the_nodes():
    pytest.importorskip("rclpy")
    from fisheye_ep_calib.ros.calibrator_parameters import CAMERA, NODE
    from fisheye_ep_calib.ros.rectifier_parameters import ENTRIES

    entries = [(entry.name, entry) for entry in (*NODE, *ENTRIES)]
    entries += [(f"<camera>.{entry.name}", entry) for entry in CAMERA]
    rows = rows_by_name()
    for name, entry in entries:
        assert name in rows, f"{name} is missing in the README"
        assert rows[name][0].endswith("*") == entry.live, f"{name}: * marks what may change while the node runs"
        if isinstance(entry.default, (bool, int, float)):
            assert rows[name][1].strip("`") == str(entry.default).lower(), name
    known = {name for name, _ in entries}
    assert not [name for name in rows if name.startswith("<camera>.") and name not in known]


def test_every_page_of_the_documentation_is_in_its_contents():
    docs = README.parent / "docs"
    contents = (docs / "index.md").read_text(encoding="utf-8").splitlines()
    pages = {page.stem for pattern in ("*.md", "*.rst") for page in docs.glob(pattern)} - {"index"}
    assert not pages - set(contents)
