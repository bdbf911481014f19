"""Maps and rectified images against the camera's own projection."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rectification import PROJECTIONS, Maps, Rectifier, View, make_view, surface_maps


def unseen(maps: Maps) -> np.ndarray:
    return maps.x < -1000


def expected(camera, points):
    pixels, valid = camera.project(points)
    return np.where(valid[..., None], pixels, np.nan)


@pytest.mark.parametrize("surface", ["plane", "sphere"])
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_maps_lead_to_where_the_surface_is_seen(small_camera, projection, surface) -> None:
    view = View(projection, (60, 44), 20.0, yaw=0.3)
    maps = surface_maps(small_camera, view, 0.1, surface)
    points = view.points()
    scale = points[..., 2:] if surface == "plane" else np.linalg.norm(points, axis=-1, keepdims=True)
    points = 0.1 * points / np.where(scale > 0, scale, np.nan)
    pixels = expected(small_camera, points @ view.camera_from_view.T)
    known = np.isfinite(pixels).all(axis=-1)
    assert known.any() and (unseen(maps) == ~known).all()
    assert np.allclose(np.stack([maps.x, maps.y], axis=-1)[known], pixels[known], atol=1e-4)


def test_infinity_is_the_limit_of_far(small_camera) -> None:
    view = make_view(small_camera)
    far, near = surface_maps(small_camera, view, 1e7), surface_maps(small_camera, view, np.inf)
    assert np.abs(far.x - near.x).max() < 1e-3
    assert np.abs(surface_maps(small_camera, view, 0.1).x - near.x).max() > 0.5


def test_what_the_camera_does_not_see_is_black(small_camera) -> None:
    image = np.full((240, 320), 200, np.uint8)
    around = View("equirectangular", (360, 180), 57.3)
    rectified = Rectifier(small_camera, around).rectify(image)
    assert (rectified[90, 160:200] == 200).all() and (rectified[:, :40] == 0).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_constant_depth_image_is_that_surface(small_camera, projection) -> None:
    view = make_view(small_camera, projection, size=(200, 150))
    rectifier = Rectifier(small_camera, view, nearest_depth=0.05)
    for depth in (0.05, 0.07, 0.12, 0.5, 20.0, np.inf):
        found, exact = rectifier.maps_of_depth(np.full((150, 200), depth)), rectifier.maps(depth)
        both = ~unseen(found) & ~unseen(exact)
        assert both.mean() > 0.95 * (~unseen(exact)).mean()
        assert np.abs(found.x - exact.x)[both].max() < 0.02 and np.abs(found.y - exact.y)[both].max() < 0.02


def test_depth_varies_by_pixel_and_the_distance_fills_its_gaps(small_camera) -> None:
    view = make_view(small_camera, size=(200, 150))
    rectifier = Rectifier(small_camera, view)
    depth = np.full((150, 200), 0.1, np.float32)
    depth[:, :50], depth[:, 150:] = np.nan, 0.3
    depth[0] = -1.0
    maps = rectifier.maps_of_depth(depth, 0.2)
    assert np.abs(maps.x - rectifier.maps(0.2).x)[:, :50].max() == 0
    assert np.abs(maps.x - rectifier.maps(0.2).x)[0].max() == 0
    assert np.abs(maps.x - rectifier.maps(0.3).x)[1:, 150:].max() < 0.01
    assert np.abs(maps.x - rectifier.maps(0.1).x)[1:, 50:150].max() < 0.01


def test_a_depth_image_of_another_size_is_scaled(small_camera) -> None:
    rectifier = Rectifier(small_camera, make_view(small_camera, size=(200, 150)))
    maps = rectifier.maps_of_depth(np.full((15, 20), 0.1))
    assert np.abs(maps.x - rectifier.maps(0.1).x).max() < 0.01


@pytest.mark.parametrize("shape", [(0, 5), (5,), (5, 5, 3)])
def test_depth_images_that_are_none_are_refused(small_camera, shape) -> None:
    rectifier = Rectifier(small_camera, make_view(small_camera, size=(20, 15)))
    with pytest.raises(InputError, match="depth image"):
        rectifier.maps_of_depth(np.ones(shape))


def test_maps_are_made_once_for_each_distance(small_camera) -> None:
    rectifier = Rectifier(small_camera, make_view(small_camera, size=(20, 15)))
    first = rectifier.maps(0.1)
    assert rectifier.maps(0.1) is first
    for distance in (1, 2, 3, 4, 5):
        rectifier.maps(distance)
    assert rectifier.maps(0.1) is not first


def test_threads_share_a_rectifier(small_camera) -> None:
    rectifier = Rectifier(small_camera, make_view(small_camera, size=(64, 48)))
    image = np.random.default_rng(0).integers(0, 255, (240, 320), np.uint8)
    alone = [rectifier.rectify(image, distance) for distance in range(1, 9)]
    together: dict[int, np.ndarray] = {}

    def work(distance: int) -> None:
        together[distance] = rectifier.rectify(image, distance)

    threads = [threading.Thread(target=work, args=(distance,)) for distance in range(1, 9)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((together[distance] == alone[distance - 1]).all() for distance in range(1, 9))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [(), (3,), (4,)])
def test_every_sample_type_goes_through(small_camera, kind, channels) -> None:
    image = np.full((240, 320, *channels), 77, kind)
    rectified = Rectifier(small_camera, make_view(small_camera, fov=1.0, size=(40, 30))).rectify(image, 0.2)
    assert rectified.dtype == kind and rectified.shape == (30, 40, *channels) and (rectified == 77).all()


def test_wrong_input_is_refused_in_words(small_camera) -> None:
    view = make_view(small_camera, size=(20, 15))
    rectifier = Rectifier(small_camera, view)
    with pytest.raises(InputError, match="the image is 10×20, the camera 320×240"):
        rectifier.rectify(np.zeros((20, 10), np.uint8))
    for distance in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="must be positive"):
            rectifier.maps(distance)
    with pytest.raises(InputError, match="unknown interpolation"):
        Rectifier(small_camera, view, interpolation="lanczos")
    with pytest.raises(InputError, match="unknown surface"):
        Rectifier(small_camera, view, surface="torus").maps(1.0)
