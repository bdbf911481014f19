"""What lenses and extras of other people's cameras promise, which are held and not estimated: values as published,
derivatives, and an inverse as far as they reach.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from differences import central_differences

from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, FisheyeCamera
from fisheye_ep_calib.camera.extras import HELD_EXTRAS, KNOWN_EXTRAS
from fisheye_ep_calib.camera.lenses import HELD_LENSES, KNOWN_LENSES
from fisheye_ep_calib.camera.lenses.lens import increasing_limit, solve_angle

RADIAL = {  # of each lens, some that are in use
    "perspective": [()],
    "cahvore": [
        (1.0, 0, -0.2, 0.03),
        (0.5, 0, 0, 0),
        (0.01, 0.1, 0.02, 0),
        (0.0, 0, 0.01, -0.002),
        (-0.4, -0.1, 0, 0.01),
    ],
}
DISTORTIONS = [  # OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
    (0.0,) * 12,
    (-0.3, 0.11, 1e-3, -2e-3, -0.02, 0, 0, 0, 0, 0, 0, 0),
    (0.08, -0.02, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0),
    (2.1, 0.7, 4e-4, 3e-4, 0.02, 2.4, 1.2, 0.1, 0, 0, 0, 0),
    (-0.28, 0.07, 2e-4, 1e-4, 0, 0.1, 0.01, 0, 1e-3, -4e-4, -6e-4, 3e-4),
]


def test_they_are_other_names_than_what_a_calibration_estimates() -> None:
    assert not set(HELD_LENSES) & set(LENSES) and not set(HELD_EXTRAS) & set(LENS_EXTRAS)
    assert set(KNOWN_LENSES) == {*HELD_LENSES, *LENSES} and set(KNOWN_EXTRAS) == {*HELD_EXTRAS, *LENS_EXTRAS}
    assert set(RADIAL) == set(HELD_LENSES)
    names = [name for parts in (KNOWN_EXTRAS, HELD_LENSES) for one in parts.values() for name in one.coefficient_names]
    assert len(set(names)) == len(names)


def test_a_lens_its_derivatives_and_its_inverse(held_lens) -> None:
    lens = HELD_LENSES[held_lens]
    assert lens.name == held_lens
    for radial in RADIAL[held_lens]:
        values = np.array(radial, dtype=float)
        limit = increasing_limit(lens, values, np.pi)
        assert limit > np.radians(60)
        theta = np.linspace(0, 0.9 * limit, 200)
        found = lens.radius_derivative(theta, values)
        numeric = central_differences(
            lambda at, values=values: lens.radius(at, values), theta[:, None], np.array([[1e-4]])
        )
        np.testing.assert_allclose(found, numeric[:, 0, 0], rtol=2e-7, atol=1e-9)
        by_coefficient = lens.radius_jacobian(theta, values)
        assert by_coefficient.shape == (len(values), 200)
        if len(values):
            numeric = central_differences(
                lambda at, theta=theta: lens.radius(theta, at), values, np.full(len(values), 1e-5)
            )
            at_the_kink = 1e-4 if values[0] == 0 else 0.0  # χ is tan on one side of L = 0 and sin on the other
            for row, expected in zip(by_coefficient, numeric.T, strict=True):
                allowed = 1e-7 * np.abs(expected).max() + at_the_kink
                np.testing.assert_allclose(row, expected, rtol=1e-5, atol=allowed)
        back, valid = solve_angle(lens, lens.radius(theta, values), values, limit)
        assert valid.all()
        np.testing.assert_allclose(back, theta, atol=1e-9)


def test_cahvore_runs_through_pinhole_stereographic_equidistant_and_orthographic() -> None:
    theta = np.linspace(0, 1.2, 50)
    for linearity, expected in ((1, np.tan(theta)), (0.5, 2 * np.tan(theta / 2)), (0, theta), (-1, np.sin(theta))):
        found = HELD_LENSES["cahvore"].radius(theta, np.array([linearity, 0.0, 0.0, 0.0]))
        np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize("distortion", DISTORTIONS, ids=str)
def test_a_pinhole_with_opencvs_distortion_is_opencvs(distortion) -> None:
    camera = FisheyeCamera(
        (1280, 960),
        700,
        690,
        640,
        480,
        radial=(),
        lens="perspective",
        extras={"brown_conrady": distortion, "tilt": (0.02, -0.01)},
    )
    assert np.radians(35) < camera.theta_limit < np.pi / 2
    rng = np.random.default_rng(2)
    theta, phi = rng.uniform(0, 0.98 * camera.theta_limit, 500), rng.uniform(-np.pi, np.pi, 500)
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    matrix = np.array([[700, 0, 640], [0, 690, 480], [0, 0, 1.0]])
    expected, _ = cv2.projectPoints(rays[None], np.zeros(3), np.zeros(3), matrix, np.array([*distortion, 0.02, -0.01]))
    pixels, valid = camera.project(rays)
    assert valid.all()
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), rtol=1e-12, atol=1e-9)
    inside = theta < 0.9 * camera.theta_limit  # near the fold the decentering alone may fold the plane
    _, directions, known = camera.unproject(pixels[inside])
    assert known.all() and np.abs(np.cross(directions, rays[inside])).max() < 1e-7
    beyond = 1.02 * camera.theta_limit
    if beyond < np.pi / 2:
        assert not camera.project([np.sin(beyond), 0, np.cos(beyond)])[1], "what folds back is no image"


def test_an_extra_its_derivatives(held_extra) -> None:
    extra = HELD_EXTRAS[held_extra]
    assert extra.name == held_extra
    places = np.random.default_rng(5).uniform(-0.6, 0.6, (200, 2))
    x, y = places.T
    for values in DISTORTIONS:
        plane, by_coefficient = extra.jacobian(x, y, values)
        numeric = central_differences(
            lambda at, values=values: np.stack(extra.apply(at[:, 0], at[:, 1], values), axis=-1),
            places,
            np.full(places.shape, 1e-3),
        )
        for entry, row, column in ((plane.xx, 0, 0), (plane.xy, 0, 1), (plane.yx, 1, 0), (plane.yy, 1, 1)):
            np.testing.assert_allclose(np.broadcast_to(entry, 200), numeric[:, row, column], rtol=1e-8, atol=1e-10)
        numeric = central_differences(
            lambda moved: np.stack(extra.apply(x, y, moved)), np.array(values), np.full(len(values), 1e-4)
        )
        np.testing.assert_allclose(by_coefficient, np.moveaxis(numeric, -1, 1), rtol=1e-6, atol=1e-9)


def test_an_extra_keeps_shapes(held_extra, shape) -> None:
    extra = HELD_EXTRAS[held_extra]
    x, y = np.random.default_rng(1).uniform(-0.5, 0.5, (2, *shape))
    for parts in (extra.apply(x, y, DISTORTIONS[1]), extra.invert(x, y, DISTORTIONS[1])):
        assert [np.shape(part) for part in parts] == [shape] * len(parts)


def test_pixels_that_opencvs_distortion_does_not_reach_have_no_ray() -> None:
    camera = FisheyeCamera(
        (1280, 960), 700, 690, 640, 480, radial=(), lens="perspective", extras={"brown_conrady": DISTORTIONS[1]}
    )
    u, v = np.meshgrid(np.linspace(-4000, 5000, 60), np.linspace(-4000, 5000, 60))
    pixels = np.stack([u, v], axis=-1)
    origins, directions, valid = camera.unproject(pixels)
    assert valid.any() and not valid.all()
    back, again = camera.project(origins[valid] + directions[valid])
    assert again.all() and np.abs(back - pixels[valid]).max() < 1e-5
