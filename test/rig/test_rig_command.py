"""fisheye_ep_calib rig, as it is typed, and the files it writes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from simulated_rig import NAMES, cameras, errors, place, see, targets_between, write_camera

from fisheye_ep_calib.cli import main
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.simulation import Imaging, StampedImage, paper_target, render, write_bag
from fisheye_ep_calib.storage.observation_file import load_observations, save_observations
from fisheye_ep_calib.storage.rig_file import load_rig
from fisheye_ep_calib.target import Detection
from fisheye_ep_calib.target.discs.circle_grid_detector import CircleGridDetector

DISCS = paper_target()
PLACES = [np.eye(4), place(60, (0.08, 0.01, -0.03), (0.05, 0.0, 0.02)), place(120, (0.05, -0.02, -0.12))]
TARGET = "type: circle_grid\ncolumns: 11\nrows: 7\nspacing: 0.012\nradius: 0.004\n"
START_NS = 1_700_000_000 * 10**9


@pytest.fixture
def three_cameras(tmp_path: Path) -> list[str]:
    """Observation files and camera files of a chain; the arguments that name them."""
    models = cameras(3, theta_max_deg=60)
    poses = [targets_between(PLACES[i], PLACES[i + 1], DISCS, 6, seed=i + 1) for i in range(2)]
    arguments = []
    for name, model, one in zip(NAMES, models, see(models, PLACES, DISCS, np.concatenate(poses)), strict=True):
        stamps = START_NS + one.stamps_ns
        names = tuple(f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in stamps.tolist())
        save_observations(tmp_path / f"{name}.npz", replace(one.observations, image_names=names))
        write_camera(tmp_path / f"{name}.yaml", model, name)
        arguments += [str(tmp_path / f"{name}.npz"), "--camera", f"{name}={tmp_path / name}.yaml"]
    return ["rig", *arguments[::3], *[part for i in range(3) for part in arguments[3 * i + 1 : 3 * i + 3]]]


def test_observation_files_of_a_chain(three_cameras, tmp_path, capsys) -> None:
    output = tmp_path / "rig"
    assert main([*three_cameras, "--output", str(output), "--json"]) == 0
    captured = capsys.readouterr()
    said = json.loads(captured.out)
    assert said["reference"] == "front" and said["cameras"]["rear"]["joined_through"] == ["front", "left", "rear"]
    assert "joined through left" in captured.err

    file = load_rig(output / "rig.yaml")
    assert file.reference == "front" and list(file.reference_from_camera) == list(NAMES)
    assert (output / file.camera_files["left"]).resolve() == tmp_path / "left.yaml"
    for number, name in enumerate(NAMES):
        angle, distance = errors(file.reference_from_camera[name], PLACES[number])
        assert angle < 1e-3 and distance < 1e-4

    taken = tmp_path / "taken"
    (taken / "camchain.yaml").mkdir(parents=True)
    assert main([*three_cameras, "--output", str(taken), "--overwrite"]) == 1
    assert "camchain.yaml: it is a folder" in capsys.readouterr().err
    assert not (taken / "rig.yaml").exists()

    chain = yaml.safe_load((output / "camchain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1", "cam2"] and "T_cn_cnm1" not in chain["cam0"]
    step = np.array(chain["cam2"]["T_cn_cnm1"])
    expected = np.linalg.inv(file.reference_from_camera["rear"]) @ file.reference_from_camera["left"]
    assert np.allclose(step, expected)
    assert [chain[f"cam{i}"]["cam_overlaps"] for i in range(3)] == [[1], [0, 2], [1]]
    assert chain["cam1"]["camera_model"] == "pinhole" and chain["cam1"]["distortion_model"] == "equidistant"
    assert len(chain["cam1"]["intrinsics"]) == 4 and chain["cam1"]["resolution"] == [2048, 2048]

    assert main([*three_cameras, "--output", str(output)]) == 2
    assert "rig.yaml is there already" in capsys.readouterr().err
    assert main([*three_cameras, "--output", str(output), "--overwrite", "--board-warp"]) == 0


def small(camera):
    """The same lens on a quarter of the pixels."""
    half = {name: getattr(camera, name) / 2 for name in ("fx", "fy", "skew", "cx", "cy")}
    return replace(camera, image_size=(1024, 1024), **half)


@pytest.fixture(scope="module")
def rendered() -> tuple[list, list[list[np.ndarray]]]:
    """Two small cameras and their images of five moments."""
    models = [small(model) for model in cameras(2)]
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 5, seed=3, distance=(0.1, 0.18))
    images = [
        [render(model, DISCS, np.linalg.inv(pose) @ board, Imaging(blur=0.6, noise=1.0)) for board in poses]
        for model, pose in zip(models, PLACES[:2], strict=True)
    ]
    return models, images


def prepare(folder: Path, models) -> list[str]:
    (folder / "target.yaml").write_text(TARGET)
    arguments = ["--target", str(folder / "target.yaml"), "--workers", "1"]
    for name, model in zip(NAMES, models, strict=False):
        write_camera(folder / f"{name}.yaml", model, name)
        arguments += ["--camera", f"{name}={folder / name}.yaml"]
    return arguments


def test_a_bag(rendered, tmp_path, capsys) -> None:
    """Taken a millisecond apart, and one image that nothing goes with."""
    models, images = rendered
    stamped = [
        StampedImage(f"/{NAMES[c]}/image_raw", START_NS + 10**8 * moment + 10**6 * c, NAMES[c], images[c][moment])
        for moment in range(5)
        for c in range(2)
    ]
    blank = np.zeros((1024, 1024), np.uint8)
    stamped += [StampedImage("/front/image_raw", START_NS + 10**9, "front", blank)]
    write_bag(tmp_path / "bag.mcap", stamped)
    arguments = ["rig", str(tmp_path / "bag.mcap"), *prepare(tmp_path, models), "--output", str(tmp_path / "out")]
    assert main(arguments) == 0, capsys.readouterr().err
    out = capsys.readouterr().out
    assert "2 cameras, 5 common views" in out and "front and left: 5 common views" in out
    found = load_rig(tmp_path / "out" / "rig.yaml")
    angle, distance = errors(found.reference_from_camera["left"], PLACES[1])
    assert angle < 2e-3 and distance < 2e-4
    assert yaml.safe_load((tmp_path / "out" / "camchain.yaml").read_text())["cam1"]["rostopic"] == "/left/image_raw"

    saved = [str(tmp_path / "out" / "rig_observations" / f"{name}.npz") for name in NAMES[:2]]
    cameras_ = arguments[arguments.index("--camera") : arguments.index("--output")]
    assert main(["rig", *saved, *cameras_, "--output", str(tmp_path / "again")]) == 0
    again = load_rig(tmp_path / "again" / "rig.yaml")
    assert np.allclose(again.reference_from_camera["left"], found.reference_from_camera["left"], atol=1e-9)


@pytest.fixture
def bag(rendered, tmp_path) -> list[str]:
    """The arguments that calibrate the rig of five moments in a bag; without a word about workers."""
    models, images = rendered
    stamped = [
        StampedImage(f"/{NAMES[c]}/image_raw", START_NS + 10**8 * moment + 10**6 * c, NAMES[c], images[c][moment])
        for moment in range(5)
        for c in range(2)
    ]
    write_bag(tmp_path / "bag.mcap", stamped)
    arguments = prepare(tmp_path, models)
    del arguments[arguments.index("--workers") : arguments.index("--workers") + 2]
    return ["rig", str(tmp_path / "bag.mcap"), *arguments]


def seen(output: Path) -> list[bytes]:
    return [load_observations(output / "rig_observations" / f"{name}.npz").pixels.tobytes() for name in NAMES[:2]]


def test_any_number_of_workers_sees_the_same(bag, tmp_path) -> None:
    for workers in ("1", "2"):
        assert main([*bag, "--workers", workers, "--output", str(tmp_path / workers)]) == 0
    assert seen(tmp_path / "1") == seen(tmp_path / "2")
    texts = [(tmp_path / workers / "rig.yaml").read_text().split("date:")[0] for workers in ("1", "2")]
    assert texts[0] == texts[1]


def test_images_are_looked_at_again_where_the_cameras_say(bag, tmp_path, monkeypatch) -> None:
    """The first look misses half of the target."""
    whole = CircleGridDetector.detect

    def half(self, image) -> Detection:
        found = whole(self, image)
        return Detection(found.point_index[::2], found.pixels[::2])

    monkeypatch.setattr(CircleGridDetector, "detect", half)
    assert main([*bag, "--workers", "1", "--output", str(tmp_path / "out")]) == 0
    for name in NAMES[:2]:
        observations = load_observations(tmp_path / "out" / "rig_observations" / f"{name}.npz")
        assert np.bincount(observations.image_index).min() > 70


def test_what_was_found_is_kept_until_it_is_written(bag, tmp_path, monkeypatch, capsys) -> None:
    output = tmp_path / "out"
    bag += ["--workers", "1", "--output", str(output)]

    def refuse(*_) -> None:
        raise CalibrationError("cannot write: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("fisheye_ep_calib.commands.rig.save_observations", refuse)
        assert main(bag) == 1
    assert "what 10 images showed is kept in" in (said := capsys.readouterr().err) and "--resume goes on" in said
    with monkeypatch.context() as patch:
        patch.setattr(CircleGridDetector, "detect", refuse)  # every first look is known
        assert main([*bag, "--resume"]) == 0, capsys.readouterr().err
    assert load_rig(output / "rig.yaml").reference == "front"
    assert not list(tmp_path.rglob("*rig_detections*"))


def test_a_camera_that_is_another_one_is_named(bag, tmp_path, capsys) -> None:
    file = tmp_path / "left.yaml"
    content = yaml.safe_load(file.read_text())
    content["entrance_pupil"]["intrinsics"] |= {"cx": 20.0, "cy": 900.0, "fx": 100.0}
    file.write_text(yaml.safe_dump(content))
    assert main([*bag, "--workers", "1", "--output", str(tmp_path / "out")]) == 1
    assert "left: no view fits the camera: is this the right camera file" in capsys.readouterr().err


FOLDERS = {  # names of the two cameras' images, and how many are common, or why that is not known
    "numbers": ([f"{i}.png" for i in range(5)], [f"{i}.png" for i in range(5)], 5),
    "numbers, the first is missing": ([f"a{i}.png" for i in range(5)], [None, *(f"b{i}.png" for i in range(1, 5))], 4),
    "microseconds, the first is missing": (
        [f"{START_NS // 1000 + 50000 * i}.png" for i in range(5)],
        [None, *(f"{START_NS // 1000 + 50000 * i + 300}.png" for i in range(1, 5))],
        4,
    ),
    "order": (["one.png", "two.png", "ui.png", "vi.png", "xi.png"], [f"{x}.png" for x in "pqrst"], 5),
    "no order": (
        ["one.png", "two.png", "ui.png", "vi.png", None],
        ["p.png", "q.png", "r.png", "s.png", "t.png"],
        "front 4",
    ),
    "far apart": (
        [f"{START_NS + 10**9 * i}.png" for i in range(5)],
        [f"{START_NS + 10**9 * i + 3 * 10**8}.png" for i in range(5)],
        "front and left are 0.300 s apart at least; --tolerance",
    ),
}


@pytest.mark.parametrize("names", FOLDERS)
def test_folders_of_images(rendered, tmp_path, capsys, names) -> None:
    models, images = rendered
    *of_cameras, expected = FOLDERS[names]
    for name, files, of_camera in zip(NAMES, of_cameras, images, strict=False):
        (tmp_path / "images" / name).mkdir(parents=True)
        for file, image in zip(files, of_camera, strict=True):
            if file is not None:
                cv2.imwrite(str(tmp_path / "images" / name / file), image)
    arguments = ["rig", str(tmp_path / "images"), *prepare(tmp_path, models), "--output", str(tmp_path / "out")]
    if isinstance(expected, str):
        assert main(arguments) == 2
        assert expected in capsys.readouterr().err
        return
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert f"{expected} common views" in captured.out
    assert ("paired by" in captured.err) == (names not in ("numbers", "microseconds, the first is missing"))
    found = load_rig(tmp_path / "out" / "rig.yaml")
    assert errors(found.reference_from_camera["left"], PLACES[1])[1] < 3e-4


def test_clocks_that_differ_are_found(three_cameras, tmp_path, capsys) -> None:
    """One camera's clock is 3.7 s ahead: some of its images still fall on others of the first, and contradict them."""
    file = tmp_path / "left.npz"
    seen = load_observations(file)
    times = [int(name.replace(".", "")) + 37 * 10**8 for name in seen.image_names]
    names = tuple(f"{time // 10**9}.{time % 10**9:09d}" for time in times)
    save_observations(file, replace(seen, image_names=names))
    assert main([*three_cameras, "--output", str(tmp_path / "no")]) == 1
    assert "--time-offset auto" in capsys.readouterr().err
    assert main([*three_cameras, "--output", str(tmp_path / "yes"), "--time-offset", "auto", "--json"]) == 0
    captured = capsys.readouterr()
    assert abs(json.loads(captured.out)["clock_offsets_s"]["left"] - 3.7) < 2e-3
    assert "the clock of left is 3" in captured.err and "ahead of that of front" in captured.err
    found = load_rig(tmp_path / "yes" / "rig.yaml")
    assert all(errors(found.reference_from_camera[name], PLACES[i])[1] < 1e-4 for i, name in enumerate(NAMES))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--camera", "a=x.yaml"], "two cameras at least"),
        (["--camera", "a=x.yaml", "--camera", "a=y.yaml"], "two cameras are called a"),
        (["--camera", "../a=x.yaml", "--camera", "b=y.yaml"], "letters, digits"),
        (["--camera", "a", "--camera", "b=y.yaml"], "NAME=CAMERA.yaml"),
        (["--camera", "a=/nowhere/x.yaml", "--camera", "b=y.yaml"], "/nowhere/x.yaml"),
        (["--camera", "a=x.yaml", "--camera", "b=y.yaml", "--tolerance", "-1"], "--tolerance"),
        (["--camera", "a=x.yaml", "--camera", "b=y.yaml", "--max-moments", "0"], "--max-moments"),
    ],
)
def test_wrong_arguments(tmp_path, capsys, arguments, complaint) -> None:
    assert main(["rig", str(tmp_path), "--output", str(tmp_path / "out"), *arguments]) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_camera_without_a_file_or_a_topic(three_cameras, tmp_path, capsys) -> None:
    files, rest = three_cameras[1:4], three_cameras[4:]
    assert main(["rig", *files[:2], *rest, "--output", str(tmp_path / "out")]) == 2
    assert "no rear.npz" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "not a rig file"),
        ("[1, 2]", "not a rig file"),
        ("{schema: 2}", "schema 2"),
        ("{schema: 1, reference: a, cameras: {a: {}}}", "reference_from_camera"),
        ("{schema: 1, reference: a, cameras: {a: {reference_from_camera: [[1]]}}}", "not a rig file"),
        ("a: [", "not valid YAML"),
    ],
)
def test_rig_files_that_are_none(tmp_path, content, complaint) -> None:
    (tmp_path / "rig.yaml").write_text(content)
    with pytest.raises(InputError, match=complaint):
        load_rig(tmp_path / "rig.yaml")
    pose = np.diag([1.0, 1.0, 2.0, 1.0]).tolist()
    rig = {"schema": 1, "reference": "a", "cameras": {"a": {"reference_from_camera": pose}}}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    with pytest.raises(InputError, match="not a rigid transform"):
        load_rig(tmp_path / "rig.yaml")
