"""What calibrate, evaluate and show print and write, where all is well."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import close_to_truth, strict_json
from known_scenes import CAMERA

import fisheye_ep_calib
from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.pipeline.names import image_stem, numbered_alike, safe_name
from fisheye_ep_calib.storage.camera_file import read_camera_file

FAMILIES = {"kannala", "gennery", "ep_odd", "ep_even"}


def process(*words, cwd: Path, **environment) -> subprocess.CompletedProcess:
    root = str(Path(fisheye_ep_calib.__file__).parents[1])
    return subprocess.run(
        [sys.executable, "-m", "fisheye_ep_calib", *map(str, words)],
        cwd=cwd,
        capture_output=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": root, "OMP_NUM_THREADS": "1", **environment},
    )


def test_calibrate_says_all_that_the_contract_names_on_stdout_alone(observation_file, tmp_path) -> None:
    ended = process("calibrate", observation_file, "--json", cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr.decode()
    content = strict_json(ended.stdout.decode())
    assert ended.stdout.count(b"\n") == 1 and list(content) == ["cameras"] and list(content["cameras"]) == ["front"]
    camera = content["cameras"]["front"]
    kinds = {
        "model": str,
        "rms_px": float,
        "views": int,
        "points": int,
        "rejected_points": int,
        "entrance_pupil_supported": bool,
        "iterations": int,
        "converged": bool,
        "seconds": dict,
        "yaml": str,
        "comparison": dict,
        "entrance_pupil": str,
        "board": dict,
        "findings": list,
    }
    for key, kind in kinds.items():
        assert type(camera[key]) is kind, key
    assert camera["seconds"].keys() >= {"read", "detect", "initialize", "adjust"}
    assert all(type(value) is float and value >= 0 for value in camera["seconds"].values())
    assert camera["comparison"].keys() == FAMILIES
    assert camera["entrance_pupil"] in ("supported", "doubtful", "not distinguishable")
    assert (camera["entrance_pupil"] == "supported") is camera["entrance_pupil_supported"]
    assert camera["pupil_verdict"]["answer"] == camera["entrance_pupil"] and camera["refused"] is None
    assert camera["board"].keys() >= {"shape", "bent", "height_rms_mm"} and camera["board"]["shape"] in ("flat", "bow")
    names = {finding["name"]: finding for finding in camera["findings"]}
    assert names.keys() >= {"coverage", "depth", "near_far", "worst_view", "few_views"}
    assert all(one.keys() == {"name", "raised", "text"} and type(one["raised"]) is bool for one in names.values())
    former = {one["name"]: one["concern"] for one in camera["diagnosis"]}
    assert former["depth at large angles"] == names["depth"]["raised"] and "near/far split" in former
    for one in camera["comparison"].values():
        assert 0 < one["rms_px"] < one["cross_validated_rms_px"] * 1.2
    assert camera["model"] in FAMILIES and camera["converged"] and camera["views"] == 12
    assert (tmp_path / camera["yaml"]).samefile(tmp_path / "calibration" / "front.yaml")
    assert {entry.name for entry in (tmp_path / "calibration").iterdir()} == {
        "front.yaml",
        "observations",
        "report.html",
        "calibration.json",
    }
    assert b"wrote" in ended.stderr and b"Warning" not in ended.stderr and b"Traceback" not in ended.stderr


def test_a_process_ends_with_the_codes_0_1_and_2(camera_file, observation_file, tmp_path) -> None:
    shown = process("show", camera_file, cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert shown.returncode == 0 and b"ep_even" in shown.stdout and not shown.stderr
    missing = process("calibrate", "nothing.npz", cwd=tmp_path)
    assert (missing.returncode, missing.stdout) == (2, b"")
    assert missing.stderr == b"fisheye_ep_calib: error: nothing.npz does not exist\n"
    few = Observations.load(observation_file).select_images([0, 1])
    np.savez(
        tmp_path / "few.npz",
        unit="m",
        **{key: getattr(few, key) for key in ("object_points", "image_index", "point_index", "pixels", "image_size")},
    )
    refused = process("calibrate", "few.npz", cwd=tmp_path)
    assert (refused.returncode, refused.stdout, refused.stderr.count(b"\n")) == (1, b"", 1)
    assert b"at least 3 are needed" in refused.stderr and not (tmp_path / "calibration").exists()


def test_the_camera_file_is_the_calibration(command, observation_file, camera_file) -> None:
    result = calibrate(Observations.load(observation_file), "ep_even")
    file = read_camera_file(camera_file)
    assert file.camera == result.camera and file.name == "front"
    assert np.allclose(file.covariance, result.uncertainty.covariance, rtol=1e-12)
    assert file.stand_in_loss_px == pytest.approx(result.stand_in.loss_px, abs=1e-6)
    plain = yaml.safe_load(camera_file.read_text())
    assert plain["distortion_model"] == "equidistant" and plain["camera_matrix"]["data"][1] == 0
    assert plain["distortion_coefficients"]["data"] == pytest.approx(list(result.stand_in.camera.radial))
    assert any(plain["distortion_coefficients"]["data"])
    block = plain["entrance_pupil"]
    assert list(block)[:2] == ["schema", "model"] and block["schema"] == 1
    assert {
        "intrinsics",
        "radial",
        "tangential",
        "tilt",
        "coefficients",
        "theta_max",
        "covariance",
        "svp",
    } <= block.keys()
    assert {"rms_px", "views", "points", "board_warp", "date", "source", "software"} <= block["calibration"].keys()


def test_show_prints_the_curves_on_whole_degrees(command, camera_file) -> None:
    content = command("show", camera_file, "--json").json
    camera = read_camera_file(camera_file).camera
    count = int(np.degrees(camera.theta_max)) + 1
    assert content["theta_deg"] == list(range(count)) and content["image_size"] == [1600, 1200]
    theta = np.radians(content["theta_deg"])
    assert content["E_m"] == pytest.approx(
        camera.coefficients[0] * theta**2 + camera.coefficients[1] * theta**4, abs=1e-12
    )
    assert content["r_px"] == pytest.approx(
        camera.fx * sum(k * theta ** (2 * i + 1) for i, k in enumerate((1, *camera.radial))), rel=1e-12
    )
    assert len(content["E_sigma_m"]) == len(content["r_sigma_px"]) == count
    assert content["E_sigma_m"][0] == 0 and 1e-6 < content["E_sigma_m"][60] < 1e-3
    assert content["model"] == "ep_even" and close_to_truth(content)
    assert tuple(content["sigma"]) == camera.parameter_names and content["sigma"]["fx"] > 0
    assert content["E_from"] == "chosen"
    assert content.keys() >= {"fx", "fy", "skew", "cx", "cy", "radial", "coefficients"}
    text = command("show", camera_file).out
    assert "front: 1600×1200 px, model ep_even" in text and "60°" in text


def test_show_reads_a_plain_camera_info_file(command, tmp_path) -> None:
    (tmp_path / "plain.yaml").write_text(
        "image_width: 640\nimage_height: 480\ncamera_name: old\ndistortion_model: equidistant\n"
        "camera_matrix: {rows: 3, cols: 3, data: [200, 0, 320, 0, 201, 240, 0, 0, 1]}\n"
        "distortion_coefficients: {rows: 1, cols: 4, data: [0.01, 0, 0, 0]}\n"
    )
    content = command("show", "plain.yaml", "--json").json
    assert content["model"] == "kannala" and not any(content["E_m"]) and content["fy"] == 201
    assert "old" in command("show", "plain.yaml").out


def test_evaluate_measures_the_camera_on_other_views(command, camera_file, observation_file) -> None:
    content = command("evaluate", camera_file, observation_file, "--json").json
    names = {"rms_px", "expected_rms_px", "median_px", "p95_px", "views", "points", "failed_views", "verdict"}
    assert content.keys() == names | {"findings", "verdict_level", "worst_views", "board", "board_shape"}
    assert (
        0.9 < content["rms_px"] / content["expected_rms_px"] < 1.1 and "holds on this recording" in content["verdict"]
    )
    assert content["views"] == 12 and content["failed_views"] == []
    assert 0.1 < content["rms_px"] < 0.16 and content["median_px"] < content["rms_px"] < content["p95_px"]
    tested = command("evaluate", camera_file, observation_file, "--split", "test", "--json").json
    assert tested["views"] == 2 and tested["points"] < content["points"]
    text = command("evaluate", camera_file, observation_file)
    assert text.code == 0 and "12 views" in text.out and "RMS" in text.out


def test_evaluate_bends_the_board_as_the_file_says(command, observation_file, camera_file, tmp_path) -> None:
    content = yaml.safe_load(camera_file.read_text())
    content["entrance_pupil"]["calibration"]["board_warp"] = [2e-3, 0.0, 0.0]
    (tmp_path / "bent.yaml").write_text(yaml.safe_dump(content))
    flat = command("evaluate", "bent.yaml", observation_file, "--json").json
    bent = command("evaluate", "bent.yaml", observation_file, "--board-warp", "--json").json
    assert bent["rms_px"] > 2 * flat["rms_px"]


def test_a_calibration_can_be_repeated_from_what_it_saved(command, observation_file, tmp_path) -> None:
    first = command("calibrate", observation_file, "--output", "one", "--no-report", "--json").json["cameras"]["front"]
    saved = tmp_path / "one" / "observations" / "front.npz"
    again = command("calibrate", saved, "--output", "two", "--no-report", "--json").json["cameras"]["front"]
    assert {key: first[key] for key in ("model", "rms_px", "points")} == {
        key: again[key] for key in ("model", "rms_px", "points")
    }


def test_earlier_results_are_not_overwritten(command, observation_file, tmp_path) -> None:
    words = ("calibrate", observation_file, "--model", "kannala", "--no-report")
    assert command(*words).code == 0 and command(*words).code == 0
    assert (tmp_path / "calibration" / "front.yaml").exists() and (tmp_path / "calibration_2" / "front.yaml").exists()
    before = (tmp_path / "calibration" / "front.yaml").read_bytes()
    command(*words, "--output", "calibration").refused(2, "is there already", "--overwrite")
    assert (tmp_path / "calibration" / "front.yaml").read_bytes() == before
    assert command(*words, "--output", "calibration", "--overwrite").code == 0


def test_several_observation_files_are_several_cameras(command, observation_file, tmp_path) -> None:
    for name in ("left", "right"):
        (tmp_path / f"{name}.npz").write_bytes(observation_file.read_bytes())
    few = dict(np.load(observation_file))
    keep = few["image_index"] < 2
    np.savez(
        "poor.npz",
        **{**few, **{key: few[key][keep] for key in ("image_index", "point_index", "pixels", "weights")}},
    )
    ended = command("calibrate", "left.npz", "poor.npz", "right.npz", "--model", "kannala", "--no-report", "--json")
    assert ended.code == 1 and ended.json["cameras"].keys() == {"left", "right"}
    assert "poor: error: 2 views have" in ended.err
    assert {path.name for path in (tmp_path / "calibration").glob("*.yaml")} == {"left.yaml", "right.yaml"}


def test_names_of_files_never_become_paths(command, observation_file, tmp_path) -> None:
    odd = ["..npz", "a b;$(touch x).npz", "-dash.npz", "é.npz", "前.npz", os.fsdecode(b"\xff.npz")]
    for number, name in enumerate(odd):
        (tmp_path / name).write_bytes(observation_file.read_bytes())
        out = tmp_path / f"out{number}"
        report = [] if name == odd[-1] else ["--no-report"]
        ended = command("calibrate", f"./{name}", "--output", out, "--model", "kannala", "--json", *report)
        assert ended.code == 0, ended.err
        (key,) = ended.json["cameras"]
        assert re.fullmatch(r"\w[\w.-]*", key)
        written = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
        assert written - {"report.html"} == {f"{key}.yaml", f"observations/{key}.npz", "calibration.json"}
        assert command("show", out / f"{key}.yaml", "--json").json["name"] == key
        json.loads((out / "calibration.json").read_text())
    assert not (tmp_path / "x").exists()


def test_names_are_safe_and_keep_the_letters_of_every_script() -> None:
    names = ("前", "а b", "e\u0301", "../../x", "...", "a/b\\c", "a\0b\n", "\udcff", "\u202ea", "x" * 999, "字" * 99)
    safe = ("前", "а_b", "é", "x", "camera", "a_b_c", "a_b", "camera", "a", "x" * 200, "字" * 66)
    assert tuple(map(safe_name, names)) == safe
    images = ("a.png", "a.jpg", "A.bmp", "../../x.png", "...", "12.000000034", "12.000000035")
    stems = ["a", "a_2", "A_3", "x", "camera", "12.000000034", "12.000000035"]
    assert numbered_alike(map(image_stem, images)) == stems


def test_the_papers_printed_equation_is_compared_but_not_saved(command, observation_file, tmp_path) -> None:
    ended = command(
        "calibrate",
        observation_file,
        "--model",
        "ep_odd_target_axis",
        "--output",
        "out",
        "--no-report",
        "--json",
    )
    camera = ended.json["cameras"]["front"]
    assert ended.code == 0 and camera["yaml"] is None and camera["model"] == "ep_odd_target_axis"
    assert not list((tmp_path / "out").glob("*.yaml")) and "no camera" in ended.err


def test_a_fit_that_did_not_converge_exits_1_with_its_best_state_marked(
    command, observation_file, tmp_path, monkeypatch
) -> None:
    from fisheye_ep_calib.calibration.estimating import fit

    full = fit.adjust
    monkeypatch.setattr(fit, "adjust", lambda *given, **options: full(*given, **{**options, "max_iterations": 1}))
    ended = command("calibrate", observation_file, "--model", "ep_even", "--output", "out", "--no-report", "--json")
    assert ended.code == 1 and not ended.json["cameras"]["front"]["converged"]
    assert "did not converge" in ended.err and "front.not_converged.yaml" in ended.err
    assert [path.name for path in (tmp_path / "out").glob("*.yaml")] == ["front.not_converged.yaml"]
    assert (
        yaml.safe_load((tmp_path / "out" / "front.not_converged.yaml").read_text())["entrance_pupil"]["calibration"][
            "converged"
        ]
        is False
    )


@pytest.mark.parametrize(
    ("words", "check"),
    [
        (["--model", "gennery", "--terms", "3"], lambda camera: len(camera.coefficients) == 3),
        (["--model", "kannala", "--no-skew"], lambda camera: camera.skew == 0),
        (
            ["--model", "ep_odd", "--tangential", "--tilt"],
            lambda camera: set(camera.extras) == {"tangential", "tilt"},
        ),
        (
            ["--lens", "double_sphere"],
            lambda camera: camera.lens == "double_sphere" and len(camera.radial) == 2,
        ),
        (["--loss", "huber", "--model", "ep_even"], lambda camera: abs(camera.fx / CAMERA.fx - 1) < 5e-3),
    ],
)
def test_every_option_reaches_the_camera(command, observation_file, tmp_path, words, check) -> None:
    assert command("calibrate", observation_file, "--output", "out", "--no-report", *words).code == 0
    assert check(read_camera_file(tmp_path / "out" / "front.yaml").camera)


def test_the_stand_in_is_made_for_the_distance_asked_for(command, observation_file, tmp_path) -> None:
    words = ("calibrate", observation_file, "--model", "ep_even", "--no-report", "--json", "--output")
    far = command(*words, "far").json["cameras"]["front"]["svp_loss_px"]
    near = command(*words, "near", "--svp-distance", "0.3").json["cameras"]["front"]["svp_loss_px"]
    assert near["0.3"] < 0.5 * far["0.3"] and near["10.0"] > far["10.0"]
    assert command("show", tmp_path / "near" / "front.yaml", "--json").json["svp"]["distance"] == 0.3
    assert command("show", tmp_path / "far" / "front.yaml", "--json").json["svp"]["distance"] == "inf"
