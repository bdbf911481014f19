"""What the data leave open of a pupil is kept in the camera's file, through every door."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA

from fisheye_ep_calib.camera.left_open import PupilLeftOpen
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.camera_content import camera_content
from fisheye_ep_calib.storage.camera_file import load_camera, read_camera_file, save_camera

LEFT_OPEN = PupilLeftOpen.of("ep_even", [-1e-4, 2e-5], [[4e-9, -1e-9], [-1e-9, 1e-9]])
CENTRAL = replace(CAMERA, model="kannala", coefficients=(), pupil_left_open=LEFT_OPEN)


def test_a_camera_alone_keeps_it(tmp_path) -> None:
    path = tmp_path / "camera.yaml"
    save_camera(path, CENTRAL)
    loaded = load_camera(path)
    assert loaded == CENTRAL and loaded.pupil_left_open == LEFT_OPEN
    save_camera(path, loaded)
    assert load_camera(path).pupil_left_open == LEFT_OPEN
    content = camera_content(read_camera_file(path))
    theta = np.radians(content["theta_deg"])
    assert content["E_from"] == "left open"
    assert content["E_m"] == pytest.approx(-1e-4 * theta**2 + 2e-5 * theta**4)
    variance = 4e-9 * theta**4 - 2e-9 * theta**6 + 1e-9 * theta**8
    assert content["E_sigma_m"] == pytest.approx(np.sqrt(variance))


def test_it_moves_no_projection() -> None:
    points = np.array([[0.1, 0.2, 0.3], [0.3, -0.1, 0.05]])
    assert np.array_equal(CENTRAL.project(points)[0], replace(CENTRAL, pupil_left_open=None).project(points)[0])


@pytest.mark.parametrize(
    "given",
    [("none", [1.0], [[1.0]]), ("ep_even", [], []), ("ep_even", [1.0], [[1.0, 0.0]]), ("ep_even", [np.nan], [[1.0]])],
)
def test_what_is_none_is_refused(given) -> None:
    with pytest.raises(InputError, match="pupil_left_open"):
        PupilLeftOpen.of(*given)
