"""The demo: its offline part as a user runs it, and (slow) the whole of it with the live node."""

from __future__ import annotations

import argparse
import logging

import numpy as np
import pytest

from fisheye_ep_calib.commands import demo
from fisheye_ep_calib.simulation import paper_camera, paper_target
from fisheye_ep_calib.storage.camera_file import load_camera
from fisheye_ep_calib.target import load_target


def run(*words: str) -> int:
    parser = argparse.ArgumentParser()
    demo.add_arguments(parser)
    return demo.run(parser.parse_args(words))


def assert_pupil_found(camera, truth) -> None:
    theta = np.radians(np.arange(0, 76))
    assert np.abs(camera.entrance_pupil(theta) - truth.entrance_pupil(theta)).max() < 0.6e-3


def test_the_target_file_is_the_target(tmp_path):
    (tmp_path / "target.yaml").write_text(demo.TARGET_YAML, encoding="utf-8")
    target = load_target(tmp_path / "target.yaml")
    assert np.array_equal(target.object_points, paper_target().object_points)
    assert target.disc_radius == paper_target().disc_radius


def test_offline_it_finds_the_pupil_and_shows_the_truth_beside_it(tmp_path, capsys, caplog, monkeypatch):
    monkeypatch.setattr(demo, "CAMERAS", ("front",))
    with caplog.at_level(logging.INFO, "fisheye_ep_calib"):
        assert run("--output", str(tmp_path), "--no-live") == 0
    out = capsys.readouterr().out
    assert "target found in 25 of 25 images" in caplog.text and "left out: --no-live was given" in out
    rows = {line.split()[0]: line.split()[2:] for line in out.splitlines() if line.startswith(("fx", "E(", "RMS"))}
    assert rows["fx"][0] == "591.73"
    kannala, ep_odd = (float(value) for value in rows["RMS"])
    assert ep_odd < 0.1 * kannala and ep_odd < 0.05
    assert_pupil_found(load_camera(tmp_path / "front.yaml"), paper_camera())
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"demo.mcap", "target.yaml", "front.yaml", "observations", "report.html"}
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "E(θ)" in page and len(page) > 100_000 and str(tmp_path / "report.html") in out


@pytest.mark.slow
@pytest.mark.live
def test_the_live_node_gives_camera_info_back(tmp_path, capsys):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install '.[ros]'")
    assert run("--output", str(tmp_path)) == 0
    out = capsys.readouterr().out
    for name in demo.CAMERAS:
        assert f"/{name}/camera_info\n  header:" in out and f"{name}_optical_frame" in out
    assert "equidistant" in out
    for number, name in enumerate(demo.CAMERAS):
        assert_pupil_found(load_camera(tmp_path / "live" / f"{name}.yaml"), paper_camera(number))
