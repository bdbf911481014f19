"""Bad input gets one clear line, exit 1 or 2, nothing on stdout, nothing written, and never a traceback."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

BOARD = "type: chessboard\ncolumns: 9\nrows: 6\nspacing: 0.02\n"


def changed(path: Path, **change) -> dict:
    """The arrays of an observation file with some replaced, or left out where None."""
    arrays = {**dict(np.load(path)), **change}
    return {key: value for key, value in arrays.items() if value is not None}


def first(array: np.ndarray, value) -> np.ndarray:
    array = array.copy()
    array[0] = value
    return array


def test_sources_that_are_not_there(command, tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "board.yaml").write_text(BOARD)
    command("calibrate", "no.npz").refused(2, "no.npz does not exist")
    command("calibrate", "no.mcap", "--target", "board.yaml").refused(2, "no.mcap")
    command("calibrate", "no", "--target", "board.yaml").refused(2, "no")
    command("calibrate", "empty", "--target", "board.yaml").refused(2, "empty holds neither a bag", "nor images")
    command("calibrate", "empty").refused(2, "images need --target TARGET.yaml")
    command("evaluate", "no.yaml", "no.npz").refused(2, "cannot read camera file no.yaml")
    command("show", "no.yaml").refused(2, "cannot read camera file no.yaml: No such file")
    command("show", "empty").refused(2, "cannot read camera file empty: Is a directory")
    command("calibrate").refused(2, "SOURCE", "--help")
    command("colibrate").refused(2, "invalid choice: 'colibrate'")
    command().refused(2, "COMMAND")


def test_recordings_without_images_or_content(command, tmp_path) -> None:
    (tmp_path / "board.yaml").write_text(BOARD)
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "text.mcap").write_bytes(b"not a bag")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "notes.txt").write_text("no image")
    for source in ("empty.mcap", "text.mcap", "folder"):
        command("calibrate", source, "--target", "board.yaml").refused(2, source)
    (tmp_path / "folder" / "broken.png").write_bytes(b"\x89PNG broken")
    ended = command("calibrate", "folder", "--target", "board.yaml")
    assert ended.code in (1, 2) and "error: " in ended.err and ended.out == ""
    assert not (tmp_path / "calibration").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: {"unit": None}, ["has no unit", "needs object_points"]),
        (lambda a: {"pixels": None, "image_size": None}, ["has no pixels, image_size"]),
        (lambda a: {"unit": np.array("inch")}, ['"mm" or "m"', "inch"]),
        (lambda a: {"unit": np.array(3.0)}, ["unit"]),
        (lambda a: {"pixels": np.array([{}], dtype=object)}, ["pixels cannot be read", "allow_pickle"]),
        (lambda a: {"pixels": a["pixels"].astype(str)}, ["pixels must hold numbers"]),
        (lambda a: {"pixels": a["pixels"][:-1]}, ["one row an observation"]),
        (lambda a: {"pixels": first(a["pixels"], np.nan)}, ["observation 0", "not finite"]),
        (lambda a: {"pixels": first(a["pixels"], 5000.0)}, ["observation 0", "outside the 1600×1200 image"]),
        (lambda a: {"point_index": first(a["point_index"], 99)}, ["point_index must lie in 0..53"]),
        (lambda a: {"point_index": first(a["point_index"], a["point_index"][1])}, ["the same point twice"]),
        (lambda a: {"image_index": first(a["image_index"], -2)}, ["image_index must not be negative"]),
        (lambda a: {"image_index": a["image_index"] + 0.5}, ["image_index must hold whole numbers"]),
        (lambda a: {"image_index": first(a["image_index"], 10**12)}, ["image_index reaches"]),
        (lambda a: {"image_size": np.array([0, 5])}, ["image_size"]),
        (lambda a: {"image_size": np.array([1600])}, ["image_size"]),
        (lambda a: {"object_points": a["object_points"] * np.inf}, ["object_points must be finite"]),
        (lambda a: {"weights": -a["weights"]}, ["weights"]),
        (lambda a: {"image_names": np.array(["one"])}, ["image_names is shorter"]),
        (lambda a: {"split": np.array(["train"])}, ["split must have one entry an image"]),
        (lambda a: {"disc_radius": np.array(-1.0)}, ["disc_radius"]),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_observation_files_that_contradict_themselves(command, observation_file, tmp_path, change, words) -> None:
    np.savez("bad.npz", **changed(observation_file, **change(dict(np.load(observation_file)))))
    command("calibrate", "bad.npz", "--json").refused(2, "bad.npz", *words)
    assert not (tmp_path / "calibration").exists()


def test_observation_files_that_are_damaged(command, observation_file, tmp_path) -> None:
    content = observation_file.read_bytes()
    flipped = bytearray(content)
    flipped[len(content) // 2] ^= 0xFF
    one = np.lib.format.magic(1, 0) + b"v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (3,), }"
    damaged = {
        "cut": content[: len(content) // 2],
        "text": b"hello",
        "nothing": b"",
        "flipped": bytes(flipped),
        "npy": one,
    }
    for name, data in damaged.items():
        (tmp_path / f"{name}.npz").write_bytes(data)
        command("calibrate", f"{name}.npz").refused(2, f"{name}.npz")
    (tmp_path / "folder.npz").mkdir()
    command("calibrate", "folder.npz").refused(2, "folder.npz is not a file")


def test_too_few_views_and_views_all_alike(command, observation_file, tmp_path) -> None:
    arrays = dict(np.load(observation_file))
    rows = ("image_index", "point_index", "pixels", "weights")
    few = arrays["image_index"] < 2
    np.savez("few.npz", **changed(observation_file, **{key: arrays[key][few] for key in rows}))
    command("calibrate", "few.npz").refused(1, "2 views have", "at least 3 are needed", "record more views")
    own = arrays["image_index"] == 0
    count = int(own.sum())
    alike = {key: np.concatenate([arrays[key][own]] * 12) for key in rows}
    alike["image_index"] = np.repeat(np.arange(12), count)
    np.savez("alike.npz", **changed(observation_file, **alike))
    command("calibrate", "alike.npz").refused(1, "all 12 views are alike", "move and tilt the target")
    assert not (tmp_path / "calibration").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "type: chessboard\ncolumns: 9\nrows: 6\nspacing: -0.02\n",
            ["spacing must be a positive number, not -0.02"],
        ),
        ("type: chessboard\ncolumns: 9\nrows: 6\nspacing: .nan\n", ["spacing must be a positive number"]),
        ("type: dartboard\n", ["unknown type 'dartboard'", "chessboard"]),
        ("type: chessboard\ncolumns: 9\nspacing: 0.02\n", ["rows is missing"]),
        ("type: chessboard\ncolumns: 9\nrows: 6\nspaceing: 0.02\n", ["spac"]),
        ("", ["a list of keys and values"]),
        ("[1, 2]", ["a list of keys and values"]),
        ("\0\0", ["not valid YAML"]),
        ("[" * 5000, ["not valid YAML"]),
        ("!!python/object/apply:os.system ['touch pwned']", ["not valid YAML"]),
    ],
)
def test_target_files_that_describe_no_target(command, tmp_path, text, words) -> None:
    (tmp_path / "board.yaml").write_text(text)
    (tmp_path / "images").mkdir()
    command("calibrate", "images", "--target", "board.yaml").refused(2, "board.yaml", *words)
    assert not (tmp_path / "pwned").exists()


def test_a_target_file_that_is_not_there(command, tmp_path) -> None:
    (tmp_path / "images").mkdir()
    command("calibrate", "images", "--target", "no.yaml").refused(2, "cannot read target file no.yaml")
    command("calibrate", "images", "--target", "images").refused(2, "cannot read target file images")


def edited(path: Path, *keys: str, value) -> str:
    """The camera file's text with one value replaced; KeyError takes it away."""
    content = yaml.safe_load(path.read_text())
    block = content
    for key in keys[:-1]:
        block = block[key]
    block[keys[-1]] = value
    if value is KeyError:
        del block[keys[-1]]
    return yaml.safe_dump(content)


_EP = "entrance_pupil"
_LAUGHS = "a: &a [l, l, l, l, l, l, l, l, l]\n" + "".join(
    f"{name}: &{name} [{', '.join(['*' + before] * 9)}]\n" for before, name in zip("abcdef", "bcdefg", strict=True)
)


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("image_width",), KeyError),
        (("image_width",), "wide"),
        (("image_width",), -5),
        (("image_width",), 1e300),
        (("image_height",), 10**9),
        (("image_height",), float("nan")),
        (("distortion_model",), "plumb_bob"),
        (("camera_matrix",), KeyError),
        (("camera_matrix", "data"), [1.0, 2.0]),
        (("camera_matrix", "data"), [float("nan")] * 9),
        (("camera_matrix", "data"), "abcdefghi"),
        (("distortion_coefficients", "data"), [0.1]),
        (("camera_name",), ["front"]),
        ((_EP,), [1, 2]),
        ((_EP, "schema"), 7),
        ((_EP, "schema"), KeyError),
        ((_EP, "model"), "ep_cubic"),
        ((_EP, "model"), None),
        ((_EP, "lens"), "pinhole"),
        ((_EP, "intrinsics"), KeyError),
        ((_EP, "intrinsics", "fx"), float("inf")),
        ((_EP, "intrinsics", "fx"), -1.0),
        ((_EP, "intrinsics", "fx"), "1e400"),
        ((_EP, "radial"), [0.0]),
        ((_EP, "radial"), None),
        ((_EP, "coefficients"), [float("nan"), 0.0]),
        ((_EP, "coefficients"), [0.0] * 9),
        ((_EP, "tilt"), [0.1]),
        ((_EP, "theta_max"), 0.0),
        ((_EP, "theta_max"), 400.0),
        ((_EP, "parameters"), ["fx"]),
        ((_EP, "covariance"), [[1.0]]),
        ((_EP, "covariance"), [[float("nan")] * 11] * 11),
        ((_EP, "covariance"), "none"),
        ((_EP, "projection_uncertainty", "sigma_px"), [[1.0]]),
        ((_EP, "svp"), [1]),
        ((_EP, "svp", "distance"), -1.0),
        ((_EP, "svp", "distance"), float("nan")),
        ((_EP, "calibration"), "good"),
        ((_EP, "calibration", "board_warp"), [1.0] * 9),
        ((_EP, "calibration", "board_warp"), [float("nan")]),
        ((_EP, "calibration", "views"), {"many": 3}),
    ],
    ids=str,
)
def test_camera_files_with_a_wrong_value(command, camera_file, tmp_path, keys, value) -> None:
    (tmp_path / "bad.yaml").write_text(edited(camera_file, *keys, value=value))
    for words in (("show", "bad.yaml"), ("show", "bad.yaml", "--json"), ("evaluate", "bad.yaml", "any.npz")):
        command(*words).refused(2, "bad.yaml")


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:200],
        lambda text: text[: text.index("coefficients: [", text.index(_EP)) + 30],
        lambda text: "",
        lambda text: "\0" + text,
        lambda text: b"\xff\xfe" + text.encode(),
        lambda text: "just words",
        lambda text: "[1, 2]",
        lambda text: "[" * 100_000,
        lambda text: "{a: " * 3000,
        lambda text: text.replace("model: ep_even", "model: !!python/object/apply:os.system ['touch pwned']"),
        lambda text: text.replace("camera_name: front", "camera_name: !!python/name:os.system"),
        lambda text: text.replace("camera_name: front", "camera_name: !odd front"),
        lambda text: text.replace("    views: 12", "    views: &x [*x]"),
        lambda text: _LAUGHS + text.replace("camera_name: front", "camera_name: *g"),
        lambda text: _LAUGHS + text.replace("    views: 12", "    views: *g"),
        lambda text: text.replace("    views: 12", "    views: !!set {a, b}"),
        lambda text: text.replace("    views: 12", "    views: !!binary aGVsbG8="),
        lambda text: text + "#" * (2 << 20),
    ],
)
def test_camera_files_that_are_damaged_or_hostile(command, camera_file, tmp_path, damage) -> None:
    content = damage(camera_file.read_text())
    (tmp_path / "bad.yaml").write_bytes(content if isinstance(content, bytes) else content.encode())
    for words in (("show", "bad.yaml"), ("show", "bad.yaml", "--json"), ("evaluate", "bad.yaml", "any.npz")):
        ended = command(*words)
        ended.refused(2, "bad.yaml")
        assert len(ended.err) < 500
    assert not (tmp_path / "pwned").exists()


def test_a_camera_file_edited_by_hand_is_read(command, camera_file, tmp_path) -> None:
    """A date without quotes is a date to YAML, and nothing says that a number may not be missing."""
    text = camera_file.read_text()
    date = text[text.index("date: '") :].splitlines()[0]
    text = text.replace(date, "date: 2026-01-31T12:00:00+00:00").replace(
        "    noise_px:", "    noise_px: .nan\n    other:"
    )
    (tmp_path / "edited.yaml").write_text(text)
    facts = command("show", "edited.yaml", "--json").json["calibration"]
    assert facts["date"] == "2026-01-31T12:00:00+00:00" and facts["noise_px"] is None
    assert command("show", "edited.yaml").code == 0


def test_evaluate_refuses_images_of_another_size(command, camera_file, observation_file) -> None:
    np.savez("other.npz", **changed(observation_file, image_size=np.array([1600, 1201])))
    command("evaluate", camera_file, "other.npz", "--json").refused(2, "1600×1200", "1600×1201")


def test_evaluate_refuses_what_the_camera_does_not_fit(command, camera_file, observation_file) -> None:
    pixels = np.random.default_rng(1).uniform(0, 1199, dict(np.load(observation_file))["pixels"].shape)
    np.savez("other.npz", **changed(observation_file, pixels=pixels))
    command("evaluate", camera_file, "other.npz").refused(1, "no view fits the camera")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--model", "pinhole"], ["invalid choice: 'pinhole'", "ep_even"]),
        (["--model", "ep_odd", "--terms", "9"], ["ep_odd takes 1 to 4 terms, not 9"]),
        (["--terms", "many"], ["--terms", "many"]),
        (["--lens", "pinhole"], ["invalid choice: 'pinhole'"]),
        (["--svp-distance", "0"], ["--svp-distance must be positive, not"]),
        (["--svp-distance", "nan"], ["--svp-distance must be positive, not"]),
        (["--split", "validation"], ["marks no image as validation"]),
        (["--topic", "front=/image"], ["--topic", "observation file"]),
        (["--output", "file"], ["--output", "file is not a folder"]),
        (["--all", "--every", "2"], ["--every", "not allowed with argument --all"]),
        (["--output", "file/below"], ["--output", "is not a folder"]),
    ],
)
def test_wishes_that_cannot_be_met(command, observation_file, tmp_path, words, told) -> None:
    (tmp_path / "file").touch()
    command("calibrate", observation_file, *words).refused(2, *told)
    assert not (tmp_path / "calibration").exists() and not (tmp_path / "file").read_bytes()


def test_files_of_one_name_and_mixed_sources(command, observation_file, tmp_path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "board.yaml").write_text(BOARD)
    shutil.copy(observation_file, tmp_path / "front.npz")
    shutil.copy(observation_file, tmp_path / "other" / "Front.npz")
    command("calibrate", "front.npz", "other/Front.npz").refused(2, "would both be called Front", "rename one")
    command("calibrate", "front.npz", "other", "--target", "board.yaml").refused(2, "not both at once")
    command("calibrate", "other", "--target", "board.yaml", "--split", "train").refused(
        2, "--split", "observation files"
    )


def test_cameras_that_cannot_be_compared_are_named(command, camera_file, tmp_path) -> None:
    other = yaml.safe_load(Path(camera_file).read_text())
    other["image_width"] += 2
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(other))
    command("compare", camera_file, "wide.yaml").refused(2, str(camera_file), "and wide.yaml: ", "cannot be compared")
