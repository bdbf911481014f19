"""Observation files: exact round trips, and one clear line for everything that is not one."""

import io
import zipfile

import numpy as np
import pytest

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.observation_file import load_observations, save_observations


def valid_arrays(**changes) -> dict:
    arrays = {
        "object_points": np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0]]),
        "unit": np.array("mm"),
        "image_index": np.array([0, 0, 1]),
        "point_index": np.array([0, 2, 1]),
        "pixels": np.array([[10.0, 20], [30, 40.25], [5, 6]]),
        "image_size": np.array([640, 480]),
    }
    arrays.update(changes)
    return {key: value for key, value in arrays.items() if value is not None}


def write(path, **changes):
    np.savez(path, **valid_arrays(**changes))
    return path


def test_millimetres_become_metres_and_other_keys_are_ignored(tmp_path):
    path = write(tmp_path / "a.npz", disc_radius=np.array(4.0), more=np.array(["x"], dtype=object))
    observations = load_observations(path)
    np.testing.assert_allclose(observations.object_points[1], [0.01, 0, 0])
    assert observations.disc_radius == pytest.approx(0.004)
    assert observations.image_size == (640, 480)
    assert observations.image_names == ("0", "1")
    np.testing.assert_array_equal(observations.weights, 1)


@pytest.mark.parametrize("disc_radius", [None, 0.0042])
@pytest.mark.parametrize("split", [None, ["train", "test", "train"]])
def test_what_is_saved_is_read_back_exactly(tmp_path, disc_radius, split):
    generator = np.random.default_rng(1)
    saved = Observations.create(
        generator.normal(size=(7, 3)),
        np.repeat([0, 2], 5),
        np.tile(np.arange(5), 2),
        generator.uniform(0, 400, (10, 2)),
        (400, 401),
        weights=generator.uniform(size=10),
        image_names=["a.png", "b ü.png", "c"],
        split=split,
        disc_radius=disc_radius,
    )
    save_observations(tmp_path / "deep" / "er" / "o.npz", saved)
    read = load_observations(tmp_path / "deep" / "er" / "o.npz")
    for name in ("object_points", "image_index", "point_index", "pixels", "weights"):
        np.testing.assert_array_equal(getattr(read, name), getattr(saved, name))
    assert read.image_names == saved.image_names
    assert read.image_size == saved.image_size
    assert read.disc_radius == saved.disc_radius
    assert (read.split is None) == (split is None)
    assert split is None or list(read.split) == split
    assert [path.name for path in (tmp_path / "deep" / "er").iterdir()] == ["o.npz"]


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"unit": None}, "has no unit"),
        ({"pixels": None, "image_size": None}, "has no pixels, image_size"),
        ({"unit": np.array("inch")}, "'inch'"),
        ({"unit": np.array(3)}, "unit"),
        ({"unit": np.array(["mm", "m"])}, "unit"),
        ({"pixels": np.zeros((3, 3))}, "pixels"),
        ({"pixels": np.zeros((2, 2))}, "one row"),
        ({"pixels": np.full((3, 2), np.nan)}, "not finite"),
        ({"pixels": np.full((3, 2), 900.0)}, "outside"),
        ({"pixels": np.array([["a", "b"]] * 3)}, "pixels must hold numbers"),
        ({"object_points": np.zeros((3, 2))}, "object_points"),
        ({"object_points": np.zeros((3, 3), dtype=complex)}, "object_points"),
        ({"point_index": np.array([0, 2, 9])}, "point_index"),
        ({"point_index": np.array([0, 0, 1])}, "twice"),
        ({"image_index": np.array([0, 0, -1])}, "image_index"),
        ({"image_index": np.array([0, 0, 0.5])}, "whole numbers"),
        ({"image_index": np.array([0, 0, 2**40])}, "at most"),
        ({"image_index": np.array([0, 0, 1], dtype=object)}, "image_index"),
        ({"image_size": np.array([640])}, "image_size"),
        ({"image_size": np.array([640, 0])}, "image_size"),
        ({"image_size": np.array([640, 10**7])}, "image_size"),
        ({"weights": np.array([1, 2])}, "weights"),
        ({"weights": np.array([1, 2, -3.0])}, "weights"),
        ({"image_names": np.array(["a"])}, "image_names"),
        ({"split": np.array(["a"])}, "split"),
        ({"disc_radius": np.array(-1.0)}, "disc_radius"),
        ({"disc_radius": np.array([1.0, 2])}, "disc_radius"),
        (dict(image_index=np.empty(0), point_index=np.empty(0), pixels=np.empty((0, 2))), "no observations"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, changes, said):
    path = write(tmp_path / "bad.npz", **changes)
    with pytest.raises(InputError) as error:
        load_observations(path)
    assert said in str(error.value)
    assert "bad.npz" in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_files_folders_and_other_formats(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        load_observations(tmp_path / "none.npz")
    with pytest.raises(InputError, match="not a file"):
        load_observations(tmp_path)
    for content in (b"", b"hello", b"PK\x03\x04" + bytes(100)):
        (tmp_path / "x.npz").write_bytes(content)
        with pytest.raises(InputError, match="not an .npz"):
            load_observations(tmp_path / "x.npz")


def test_an_array_header_that_promises_too_much_is_refused(tmp_path):
    path = write(tmp_path / "big.npz", pixels=None)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (9**9, 9**9)})
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("pixels.npy", header.getvalue() + bytes(48))
    with pytest.raises(InputError, match="pixels cannot be read: its header promises"):
        load_observations(path)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damaged_files_never_raise_anything_else(tmp_path, save):
    save(tmp_path / "good.npz", **valid_arrays())
    content = (tmp_path / "good.npz").read_bytes()
    generator = np.random.default_rng(0)
    path = tmp_path / "damaged.npz"
    for trial in range(300):
        damaged = bytearray(content)
        if trial % 3 == 0:
            damaged = damaged[: generator.integers(len(damaged))]
        else:
            for position in generator.integers(len(damaged), size=1 + trial % 5):
                damaged[position] ^= 1 << generator.integers(8)
        path.write_bytes(damaged)
        try:
            load_observations(path)
        except InputError as error:
            assert "\n" not in str(error)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    atomic_write(tmp_path / "f", b"old")
    with pytest.raises(TypeError):
        atomic_write(tmp_path / "f", "not bytes")
    assert (tmp_path / "f").read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1
    (tmp_path / "g").write_bytes(b"a file")
    with pytest.raises(CalibrationError, match="cannot write"):
        atomic_write(tmp_path / "g" / "below", b"x")
