"""calibrate, evaluate and compare write their reports, and never over another one."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from fisheye_ep_calib import load_camera
from fisheye_ep_calib.cli import main
from fisheye_ep_calib.storage.observation_file import save_observations

SCHEMA = Path(__file__).resolve().parents[2] / "docs" / "calibration_json.md"


@pytest.fixture(scope="module")
def folder(observations, tmp_path_factory):
    """A calibration of the command line, with its report."""
    place = tmp_path_factory.mktemp("commands")
    save_observations(place / "front.npz", observations)
    assert main(["calibrate", str(place / "front.npz"), "--model", "ep_even", "--output", str(place / "out")]) == 0
    return place


def test_results_stand_side_by_side(folder):
    assert {path.name for path in (folder / "out").iterdir()} == {
        "front.yaml",
        "observations",
        "calibration.json",
        "report.html",
    }


def test_record_says_what_json_says_and_more(folder, result, capsys):
    again = ["calibrate", str(folder / "front.npz"), "--model", "ep_even", "--no-report", "--json"]
    assert main([*again, "--output", str(folder / "again")]) == 0
    printed = json.loads(capsys.readouterr().out)["cameras"]["front"]
    assert not (folder / "again" / "report.html").exists()
    record = json.loads((folder / "again" / "calibration.json").read_text(encoding="utf-8"))
    assert record["schema"] == 1
    camera = record["cameras"]["front"]
    assert {name: camera[name] for name in printed} == printed
    assert camera["inputs"]["points_found"] == result.points + len(result.rejected)
    assert len(camera["per_view"]) == result.views
    points = np.array([view["points"] for view in camera["per_view"]])
    rms = np.array([view["rms_px"] for view in camera["per_view"]])
    assert np.sqrt((points * rms**2).sum() / points.sum()) == pytest.approx(result.rms_px, rel=1e-9)


def test_every_field_is_documented(folder):
    documented = set(re.findall(r"`([a-z_]+)`", SCHEMA.read_text(encoding="utf-8")))
    record = json.loads((folder / "out" / "calibration.json").read_text(encoding="utf-8"))
    camera = record["cameras"]["front"]
    fields = {*record, *camera, *camera["inputs"], *camera["per_view"][0], *camera["diagnosis"][0]}
    fields |= {*camera["comparison"]["kannala"], *camera["rejected"][0], *camera["seconds"]}
    assert fields - documented == set()


def test_saved_observations_give_the_same_camera(folder):
    saved = folder / "out" / "observations" / "front.npz"
    options = ["--model", "ep_even", "--no-report", "--output", str(folder / "repeated")]
    assert main(["calibrate", str(saved), *options]) == 0
    first, second = (load_camera(folder / place / "front.yaml") for place in ("out", "repeated"))
    np.testing.assert_allclose(first.parameters, second.parameters, rtol=1e-9, atol=1e-12)


def test_earlier_report_is_not_replaced_silently(folder, capsys):
    other = folder / "rear.npz"
    other.write_bytes((folder / "front.npz").read_bytes())
    before = (folder / "out" / "report.html").read_bytes()
    assert main(["calibrate", str(other), "--model", "ep_even", "--output", str(folder / "out")]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (folder / "out" / "report.html").read_bytes() == before
    assert not (folder / "out" / "rear.yaml").exists()


def test_evaluation_reports(folder, capsys):
    command = ["evaluate", str(folder / "out" / "front.yaml"), str(folder / "front.npz")]
    page = folder / "evaluation.html"
    assert main([*command, "--report", str(page), "--json"]) == 0
    measured = json.loads(capsys.readouterr().out)
    text = page.read_text(encoding="utf-8")
    assert f"{measured['rms_px']:.3f} px RMS" in text
    assert "What stands out" in text
    assert main([*command, "--report", str(page)]) == 2


@pytest.mark.parametrize(
    ("report", "told"),
    [("front.npz/page.html", "is not a folder"), ("out", "--overwrite"), ("locked/page.html", "no permission")],
)
def test_a_page_that_cannot_be_written_is_refused_before_anything_is_read(folder, capsys, monkeypatch, report, told):
    (folder / "locked").mkdir(exist_ok=True)
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "locked")
    for words in (["evaluate", "none.yaml", "none.npz"], ["compare", "none.yaml", "none.yaml"]):
        assert main([*words, "--report", str(folder / report)]) == 2
        assert told in capsys.readouterr().err
        assert main([*words, "--report", str(folder / "out"), "--overwrite"]) == 2
        assert "is a folder; give a file in it" in capsys.readouterr().err


def test_evaluation_of_a_wrong_camera_is_told(folder):
    camera = (folder / "out" / "front.yaml").read_text(encoding="utf-8")
    wrong = folder / "wrong.yaml"
    wrong.write_text(re.sub(r"(intrinsics: \{fx: )[\d.]+", r"\g<1>600.0", camera), encoding="utf-8")
    page = folder / "wrong.html"
    assert main(["evaluate", str(wrong), str(folder / "front.npz"), "--report", str(page)]) == 1
    assert "does not hold on this recording" in page.read_text(encoding="utf-8")


def test_comparison_of_two_halves_is_within_their_uncertainties(folder, observations, capsys):
    for name, rest in (("even", 0), ("odd", 1)):
        images = np.flatnonzero(np.arange(observations.image_index.max() + 1) % 2 == rest)
        save_observations(folder / f"{name}.npz", observations.select_images(images))
        arguments = ["calibrate", str(folder / f"{name}.npz"), "--model", "ep_even", "--no-report"]
        assert main([*arguments, "--output", str(folder / name)]) == 0
    capsys.readouterr()
    files = [str(folder / name / f"{name}.yaml") for name in ("even", "odd")]
    page = folder / "compare.html"
    assert main(["compare", *files, "--distance", "0.12", "inf", "--json", "--report", str(page)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["distance_m"] for row in found["distances"]] == [0.12, "inf"]
    for row in found["distances"]:
        assert 0.2 < row["rms_px"] / row["expected_rms_px"] < 2.5
    assert found["agree"] is True
    assert found["verdict"] in page.read_text(encoding="utf-8")


def test_comparison_with_another_camera_says_where_it_differs(folder, capsys):
    camera = (folder / "out" / "front.yaml").read_text(encoding="utf-8")
    other = folder / "other.yaml"
    other.write_text(re.sub(r"(radial: \[)(-?[\d.e-]+)", r"\g<1>0.02", camera), encoding="utf-8")
    assert main(["compare", str(folder / "out" / "front.yaml"), str(other), "--align", "rigid"]) == 0
    text = capsys.readouterr().out
    assert "differ by more than their uncertainties explain" in text
    assert "origin was shifted" in text


def test_camera_without_uncertainty_can_be_compared(folder, capsys):
    camera = (folder / "out" / "front.yaml").read_text(encoding="utf-8")
    plain = folder / "plain.yaml"
    plain.write_text(camera[: camera.index("entrance_pupil:")], encoding="utf-8")
    assert main(["compare", str(plain), str(plain), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["agree"] is None
    assert found["distances"][0]["expected_rms_px"] is None


@pytest.mark.parametrize("distance", ["0", "-1", "nan"])
def test_impossible_distance_is_wrong_usage(folder, distance, capsys):
    file = str(folder / "out" / "front.yaml")
    assert main(["compare", file, file, "--distance", distance]) == 2
    assert "--distance" in capsys.readouterr().err
