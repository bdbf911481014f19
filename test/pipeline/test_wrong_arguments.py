"""What Python calls are given by mistake is refused in one line that says what is wanted."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from known_scenes import CAMERA, seen_board

from fisheye_ep_calib import (
    CalibratedCamera,
    InputError,
    Observations,
    calibrate,
    calibrate_recording,
    compare,
    evaluate,
    export,
    load_camera,
    load_target,
    open_recording,
    rectify,
    save_camera,
)

NO_COORDINATES = [None, 3, [1, 2, 3, 4], [[1, 2], [3]], "abc", np.zeros((4, 5)), [], np.zeros((5, 0)), {"a": 1}]


@pytest.mark.parametrize(
    ("method", "count"),
    [
        ("project", 3),
        ("project_with_jacobian", 3),
        ("incidence_angle", 3),
        ("unproject", 2),
        ("unproject_with_jacobian", 2),
    ],
)
def test_arrays_of_another_shape(method: str, count: int) -> None:
    for given in NO_COORDINATES:
        with pytest.raises(
            InputError, match=rf"must have the shape \(\.\.\., {count}\), not|must be numbers"
        ) as refusal:
            getattr(CAMERA, method)(given)
        assert str(refusal.value).isprintable()
    for shape in ((count,), (0, count), (2, 3, count)):
        assert getattr(CAMERA, method)(np.ones(shape)) is not None
    with pytest.raises(InputError, match="`theta` must be numbers"):
        CAMERA.entrance_pupil("abc")
    with pytest.raises(InputError, match="`parameters` must be numbers"):
        CAMERA.with_parameters(["a"])  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def calibrated() -> CalibratedCamera:
    return calibrate(seen_board(views=8), "ep_even")


@pytest.mark.parametrize("path", [None, 3, 1.5, {}, b"\xff", True, object(), "", "a\0b"])
def test_what_is_no_path(path: Any, calibrated: CalibratedCamera) -> None:
    target = load_target("circle_grid_11x7")
    for call in (load_camera, load_target, Observations.load, lambda given: evaluate(given, given)):
        with pytest.raises(InputError, match="`path` must be the path of a file, not "):
            call(path)
    for write in (calibrated.report, lambda given: save_camera(given, CAMERA)):
        with pytest.raises(InputError, match="`path` must be the path of a file, not "):
            write(path)
    with pytest.raises(InputError, match="`folder` must be the path of a folder, not "):
        calibrated.write(path)
    with pytest.raises(InputError, match="`path` must be the path of a file, not "):
        save_camera(path, CAMERA)
    for call in (
        open_recording,
        lambda given: open_recording([given]),
        lambda given: calibrate_recording(given, target),
    ):
        with pytest.raises(InputError, match="`paths` must be the path of a file, not |no recording is named"):
            call(path)


def test_what_is_no_camera(tmp_path) -> None:
    with pytest.raises(InputError, match="`camera` must be a camera or a calibration, not None"):
        save_camera(tmp_path / "a.yaml", None)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`path` must be the path of a file"):
        save_camera("", CAMERA)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("observations", [None, 3, "observations.npz", {"camera": "a"}, [], np.zeros((3, 2))])
def test_what_are_no_observations(observations: Any) -> None:
    for call in (calibrate, lambda given: evaluate(CAMERA, given)):
        with pytest.raises(InputError, match="`observations` must be those of one camera, as ") as refusal:
            call(observations)
        assert str(refusal.value).isprintable()


def test_what_cannot_be_rectified() -> None:
    width, height = CAMERA.image_size
    image = np.zeros((height, width), np.uint8)
    with pytest.raises(InputError, match="`camera` must be a camera, as `load_camera` gives one, not 'camera.yaml'"):
        rectify("camera.yaml", image)  # type: ignore[arg-type]
    for no_image in (None, 3, "a.png", [1, 2], np.zeros((2, 2, 2, 2))):  # cv2.imread gives None for a missing file
        with pytest.raises(InputError, match=r"an image is \(h, w\) or \(h, w, channels\), not of the shape"):
            rectify(CAMERA, no_image)  # type: ignore[arg-type]
    for name in ("distance", "fov", "yaw", "pitch"):
        for no_number in ("1", [1.0], {}, True, np.ones(2)):
            with pytest.raises(InputError, match=f"`{name}` must be a number, not "):
                rectify(CAMERA, image, **{name: no_number})  # type: ignore[arg-type]
    for no_size in (64, "ab", (64,), (64.5, 64), {}, np.zeros((2, 2))):
        with pytest.raises(InputError, match="`size` must be width and height in pixels, not "):
            rectify(CAMERA, image, size=no_size)  # type: ignore[arg-type]
    size = np.array([64, 48], np.int16)
    assert rectify(CAMERA, image, np.float32(2), size=size, yaw=np.int8(0)).shape == (48, 64)  # type: ignore[arg-type]


@pytest.mark.parametrize("length", ["1", None, ["0.3"], {}, True, np.ones((2, 2))])
def test_what_is_no_length(length: Any, tmp_path) -> None:
    with pytest.raises(InputError, match="`distances` must be "):
        compare(CAMERA, CAMERA, length)
    with pytest.raises(InputError, match="`distances` must be a number, not "):
        compare(CAMERA, CAMERA, [length])
    if length is not None:
        with pytest.raises(InputError, match="`svp_distance` must be a number, not "):
            export(CAMERA, "camera_info", tmp_path / "a.yaml", svp_distance=length)
    with pytest.raises(InputError, match="`distances` must be lengths in metres, not 3"):
        compare(CAMERA, CAMERA, 3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="`output` must be the path of a file, not "):
        export(CAMERA, "camera_info", "" if isinstance(length, str) else length)
    assert not any(tmp_path.iterdir())


def test_what_python_is_told_is_one_line_too() -> None:
    """A name from outside drives no terminal by way of an exception, and does not fill it."""
    with pytest.raises(InputError) as refusal:
        open_recording("no\n\x1b[31msuch.mcap")
    assert str(refusal.value) == r"no\n\x1b[31msuch.mcap does not exist"
    with pytest.raises(InputError) as refusal:
        open_recording("x" * 100_000)
    assert len(str(refusal.value)) < 5000
    again = pickle.loads(pickle.dumps(refusal.value))  # as workers send it
    assert type(again) is InputError and str(again) == str(refusal.value)
