"""CameraInfo for images whose pixels are means of n × n of the camera's."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.camera_info import plain_camera_info, reduced

CAMERA = FisheyeCamera((1281, 962), 400, 401, 642.3, 477.7, radial=(0.03, -0.004, 0.001, -0.0002))


@pytest.mark.parametrize("number", [2, 3, 4])
def test_it_projects_to_the_mean_of_its_pixels(number) -> None:
    """Pixel i of the small image covers n i − ½ to n i + n − ½: its middle is n i + (n − 1)/2."""
    size = CAMERA.image_size[0] // number, CAMERA.image_size[1] // number
    info = reduced(plain_camera_info(CAMERA), size)
    small = FisheyeCamera(size, info.k[0], info.k[4], info.k[2], info.k[5], radial=info.d)
    points = np.random.default_rng(1).uniform([-1, -1, 0.5], [1, 1, 2], (50, 3))
    pixels, _ = CAMERA.project(points)
    np.testing.assert_allclose(small.project(points)[0], (pixels - (number - 1) / 2) / number, atol=1e-9)
    assert (info.width, info.height) == size and info.p[:3] == info.k[:3] and info.p[4:7] == info.k[3:6]
    assert info.p[8:] == (0, 0, 1, 0) and info.k[6:] == (0, 0, 1)


@pytest.mark.parametrize("size", [(640, 480), (1280, 962), (2562, 1924), (0, 0), (962, 1281), (1, 1)])
def test_another_size_has_none(size) -> None:
    assert (reduced(plain_camera_info(CAMERA), size) is None) == (size != (640, 481))


def test_its_own_size_is_left_as_it_is() -> None:
    info = plain_camera_info(CAMERA)
    assert reduced(info, CAMERA.image_size) is info
