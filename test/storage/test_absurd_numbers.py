"""Numbers and sizes that no calibration has are refused with their key, before anything is made of them."""

from __future__ import annotations

import bz2
import io
import lzma
import resource
import struct
import time
import zipfile
import zlib

import numpy as np
import pytest
import yaml

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.npz_file import read_npz
from fisheye_ep_calib.storage.camera_file import read_camera_file, save_camera
from fisheye_ep_calib.storage.observation_file import load_observations
from fisheye_ep_calib.storage.rig_file import load_rig, places_yaml
from fisheye_ep_calib.target.registry import load_target
from fisheye_ep_calib.target.shape.frame import board_frame

GRID = np.stack([*np.meshgrid(np.arange(4) * 0.02, np.arange(3) * 0.02), np.zeros((3, 4))], axis=-1).reshape(-1, 3)
ARRAYS = {
    "object_points": GRID,
    "unit": np.array("m"),
    "image_index": np.repeat(np.arange(3), 12),
    "point_index": np.tile(np.arange(12), 3),
    "pixels": np.random.default_rng(1).uniform(0, 400, (36, 2)),
    "image_size": np.array([640, 480]),
    "weights": np.ones(36),
}


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("weights", np.full(36, 1e308), "weights has 1e\\+308"),
        ("weights", np.full(36, 1e-300), "weights has 1e-300"),
        ("object_points", GRID * 1e200, "object_points reaches"),
        ("object_points", GRID * 1e-9, "object_points span"),
        ("object_points", np.float64(3), "object_points"),
        ("object_points", np.zeros((10_001, 3)), "at most 10000"),
        ("disc_radius", np.array(1e200), "disc_radius reaches"),
        ("board_deviation", GRID * 1e100, "board_deviation moves"),
        ("image_names", np.full(1_000_001, "n"), "at most 1000000 images"),
        ("pixels", np.zeros((2, 2, 2)), "pixels cannot be read"),
        ("pixels", np.zeros((36, 2), dtype=complex), "pixels cannot be read"),
        ("image_index", np.full(36, np.iinfo(np.uint64).max), "too large"),
    ],
)
def test_observation_files(tmp_path, key, value, words) -> None:
    np.savez_compressed(tmp_path / "o.npz", **{**ARRAYS, key: value})
    with pytest.raises(InputError, match=words) as refused:
        load_observations(tmp_path / "o.npz")
    assert str(refused.value).startswith(f"{tmp_path / 'o.npz'}: ")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("object_points", GRID * 1e200, "object_points reaches"),
        ("object_points", np.zeros((10_001, 3)), "at most 10000"),
        ("object_points", [[0, 0, 0], [1]], "object_points must hold real numbers"),
        ("weights", np.full(36, 1e308), "weights has 1e\\+308"),
        ("pixels", np.full((36, 2), 1 + 1j), "pixels must hold real numbers"),
        ("pixels", [[1, 2], [3]], "pixels must hold real numbers"),
        ("pixels", "text", "pixels must hold real numbers"),
    ],
)
def test_arrays_in_python_too(key, value, words) -> None:
    arrays = {name: array for name, array in ARRAYS.items() if name != "unit"}
    with pytest.raises(InputError, match=words):
        Observations.create(**{**arrays, key: value})


def test_points_that_no_image_shows() -> None:
    """Memory goes with images × points: 2000 images of three points, of 9000, would take gigabytes."""
    rng = np.random.default_rng(1)
    arrays = {
        "object_points": rng.uniform(0, 1, (9000, 3)),
        "image_index": np.repeat(np.arange(2000), 3),
        "point_index": np.tile(np.arange(3), 2000),
        "pixels": rng.uniform(0, 400, (6000, 2)),
        "image_size": (640, 480),
    }
    with pytest.raises(InputError, match="2000 images show 3 of 9000 points each"):
        Observations.create(**arrays)
    arrays["object_points"] = arrays["object_points"][:12]
    assert Observations.create(**arrays).view_count == 2000


def test_a_large_target_that_is_not_flat_costs_nothing() -> None:
    points = np.random.default_rng(1).uniform(0, 1, (10_000, 3))
    began = time.process_time()
    assert np.linalg.det(board_frame(points).axes) == pytest.approx(1)
    assert time.process_time() - began < 1


def test_names_that_no_file_can_have() -> None:
    for read in (load_target, load_observations):
        for name in ("x" * 5000, "a\0b", "\x1b[31m"):
            with pytest.raises(InputError) as refused:
                read(name)
            assert str(refused.value).isprintable()


def header_of(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": shape})
    return head.getvalue()


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize(
    "content",
    [
        header_of((2**24, 2)) + bytes(2**28),  # holds what it promises
        header_of((36, 2)) + bytes(2**28),  # holds more
        header_of((10**12,), "<U0"),
        header_of((10**18, 10**18)),
        header_of((0, 10**18)),
        np.lib.format.magic(2, 0) + struct.pack("<I", 2**32 - 1) + b" " * 2**20,
    ],
    ids=range(6),
)
def test_a_member_that_would_fill_the_memory(tmp_path, method, content) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", method) as archive:
        archive.writestr("pixels.npy", content)
    del content
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    with pytest.raises(InputError, match="pixels"):
        read_npz(tmp_path / "bomb.npz", ["pixels"], [], "an observation file")
    assert time.process_time() - began < 2
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


@pytest.mark.parametrize("damage", [bz2.compress, lzma.compress, zlib.compress])
def test_members_packed_in_other_ways_or_damaged(tmp_path, damage) -> None:
    """The directory says one method, the data are of another."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("pixels.npy", header_of((36, 2)) + bytes(576))
    content = bytearray((tmp_path / "a.npz").read_bytes())
    packed = damage(b"something else")[:30]
    content[60 : 60 + len(packed)] = packed
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(InputError):
        read_npz(tmp_path / "a.npz", ["pixels"], [], "an observation file")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("type: chessboard\ncolumns: 500\nrows: 500\nspacing: 0.02\n", "250000 points"),
        ("type: chessboard\ncolumns: 1e300\nrows: 5\nspacing: 0.02\n", "columns"),
        ("type: chessboard\ncolumns: 9\nrows: 5\nspacing: 1e-300\n", "spacing"),
        ("type: chessboard\ncolumns: 9\nrows: 5\nspacing: 1e300\n", "spacing"),
        ("type: chessboard\ncolumns: 9\nrows: 5\nspacing: 0.02\nname: [" + "1," * 1000 + "]\n", "name"),
        ("type: chessboard\ncolumns: 9\nrows: 5\nspacing: 0.02\nname: " + "n" * 5000, "name"),
        ('type: chessboard\ncolumns: 9\nrows: 5\nspacing: 0.02\nname: "a\\eb"', "name"),
        ("target_type: aprilgrid\ntagCols: 500\ntagRows: 500\ntagSize: 0.02\ntagSpacing: 0.3\n", "tag"),
    ],
)
def test_target_files(tmp_path, text, words) -> None:
    (tmp_path / "t.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as refused:
        load_target(tmp_path / "t.yaml")
    assert len(str(refused.value)) < 300 and str(refused.value).isprintable()


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("entrance_pupil", "intrinsics", "fx"), 1e308, "fx is 1e\\+308"),
        (("entrance_pupil", "intrinsics", "fx"), 1e-308, "fx is 1e-308"),
        (("entrance_pupil", "radial"), [1e200, 0.0, 0.0, 0.0], "k1 is 1e\\+200"),
        (("entrance_pupil", "coefficients"), [1e308, 0.0], "e1 is 1e\\+308"),
        (("camera_matrix", "data"), [1e308, 0, 9, 0, 300, 9, 0, 0, 1], "fx is 1e\\+308"),
        (("image_width",), 10**17, "pixels is not possible"),
        (("entrance_pupil", "calibration"), {"note": {"a": [1]}}, "calibration: note"),
        (("entrance_pupil", "calibration"), {"board_warp": [1e300, 0.0, 0.0]}, "board_warp holds"),
        (("entrance_pupil", "covariance"), (-np.eye(11)).tolist(), "covariance has -1 for fx"),
    ],
)
def test_camera_files(tmp_path, keys, value, words) -> None:
    camera = FisheyeCamera((640, 480), 300, 300, 320, 240, model="ep_even", coefficients=(-0.001, 0.0))
    save_camera(tmp_path / "c.yaml", camera)
    content = block = yaml.safe_load((tmp_path / "c.yaml").read_text())
    for key in keys[:-1]:
        block = block[key]
    block[keys[-1]] = value
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=words):
        read_camera_file(tmp_path / "c.yaml")


def test_lenses_without_a_radius_on_the_axis(tmp_path) -> None:
    save_camera(tmp_path / "c.yaml", FisheyeCamera((640, 480), 300, 300, 320, 240))
    content = yaml.safe_load((tmp_path / "c.yaml").read_text())
    block = content["entrance_pupil"]
    del block["parameters"]
    for lens, radial in (("double_sphere", [-1.0, 0.5]), ("cahvore", [0.5, -2.0, 0.0, 0.0])):
        block |= {"lens": lens, "radial": radial}
        (tmp_path / "c.yaml").write_text(yaml.safe_dump(content))
        with pytest.raises(InputError, match=f"the image radius of {lens} does not rise"):
            read_camera_file(tmp_path / "c.yaml")
    kalibr = {"camera_model": "ds", "intrinsics": [-1.0, 0.5, 300, 300, 320, 240], "resolution": [640, 480]}
    (tmp_path / "k.yaml").write_text(
        yaml.safe_dump({"cam0": {**kalibr, "distortion_model": "none", "distortion_coeffs": []}})
    )
    with pytest.raises(InputError, match="the image radius of double_sphere does not rise"):
        read_camera_file(tmp_path / "k.yaml")


def test_rig_files(tmp_path) -> None:
    far = np.eye(4)
    far[0, 3] = 1e300
    (tmp_path / "rig.yaml").write_text(places_yaml({"a": np.eye(4), "b": far}))
    with pytest.raises(InputError, match="reference_from_camera"):
        load_rig(tmp_path / "rig.yaml")


@pytest.mark.parametrize(
    ("names", "words"), [((), "cameras has none"), (("a/b",), "camera 'a/b'"), (("ä" * 150,), "200 bytes")]
)
def test_rigs_whose_cameras_make_no_files(tmp_path, names, words) -> None:
    content = yaml.safe_load(places_yaml({"a": np.eye(4)}))
    content["cameras"] = {name: content["cameras"]["a"] for name in names}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    with pytest.raises(InputError, match=words) as refused:
        load_rig(tmp_path / "rig.yaml")
    assert str(refused.value).startswith(f"{tmp_path / 'rig.yaml'} is not a rig file")
