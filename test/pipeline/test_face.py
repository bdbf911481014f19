"""From a folder of images to a judged camera, its page and its figures, with imports from fisheye_ep_calib alone."""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
from small_recording import VIEWS, write_small_recording

import fisheye_ep_calib
from fisheye_ep_calib import (
    CalibrationError,
    CalibrationResult,
    InputError,
    Observations,
    calibrate,
    calibrate_recording,
    compare,
    evaluate,
    find_target,
    load_camera,
    load_target,
    open_recording,
    rectify,
    save_camera,
)

matplotlib.use("agg")
TARGET = "circle_grid_11x7"
FIGURES = (
    "entrance_pupil",
    "lens",
    "single_viewpoint",
    "residuals",
    "residuals_by_angle",
    "residuals_by_distance",
    "coverage",
    "depth",
    "uncertainty",
    "near_far",
)


@pytest.fixture(scope="module")
def told() -> list:
    return []


@pytest.fixture(scope="module")
def result(images, told):
    cameras = calibrate_recording(images, TARGET, model="ep_odd", workers=1, on_progress=told.append)
    assert list(cameras) == ["front"] and not cameras.failed
    return cameras["front"]


def test_a_folder_of_images_becomes_a_camera(result, true_camera):
    assert isinstance(result, CalibrationResult) and result.model == "ep_odd" and result.converged
    angle = np.radians(60)
    assert abs(result.camera.entrance_pupil(angle) - true_camera.entrance_pupil(angle)) < 0.1e-3
    assert result.camera.fx == pytest.approx(true_camera.fx, rel=2e-3)
    assert result.views == 9 and result.camera_from_target.shape == (9, 4, 4)
    assert result.seconds["detect"] > 0 and result.observations.image_names[0] == "00.png"


def test_progress_is_a_line_a_step_and_one_now_and_then(result, told):
    lines = [str(one) for one in told]
    assert lines[0] == "looking for the target: 0 of 9 images, the target in 0"
    assert "looking for the target: 9 of 9 images, the target in 9" in lines
    assert "looking again: 9 of 9 images, the target in 9" in lines and "front: calibrating" in lines
    steps = [one.step for one in told]
    assert steps == sorted(steps, key=steps.index), "a step is not taken up again"


def test_words_findings_and_figures_are_those_of_the_command(result):
    names = {one.name for one in result.findings}
    assert names >= {"coverage", "depth", "near_far", "worst_view", "few_views", "pupil_against_depth"}
    content = result.to_dict()
    json.dumps(content)
    assert [one["name"] for one in content["findings"]] == [one.name for one in result.findings]
    assert content["rms_px"] == result.rms_px and content["yaml"] is None
    assert result.verdict.headline and result.verdict.level in ("good", "caution", "bad")
    text = repr(result)
    assert 2 <= text.count("\n") + 1 <= 5 and "front: ep_odd, 512×512 px" in text and "E(60°) = " in text
    page = result._repr_html_()
    assert page.startswith("<pre>front: ep_odd") and result.verdict.headline in page


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_draws_on_axes(result, name):
    from matplotlib.figure import Figure

    figure = Figure()
    axes = getattr(result.plot, name)(figure.add_subplot(1, 2, 2))
    assert axes.figure is figure and (axes.lines or axes.collections), "nothing was drawn"
    assert axes.name == ("polar" if name == "coverage" else "rectilinear")


def test_a_figure_makes_its_own_axes(result):
    from matplotlib import pyplot

    axes = result.plot.entrance_pupil()
    theta, shift = axes.lines[0].get_data()
    expected = 1e3 * result.camera.entrance_pupil(np.radians(theta))
    np.testing.assert_allclose(shift, expected, atol=1e-9)
    pyplot.close("all")


def test_the_report_has_the_images_though_the_recording_is_closed(result, tmp_path):
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text("utf-8")
    assert page.count("data:image/jpeg;base64") >= 9 and result.verdict.headline in page


def test_written_files_are_those_of_the_command(result, tmp_path):
    path = result.write(tmp_path / "out")
    files = {str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*") if file.is_file()}
    assert path == tmp_path / "out" / "front.yaml"
    assert files == {"front.yaml", "calibration.json", "observations/front.npz"}
    assert load_camera(path) == result.camera
    again = Observations.load(tmp_path / "out" / "observations" / "front.npz")
    np.testing.assert_array_equal(again.pixels, result.observations.pixels)
    assert json.loads((tmp_path / "out" / "calibration.json").read_text())["cameras"]["front"]["yaml"] == str(path)
    with pytest.raises(InputError, match="is there already"):
        result.write(tmp_path / "out")
    result.write(tmp_path / "out", overwrite=True)


def test_a_camera_alone_is_saved_and_loaded(result, tmp_path):
    save_camera(tmp_path / "alone.yaml", result.camera)
    assert load_camera(tmp_path / "alone.yaml") == result.camera
    save_camera(tmp_path / "named.yaml", result)
    assert "camera_name: front" in (tmp_path / "named.yaml").read_text()


def test_a_camera_is_measured_on_observations(result, tmp_path):
    judged = evaluate(result, result.observations)
    assert judged.rms_px == pytest.approx(result.rms_px, rel=0.05) and judged.verdict.level in ("good", "caution")
    assert judged.expected_rms_px == pytest.approx(judged.rms_px, rel=0.1) and "expected" in repr(judged)
    alone = evaluate(result.camera, result.observations)
    assert alone.expected_rms_px is None and alone.rms_px == judged.rms_px
    path = result.write(tmp_path / "out")
    assert evaluate(path, result.observations).to_dict()["expected_rms_px"] == pytest.approx(judged.expected_rms_px)
    judged.report(tmp_path / "judged.html")
    assert judged.verdict.headline in (tmp_path / "judged.html").read_text("utf-8")
    from matplotlib.figure import Figure

    assert judged.plot.residuals(Figure().add_subplot()).lines


def test_cameras_are_compared(result, true_camera):
    same = compare(result, result.camera, (0.2, np.inf))
    assert [row.distance_m for row in same.by_distance] == [0.2, np.inf]
    assert same.agree and max(row.rms_px for row in same.by_distance) < 1e-6
    other = compare(result.camera, true_camera, [0.12])
    assert other.agree is None and 0 < other.to_dict()["distances"][0]["rms_px"] < 0.5
    with pytest.raises(InputError, match="`distances` must be positive"):
        compare(result, result.camera, [0.0])


def test_an_image_is_rectified(result, images):
    picture = cv2.imread(str(images / "00.png"), cv2.IMREAD_GRAYSCALE)
    view = rectify(result.camera, picture, 0.12, fov=np.radians(90), size=(200, 150))
    assert view.shape == (150, 200) and view.std() > 5
    with pytest.raises(InputError, match="`distance` must be positive"):
        rectify(result.camera, picture, -1.0)


def test_observations_alone_are_calibrated_and_judged_when_looked_at(result):
    again = calibrate(result.observations, "ep_odd", name="again")
    assert again.name == "again" and again.camera == result.camera and "candidates" not in vars(again)
    assert again.verdict.headline == result.verdict.headline and again.to_dict()["unused_views"] == {}


@pytest.mark.parametrize("call", [calibrate_recording, calibrate])
def test_a_misspelt_option_is_told_with_the_one_that_was_meant(images, result, call):
    given = (images, TARGET) if call is calibrate_recording else (result.observations,)
    with pytest.raises(InputError) as error:
        call(*given, svp_distence=1.0)
    assert "did you mean svp_distance?" in str(error.value) and "board_warp" in str(error.value)


def test_errors_name_the_function_s_parameter(images, result):
    with pytest.raises(InputError, match="`svp_distance` must be positive"):
        calibrate(result.observations, svp_distance=-1.0)
    with pytest.raises(InputError, match="`passes` must be 1 or 2"):
        calibrate_recording(images, TARGET, passes=3)
    with pytest.raises(InputError, match="images need `target`"):
        calibrate_recording(images)


class Enough(Exception):
    pass


@pytest.mark.parametrize("step", ["looking for the target", "looking again"])
def test_an_exception_from_the_callback_ends_everything(images, tmp_path, step):
    before = set(os.listdir("/dev/fd"))

    def cancel(now):
        if now.step == step and now.done:
            raise Enough

    with pytest.raises(Enough):
        calibrate_recording(images, TARGET, model="kannala", workers=2, on_progress=cancel)
    assert not multiprocessing.active_children()
    assert len(set(os.listdir("/dev/fd")) - before) <= 2, "files were left open"  # the resource tracker's pipe
    assert sorted(path.name for path in images.parent.iterdir()) == ["front"]


def test_the_cameras_of_a_recording_fail_one_by_one(recording_of_two, caplog):
    path, target = recording_of_two
    topics = {"near": "left", "far": "right"}
    with caplog.at_level(logging.INFO, "fisheye_ep_calib"), open_recording(path) as recording:
        cameras = calibrate_recording(recording, load_target(target), topics=topics, model="kannala", workers=1)
        assert recording.frame("left", 0).image().shape == (480, 640), "it stays open: it was given open"
    assert list(cameras) == ["near"] and "far" not in cameras and cameras["near"].rms_px < 0.5
    assert "the target was found in none" in str(cameras.failed["far"])
    with pytest.raises(CalibrationError, match="the target was found in none"):
        cameras["far"]
    assert any("far: " in record.message for record in caplog.records if record.levelname == "WARNING")
    assert any("target found in 12 of 12 images" in record.message for record in caplog.records)


@pytest.fixture(scope="module")
def recording_of_two(tmp_path_factory) -> tuple[Path, Path]:
    """Folders left/ and right/ with images, of which right/ shows nothing, and the board of left/."""
    folder = write_small_recording(tmp_path_factory.mktemp("two"))
    for name in ("left", "right"):
        (folder / "two" / name).mkdir(parents=True)
    with open_recording(folder / "rig.mcap") as recording:
        for number in range(VIEWS):
            picture = recording.frame("/left/image_raw", number).image()
            for name, content in (("left", picture), ("right", np.full_like(picture, 128))):
                cv2.imwrite(str(folder / "two" / name / f"{number:02d}.png"), content)
    return folder / "two", folder / "board.yaml"


def test_the_face_is_imported_without_what_it_may_never_need():
    program = (
        "import sys, fisheye_ep_calib as f; f.calibrate_recording, f.calibrate, f.evaluate, f.compare; f.load_target\n"
        "late = {'matplotlib', 'jinja2', 'mcap', 'rosbags', 'rclpy', 'distributed', 'tqdm'}\n"
        "print(sorted(late & set(sys.modules)))"
    )
    root = str(Path(fisheye_ep_calib.__file__).parents[1])
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": root}
    )
    assert ended.stdout == "[]\n", ended.stdout + ended.stderr


def test_every_name_of_the_face_is_there():
    for name in fisheye_ep_calib.__all__:
        assert getattr(fisheye_ep_calib, name) is not None
    assert set(fisheye_ep_calib.__all__) <= set(dir(fisheye_ep_calib))


def test_a_target_is_a_name_a_file_or_itself(images, tmp_path):
    (tmp_path / "mine.yaml").write_text("type: circle_grid\ncolumns: 11\nrows: 7\nspacing: 0.012\nradius: 0.004\n")
    targets = (TARGET, tmp_path / "mine.yaml", load_target(TARGET))
    found = [find_target(images, target, workers=1)["front"] for target in targets]
    assert found[0].view_count == 9
    for other in found[1:]:
        np.testing.assert_array_equal(other.pixels, found[0].pixels)
        np.testing.assert_array_equal(other.object_points, found[0].object_points)
