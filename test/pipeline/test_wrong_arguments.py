"""What Python calls are given by mistake is refused in one line that says what is wanted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from known_scenes import CAMERA

from fisheye_ep_calib import (
    InputError,
    Observations,
    calibrate_recording,
    evaluate,
    load_camera,
    load_target,
    open_recording,
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


@pytest.mark.parametrize("path", [None, 3, 1.5, {}, b"\xff", True, object()])
def test_what_is_no_path(path: Any) -> None:
    target = load_target("circle_grid_11x7")
    for call in (load_camera, load_target, Observations.load, lambda given: evaluate(given, given)):
        with pytest.raises(InputError, match="`path` must be the path of a file, not "):
            call(path)
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
