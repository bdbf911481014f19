"""The report that the page's button asks for."""

from __future__ import annotations

import re

from fisheye_ep_calib.live.report_page import report_page
from fisheye_ep_calib.simulation import observe, paper_camera, paper_target, random_poses


def test_a_report_of_what_the_node_has_seen() -> None:
    observed = observe(paper_camera(), paper_target(), random_poses(paper_target(), 12, 1), 0.05, 1)
    page = report_page(observed, "ep_odd", "front")
    assert page.lstrip().lower().startswith("<!doctype html") and "front" in page
    assert not re.findall(r"(?:src|href)=[\"']https?:", page)
