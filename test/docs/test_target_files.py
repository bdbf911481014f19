"""Every target file that README and docs show is one that is read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from fisheye_ep_calib.target import parse_target

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```yaml\n(.*?)^```", re.MULTILINE | re.DOTALL)
SHORTENED = "…"  # a list of which the page shows the first row


@pytest.mark.parametrize(
    "block", [pytest.param(block, id=page.stem) for page in PAGES for block in BLOCK.findall(page.read_text("utf-8"))]
)
def test_a_target_file_is_read(block):
    keys = yaml.safe_load(block)
    if SHORTENED in block:
        assert isinstance(keys["shape"]["deviation"], list)
        del keys["shape"]
    assert len(parse_target(keys).object_points) == (keys.get("columns") or keys["targetCols"]) * (
        keys.get("rows") or keys["targetRows"]
    )
