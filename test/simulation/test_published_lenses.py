"""Every published lens: its focal length, where it is sharp, and its rays by a tracer of another make."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.simulation import PUBLISHED_LENSES, published_camera
from fisheye_ep_calib.simulation.ray_traced_lens import chief_rays

pytestmark = pytest.mark.parametrize("name", PUBLISHED_LENSES)


def traced_from_the_scene(lens, theta: float, crossing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where a ray in space, aimed at the axis at z = crossing under θ, meets the surfaces (S, 3) and the sensor (3,).

    In space, with Snell's law as n N × d = n′ N × d′. Also the ways between surfaces (S,).
    """
    direction = np.array([0.6 * np.sin(theta), 0.8 * np.sin(theta), np.cos(theta)])
    point = np.array([0.0, 0.0, crossing]) - 40 * lens.focal_length * direction
    index, met, ways = 1.0, [], []
    for vertex, radius, behind in zip(lens.vertices, lens.radii, lens.indices, strict=True):
        top = np.array([0.0, 0.0, vertex])
        if np.isinf(radius):
            normal, way = np.array([0.0, 0.0, 1.0]), (vertex - point[2]) / direction[2]
        else:
            offset = point - top - [0, 0, radius]
            ways_to_sphere = np.roots([1.0, 2 * offset @ direction, offset @ offset - radius**2])
            way = float(ways_to_sphere.min() if radius > 0 else ways_to_sphere.max())
            normal = -(offset + way * direction) / radius
        point = point + way * direction
        across = index / behind * np.cross(normal, direction)
        along = 1 - across @ across
        direction = np.cross(across, normal) + np.sqrt(along) * normal
        index = behind
        met.append(point)
        ways.append(way)
    way = (lens.sensor - point[2]) / direction[2]
    return np.array(met), point + way * direction, np.array(ways)


def test_it_has_the_published_focal_length_and_is_sharp_on_its_sensor(name) -> None:
    published = PUBLISHED_LENSES[name]
    lens = published.prescription
    if published.focal_length is not None:
        assert lens.focal_length == pytest.approx(published.focal_length, rel=5e-3)
    assert lens.thicknesses[-1] == pytest.approx(lens.back_focus, abs=0.02 * lens.focal_length)
    assert np.isinf(lens.radii[lens.stop]) and lens.indices[lens.stop] == lens.indices[lens.stop - 1] == 1.0


def test_its_chief_rays_pass_over_the_whole_field_through_the_middle_of_the_stop(name) -> None:
    published = PUBLISHED_LENSES[name]
    lens = published.prescription
    theta, shift, height = chief_rays(lens, np.linspace(0, np.radians(60), 600)[1:])
    seen = theta <= np.radians(published.half_field + 2)
    seen &= np.cumprod(np.diff(theta, prepend=0) > 0).astype(bool)
    assert theta[seen].max() > np.radians(published.half_field + 1)
    theta, shift, height = (each[seen][::40] for each in (theta, shift, height))
    assert (np.diff(height) > 0).all() and (np.diff(shift) > 0).all() and shift[0] > 0
    for angle, moved, image in zip(theta, shift, height, strict=True):
        met, on_sensor, ways = traced_from_the_scene(lens, angle, lens.entrance_pupil - moved)
        assert np.hypot(*met[lens.stop, :2]) < 1e-9 * lens.focal_length
        assert on_sensor[:2] == pytest.approx([0.6 * image, 0.8 * image], rel=1e-9)
        assert (ways > 0).all()  # no element stands in another where the ray passes


def test_its_camera_sees_the_field_on_its_sensor(name) -> None:
    camera = published_camera(name)
    assert camera.theta_limit == pytest.approx(np.radians(PUBLISHED_LENSES[name].half_field + 2), abs=0.02)
    assert camera.radius_px(camera.theta_limit) == pytest.approx(1000, abs=15)
    pupil = camera.entrance_pupil(np.linspace(0, camera.theta_limit, 50))
    assert (np.diff(pupil) < 0).all()
