"""Views: where their pixels look, their usual sizes, what CameraInfo says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rectification import View, field_of_view, make_view, rectified_camera_info


def test_yaw_looks_to_the_right_and_pitch_up() -> None:
    axis = View("perspective", (3, 3), 1.0, yaw=np.radians(30)).camera_from_view[:, 2]
    assert np.allclose(axis, [0.5, 0, np.sqrt(0.75)])
    axis = View("perspective", (3, 3), 1.0, pitch=np.radians(30)).camera_from_view[:, 2]
    assert np.allclose(axis, [0, -0.5, np.sqrt(0.75)])


@pytest.mark.parametrize("projection", ["cylindrical", "equirectangular"])
def test_behind_and_beyond_the_poles_there_is_nothing(projection) -> None:
    view = View(projection, (1000, 1000), 100.0)
    points = view.points()
    assert np.isnan(points[500, 0]).all() and np.isfinite(points[500, 500]).all()
    if projection == "equirectangular":
        assert np.isnan(points[0, 500]).all()
    assert np.isnan(View("perspective", (9, 9), 5.0).project([0.0, 0.0, -1.0])).all()


def test_usual_views_keep_the_resolution_and_see_what_the_camera_sees(small_camera) -> None:
    assert np.degrees(field_of_view(small_camera)) == pytest.approx(np.degrees(2 * 157 / 90), abs=12)
    view = make_view(small_camera)
    assert view.focal == pytest.approx(90, abs=1)
    assert 2 * np.arctan(view.size[0] / 2 / view.focal) == pytest.approx(np.radians(100))
    assert view.size[1] / view.size[0] == pytest.approx(240 / 320, abs=0.02)
    around = make_view(small_camera, "equirectangular")
    assert around.size[0] / around.focal == pytest.approx(field_of_view(small_camera))
    narrow = make_view(replace(small_camera, theta_max=0.5))
    assert 2 * np.arctan(narrow.size[0] / 2 / narrow.focal) == pytest.approx(1.0)


def test_field_and_size_set_the_focal_length(small_camera) -> None:
    assert make_view(small_camera, fov=np.pi / 2, size=(640, 480)).focal == pytest.approx(320)
    assert make_view(small_camera, "cylindrical", np.pi, (628, 100)).focal == pytest.approx(628 / np.pi)


def test_camera_info_is_a_plain_pinhole(small_camera) -> None:
    view = make_view(small_camera, fov=np.pi / 2, size=(640, 480))
    info = rectified_camera_info(view)
    assert (info.width, info.height, info.distortion_model, info.d) == (640, 480, "plumb_bob", (0.0,) * 5)
    point = np.array([0.03, -0.02, 0.2])
    projected = np.reshape(info.p, (3, 4)) @ [*point, 1.0]
    assert np.allclose(projected[:2] / projected[2], view.project(point))
    assert np.allclose(np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))[:, :3])


def test_camera_info_of_other_projections_cannot_be_taken_for_a_pinhole(small_camera) -> None:
    info = rectified_camera_info(make_view(small_camera, "cylindrical"))
    assert info.distortion_model == "cylindrical" and not any(info.k) and not any(info.p)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"projection": "fisheye"}, "known: perspective"),
        ({"fov": np.pi}, "170"),
        ({"fov": 0.0}, "above 0°"),
        ({"fov": float("nan")}, "above 0°"),
        ({"size": (0, 10)}, "each side"),
        ({"size": (100000, 10)}, "each side"),
        ({"yaw": float("inf")}, "finite"),
    ],
)
def test_views_that_cannot_be_are_refused(small_camera, arguments, complaint) -> None:
    with pytest.raises(InputError, match=complaint):
        make_view(small_camera, **arguments)
