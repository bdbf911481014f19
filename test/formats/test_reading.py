"""Other people's cameras come in: as OpenCV projects them, through every command, and hostile ones in one line."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from foreign_readers import cahvore
from known_scenes import BOARD, poses_of, seen

from fisheye_ep_calib import compare, evaluate, load_camera, save_camera
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.formats.reading import recognised
from fisheye_ep_calib.pipeline.exporting import export
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.observation_file import save_observations

K = [[900.0, 0.0, 640.0], [0.0, 905.0, 480.0], [0.0, 0.0, 1.0]]
FISHEYE = [0.03, -0.004, 0.001, -0.0002]
PLUMB_BOB = [-0.3, 0.11, 1e-3, -2e-3, -0.02]
RATIONAL = [2.1, 0.7, 4e-4, 3e-4, 0.02, 2.4, 1.2, 0.1]


def camera_info(model: str, distortion: list[float]) -> str:
    """As camera_info_manager writes it."""

    def matrix(rows: int, columns: int, data: list[float]) -> dict:
        return {"rows": rows, "cols": columns, "data": data}

    content = {
        "image_width": 1280,
        "image_height": 960,
        "camera_name": "narrow_stereo",
        "camera_matrix": matrix(3, 3, np.ravel(K).tolist()),
        "distortion_model": model,
        "distortion_coefficients": matrix(1, len(distortion), distortion),
        "rectification_matrix": matrix(3, 3, np.eye(3).ravel().tolist()),
        "projection_matrix": matrix(3, 4, np.eye(3, 4).ravel().tolist()),
    }
    return yaml.safe_dump(content, sort_keys=False)


def opencv(ending: str, distortion: list[float], fisheye: int | None = None, number: str = "") -> str:
    """As OpenCV's sample writes it, by OpenCV."""
    storage = cv2.FileStorage(ending, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("calibration_time", "Tue 24 Nov 2026")
    if fisheye is not None:
        storage.write("fisheye_model", fisheye)
    for name, value in (("image_width", 1280), ("image_height", 960)):
        storage.write(name, value)
    names = (f"M{number}", f"D{number}") if number else ("camera_matrix", "distortion_coefficients")
    storage.write(names[0], np.array(K))
    storage.write(names[1], np.array([distortion]).T)
    return storage.releaseAndGetString()


def kalibr(model: str, distortion_model: str, intrinsics: list[float], distortion: list[float]) -> str:
    camera = {
        "cam_overlaps": [],
        "camera_model": model,
        "distortion_coeffs": distortion,
        "distortion_model": distortion_model,
        "intrinsics": intrinsics,
        "resolution": [1280, 960],
        "rostopic": "/front/image_raw",
    }
    return yaml.safe_dump({"cam0": camera})


def mrcal(model: str, intrinsics: list[float]) -> str:
    return f"# a comment\n{{'lensmodel': '{model}',\n 'intrinsics': {intrinsics},\n 'imagersize': [1280, 960],\n}}\n"


GRID = [900.0, 905.0, 640.0, 480.0]
FILES = {  # text, and what OpenCV's functions are given for it
    "equidistant": (camera_info("equidistant", FISHEYE), "fisheye", FISHEYE),
    "plumb_bob": (camera_info("plumb_bob", PLUMB_BOB), "pinhole", PLUMB_BOB),
    "rational_polynomial": (camera_info("rational_polynomial", RATIONAL), "pinhole", RATIONAL),
    "kalibr equi": (kalibr("pinhole", "equidistant", GRID, FISHEYE), "fisheye", FISHEYE),
    "kalibr radtan": (kalibr("pinhole", "radtan", GRID, PLUMB_BOB[:4]), "pinhole", PLUMB_BOB[:4]),
    "opencv fisheye yaml": (opencv(".yaml", FISHEYE, fisheye=1), "fisheye", FISHEYE),
    "opencv fisheye xml": (opencv(".xml", FISHEYE, fisheye=1), "fisheye", FISHEYE),
    "opencv pinhole yaml": (opencv(".yaml", PLUMB_BOB), "pinhole", PLUMB_BOB),
    "opencv pinhole xml": (opencv(".xml", RATIONAL, fisheye=0), "pinhole", RATIONAL),
    "opencv stereo": (opencv(".yaml", PLUMB_BOB, number="1"), "pinhole", PLUMB_BOB),
    "mrcal opencv4": (mrcal("LENSMODEL_OPENCV4", [*GRID, *PLUMB_BOB[:4]]), "pinhole", PLUMB_BOB[:4]),
    "mrcal opencv5": (mrcal("LENSMODEL_OPENCV5", [*GRID, *PLUMB_BOB]), "pinhole", PLUMB_BOB),
    "mrcal opencv8": (mrcal("LENSMODEL_OPENCV8", [*GRID, *RATIONAL]), "pinhole", RATIONAL),
    "mrcal pinhole": (mrcal("LENSMODEL_PINHOLE", GRID), "pinhole", []),
}


@pytest.mark.parametrize("name", FILES)
def test_a_camera_projects_as_opencv_does(name, tmp_path) -> None:
    text, kind, distortion = FILES[name]
    (tmp_path / "theirs").write_text(text)
    file = read_camera_file(tmp_path / "theirs")
    camera = file.camera
    assert camera.image_size == (1280, 960) and not file.covariance.any()
    assert bool(file.origin) == (name != "equidistant")
    u, v = np.meshgrid(np.linspace(60, 1220, 20), np.linspace(60, 900, 15))
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    _, directions, valid = camera.unproject(pixels)
    assert valid.all() and directions[:, 2].min() > 0
    project = cv2.fisheye.projectPoints if kind == "fisheye" else cv2.projectPoints
    args = (np.zeros(3), np.zeros(3), np.array(K), np.array(distortion, dtype=float))
    expected, _ = project(directions[:, None], *args)
    assert np.abs(expected[:, 0] - pixels).max() < 1e-6
    assert np.abs(camera.project(3 * directions)[0] - pixels).max() < 1e-8
    assert camera.theta_max < np.radians(60)


def test_unified_and_double_sphere_cameras_of_kalibr(tmp_path) -> None:
    """π(x) of Mei and Rives (ICRA 2007) with radtan, and of double sphere, as Kalibr has them."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-1, 1, (200, 2)), rng.uniform(0.3, 2, 200)])
    (tmp_path / "omni.yaml").write_text(kalibr("omni", "radtan", [1.2, 900, 905, 640, 480], PLUMB_BOB[:4]))
    plane = points[:, :2] / (points[:, 2:] + 1.2 * np.linalg.norm(points, axis=1)[:, None])
    k1, k2, p1, p2 = PLUMB_BOB[:4]
    x, y = plane.T
    square = x * x + y * y
    factor = 1 + k1 * square + k2 * square**2
    bent = np.stack([x * factor + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                     y * factor + p1 * (square + 2 * y * y) + 2 * p2 * x * y], axis=-1)  # fmt: skip
    pixels, valid = replace(load_camera(tmp_path / "omni.yaml"), theta_max=np.pi).project(points)
    assert valid.all() and np.abs(pixels - (bent * [900, 905] + [640, 480])).max() < 1e-9
    (tmp_path / "ds.yaml").write_text(kalibr("ds", "none", [-0.2, 0.6, 300, 310, 640, 480], []))
    camera = load_camera(tmp_path / "ds.yaml")
    assert (camera.lens, camera.radial, camera.fx, camera.cy) == ("double_sphere", (-0.2, 0.6), 300, 480)


@pytest.mark.parametrize("linearity", [None, 0.0, 0.37, -0.2])
def test_cahvor_and_cahvore_with_a_turned_axis(linearity, tmp_path) -> None:
    """Against the published equations, each angle by bisection; its frame is that of the axis."""
    values = [500.0, 505.0, 640.0, 480.0, 0.03, -0.02, 0.05, -0.1, 0.02]
    pupil = [4e-3, -1e-3, 2e-4] if linearity is not None else []
    model = "LENSMODEL_CAHVOR" if linearity is None else f"LENSMODEL_CAHVORE_linearity={linearity}"
    text = mrcal(model, [*values, *pupil])
    (found,) = FORMATS["mrcal"].read(text)
    rng = np.random.default_rng(2)
    theta, phi = rng.uniform(0.01, 0.8, 60), rng.uniform(-np.pi, np.pi, 60)
    points = 0.2 * np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    expected = cahvore(*values, *(pupil or [0.0] * 3), linearity=1.0 if linearity is None else linearity)(points)
    pixels, valid = found.camera.project(points @ found.file_from_camera)
    assert valid.all() and np.abs(pixels - expected).max() < 1e-8
    assert found.camera.coefficients == tuple(pupil)
    (tmp_path / "front.cameramodel").write_text(text)
    assert "is turned by 2.06" in read_camera_file(tmp_path / "front.cameramodel").origin


@pytest.mark.parametrize("name", [one.name for one in FORMATS.values() if one.read and one.write])
def test_what_is_exported_is_read_again(name, tmp_path) -> None:
    camera = FisheyeCamera((1280, 960), 400, 401, 642.3, 477.7, radial=tuple(FISHEYE), theta_max=1.4)
    (path,) = export(camera, name, tmp_path / "camera.yaml").paths
    assert recognised(path.read_text()) is FORMATS[name]
    back = load_camera(path)
    loss = compare(camera, back, [1.0, np.inf], alignment="none").length_px
    assert np.nanmax(loss) < (0.1 if name == "mrcal" else 1e-6)


def test_one_of_several_cameras_is_named(tmp_path, command) -> None:
    one = yaml.safe_load(FILES["kalibr equi"][0])["cam0"]
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump({"cam0": one, "cam1": {**one, "resolution": [640, 480]}}))
    assert load_camera(tmp_path / "chain.yaml:cam1").image_size == (640, 480)
    assert command("show", "chain.yaml:cam0").out.startswith("cam0: 1280×960")
    command("show", "chain.yaml").refused(2, "chain.yaml", "cam0", "cam1", "FILE:cam0")
    command("show", "chain.yaml:cam2").refused(2, "chain.yaml", "'cam2'")
    (tmp_path / "plain.yaml").write_text(FILES["plumb_bob"][0])
    command("show", "plain.yaml:other").refused(2, "plain.yaml", "'other'")


@pytest.fixture
def theirs(tmp_path) -> tuple[FisheyeCamera, Path]:
    """A pinhole that sees a board, and its CameraInfo."""
    (tmp_path / "theirs.yaml").write_text(FILES["plumb_bob"][0])
    camera = load_camera(tmp_path / "theirs.yaml")
    save_observations(tmp_path / "front.npz", seen(camera, BOARD.object_points, poses_of(14, 1, 40.0), 0.1))
    return camera, tmp_path / "theirs.yaml"


def test_how_good_is_the_calibration_i_have(theirs, command) -> None:
    camera, path = theirs
    ended = command("evaluate", path, "front.npz", "--json")
    assert ended.code == 0, ended.err
    said = ended.json
    assert said["rms_px"] == pytest.approx(0.1 * np.sqrt(2), rel=0.1) and said["expected_rms_px"] is None
    assert "another_program" in {one["name"] for one in said["findings"]}
    assert "beyond_the_calibrated_field" not in {one["name"] for one in said["findings"]}
    told = command("evaluate", path, "front.npz").out
    assert "plumb_bob" in told and "nothing of its uncertainty" in told


def test_the_other_commands_take_it_too(theirs, command, tmp_path) -> None:
    camera, path = theirs
    shown = command("show", path, "--json").json
    assert shown["lens"] == "perspective" and "plumb_bob" in shown["origin"]
    assert "plumb_bob" in command("show", path).out
    save_camera(tmp_path / "ours.yaml", camera, "ours")
    assert load_camera(tmp_path / "ours.yaml") == camera
    ended = command("compare", path, "ours.yaml", "--json")
    assert ended.code == 0 and max(one["max_px"] for one in ended.json["distances"]) < 1e-6
    assert "A is read as" in command("compare", path, "ours.yaml").out
    cv2.imwrite(str(tmp_path / "image.png"), np.full((960, 1280), 90, np.uint8))
    ended = command("rectify", path, "image.png", "--output", "out", "--size", "64x48", "--svp")
    assert ended.code == 0, ended.err
    assert evaluate(path, seen(camera, BOARD.object_points, poses_of(6, 1, 40.0), 0.0)).rms_px < 1e-3


def test_what_mrcal_calibrated_from_may_be_many_megabytes(tmp_path, command) -> None:
    """As mrcal writes it: an .npz in base85, as bytes of Python."""
    inputs = base64.b85encode(np.random.default_rng(1).bytes(4 << 20))
    text = mrcal("LENSMODEL_OPENCV8", [*GRID, *RATIONAL])
    (tmp_path / "large.cameramodel").write_text(text.replace("}", f" 'optimization_inputs': {inputs!r},\n}}"))
    (tmp_path / "small.cameramodel").write_text(text)
    assert load_camera(tmp_path / "large.cameramodel") == load_camera(tmp_path / "small.cameramodel")
    assert command("show", "large.cameramodel").code == 0
    (tmp_path / "other.cameramodel").write_text(text.replace("}", f" 'notes': {inputs!r},\n}}"))
    command("show", "other.cameramodel").refused(2, "other.cameramodel", "too large for a camera file")


HOSTILE = {
    "four coefficients of either": opencv(".yaml", FISHEYE),
    "no size": opencv(".yaml", PLUMB_BOB).replace("image_width", "wide"),
    "another model": camera_info("fisheye_of_mine", FISHEYE),
    "too few": camera_info("equidistant", FISHEYE[:3]),
    "no number": camera_info("plumb_bob", PLUMB_BOB).replace("- -0.3", "- ham"),
    "not finite": camera_info("plumb_bob", PLUMB_BOB).replace("- 900.0", "- .nan"),
    "a large image": camera_info("plumb_bob", PLUMB_BOB).replace("1280", "12800000"),
    "size no number": camera_info("plumb_bob", PLUMB_BOB).replace("1280", "[1, 2]"),
    "kalibr without intrinsics": kalibr("pinhole", "radtan", [], PLUMB_BOB),
    "kalibr of a kind unknown": kalibr("eucm", "none", [0.6, 1.0, *GRID], []),
    "kalibr mangled": "cam0: [camera_model: 3, distortion_coeffs: [\n",
    "kalibr empty": "cam0:\n#camera_model:\n#distortion_coeffs:\n",
    "mrcal splined": mrcal("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", GRID),
    "mrcal short": mrcal("LENSMODEL_CAHVOR", GRID),
    "mrcal no literal": "{'lensmodel': __import__('os').system('touch pwned'), 'imagersize': 'LENSMODEL_'}",
    "mrcal deep": "LENSMODEL_ imagersize " + "(" * 20_000,
    "mrcal linearity": mrcal("LENSMODEL_CAHVORE_linearity=nan", [*GRID, *[0.0] * 8]),
    "xml bomb": '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bbbb"><!ENTITY c "&b;&b;">]><opencv_storage>&c;'
    "</opencv_storage>",
    "xml cut": opencv(".xml", FISHEYE, fisheye=1)[:300],
    "xml of other things": "<opencv_storage><a>1</a></opencv_storage>",
    "xml deep": "<opencv_storage>" + "<a>" * 30_000 + "</a>" * 30_000 + "</opencv_storage>",
    "matrix of another size": opencv(".yaml", PLUMB_BOB).replace("rows: 3", "rows: 300000"),
    "matrix of negative size": opencv(".yaml", PLUMB_BOB).replace("rows: 3", "rows: -3").replace("cols: 3", "cols: -3"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_end_in_one_line(name, tmp_path, command) -> None:
    (tmp_path / "bad.yaml").write_text(HOSTILE[name])
    command("show", "bad.yaml").refused(2, "bad.yaml")
    assert not (tmp_path / "pwned").exists()


@pytest.mark.parametrize("name", FILES)
def test_no_damage_to_a_file_ends_in_a_traceback(name, tmp_path, command) -> None:
    text, rng = FILES[name][0], np.random.default_rng(3)
    for number in range(40):
        damaged = list(text)
        for place in rng.integers(0, len(text), 3):
            damaged[place] = "x}[:-\n\0é9<"[rng.integers(10)]
        (tmp_path / "bad.yaml").write_text(
            "".join(damaged[: rng.integers(20, len(text) + 1)] if number % 2 else damaged)
        )
        ended = command("show", "bad.yaml", "--json")
        assert ended.code in (0, 2), ended.err
        if ended.code == 0:
            json.loads(ended.out)
