"""A figure of a calibration has one name and one value, whichever door it is read through."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from known_scenes import BOARD, CAMERA, seen_board

import fisheye_ep_calib
from fisheye_ep_calib.calibration.content import FACTS, FIGURES
from fisheye_ep_calib.commands.fleet_table import device_rows
from fisheye_ep_calib.live.outcome import TOLD, calibrate_views, outcome_of_file
from fisheye_ep_calib.planning.detectability import Board
from fisheye_ep_calib.storage.json_text import plain
from fisheye_ep_calib.storage.observation_file import load_observations, save_observations

FLEET_NAMES = {"supported": "entrance_pupil_supported"}
CENTRAL = replace(CAMERA, model="kannala", coefficients=())


def same(one, other) -> bool:
    """Numbers to what a file or ~/status rounds to, all else as it is."""
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, float):
        return math.isclose(one, other, rel_tol=1e-6, abs_tol=1e-6)
    return type(one) is type(other) and one == other


def holds(view: dict, content: dict, names: set[str]) -> None:
    """The view has all those names, and whatever it shares with the content is the same there."""
    assert names <= view.keys(), names - view.keys()
    for name in view.keys() & content.keys():
        assert same(view[name], content[name]), (name, view[name], content[name])


@pytest.mark.parametrize("camera", [CAMERA, CENTRAL], ids=["with a pupil", "without"])
def test_every_door_tells_the_same(camera, command, tmp_path) -> None:
    save_observations(tmp_path / "front.npz", seen_board(camera, views=12))
    content = command("calibrate", "front.npz", "--output", "device", "--json").json["cameras"]["front"]
    assert content.keys() == FIGURES.keys() | {"yaml", "unused_views", "previous"}
    record = json.loads((tmp_path / "device" / "calibration.json").read_text("utf-8"))["cameras"]["front"]
    holds(record, content, set(content))

    observations = load_observations(tmp_path / "front.npz")
    result = fisheye_ep_calib.calibrate(observations, name="front")
    holds(plain({**result.to_dict(), "yaml": content["yaml"], "seconds": content["seconds"]}), content, set(content))

    shown = command("show", content["yaml"], "--json").json
    facts = {name for name in FACTS if content[name] is not None}
    holds(shown["calibration"], content, facts)
    assert same(shown["svp"]["loss_px"], content["svp_loss_px"]) and shown["model"] == content["model"]
    board = {name: shown["board"][name] for name in content["board"]}
    assert same(board, content["board"])

    (row,) = device_rows("device", tmp_path / "device")
    holds({FLEET_NAMES.get(name, name): value for name, value in row.items()}, content, {"rms_px", "noise_px", "model"})
    assert row["fx"] == shown["fx"] and row["fx_sigma"] == shown["sigma"]["fx"]

    outcome = calibrate_views(observations, "auto", "front", "here", Board.of(BOARD))
    holds(plain(outcome.figures), content, set(TOLD))
    of_file = outcome_of_file(tmp_path / content["yaml"])
    holds(plain(of_file.figures), content, facts & set(TOLD))
    for figures in (outcome.figures, of_file.figures):
        assert figures["E_from"] == shown["E_from"] == ("chosen" if camera is CAMERA else "left open")
        for angle in ("30", "60", "80"):
            value, sigma = shown["E_m"][int(angle)], shown["E_sigma_m"][int(angle)]
            assert figures["entrance_pupil_mm"][angle] == pytest.approx([1e3 * value, 1e3 * sigma], abs=1e-4)
            assert row[f"E{angle}_mm"] == pytest.approx(1e3 * value) and row[f"E{angle}_sigma_mm"] > 0
