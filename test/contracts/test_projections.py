"""What every projection of the rectifier promises: a place and its point are inverse, at the depth it says."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.rectification import PROJECTIONS, View, make_view, rectified_camera_info, surface_maps
from fisheye_ep_calib.simulation import paper_camera


@pytest.fixture
def projection(projection_name):
    return PROJECTIONS[projection_name]


def rays(count: int = 400) -> np.ndarray:
    """Points all around, metres."""
    points = np.random.default_rng(3).normal(0, 1, (count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * np.linspace(0.05, 30, count)[:, None]


def test_shapes(projection, shape) -> None:
    x, y = np.random.default_rng(1).uniform(-0.8, 0.8, (2, *shape))
    points = projection.points(np.array(x), np.array(y))
    assert points.shape == (*shape, 3)
    assert [np.shape(part) for part in projection.plane(points)] == [shape] * 2


def test_a_row_and_a_column_make_an_image(projection) -> None:
    x, y = np.linspace(-0.7, 0.7, 8), np.linspace(-0.5, 0.5, 5)[:, None]
    points = projection.points(x, y)
    assert points.shape == (5, 8, 3)
    np.testing.assert_allclose(points, projection.points(*np.broadcast_arrays(x, y)), atol=1e-15)


def test_the_middle_looks_along_the_axis(projection) -> None:
    np.testing.assert_allclose(projection.points(np.zeros(1), np.zeros(1))[0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(projection.plane(np.array([0.0, 0.0, 3.0])), 0, atol=1e-15)


def test_in_the_middle_it_keeps_angles_and_scale(projection) -> None:
    """x to the right and y down, one unit of the plane for one radian: the fisheye's resolution is kept there."""
    step = 1e-5
    for axis in range(2):
        point = np.array([0.0, 0.0, 1.0])
        point[axis] = step
        moved = np.array(projection.plane(point)) / step
        np.testing.assert_allclose(moved, np.eye(2)[axis], atol=1e-6)


def test_what_is_seen_at_a_place_is_seen_at_that_place(projection) -> None:
    x, y = np.random.default_rng(2).uniform(-4, 4, (2, 3000))
    points = projection.points(x, y)
    seen = np.isfinite(points).all(axis=-1)
    assert seen.sum() > 300 and np.isnan(points[~seen]).all()
    for scale in (1.0, 0.02, 700.0):
        np.testing.assert_allclose(projection.plane(scale * points[seen]), [x[seen], y[seen]], atol=1e-9)


def test_a_point_lies_on_the_ray_of_its_place(projection) -> None:
    points = rays()
    x, y = projection.plane(points)
    known = np.isfinite(x) & np.isfinite(y)
    assert (known == (np.isfinite(x) | np.isfinite(y))).all() and known.mean() > 0.3
    again = projection.points(x[known], y[known])
    cross = np.cross(again, points[known])
    assert np.abs(cross / np.linalg.norm(points[known], axis=1, keepdims=True)).max() < 1e-7
    assert (np.sum(again * points[known], axis=1) > 0).all(), "it looks the other way"


def test_points_stand_at_depth_one(projection) -> None:
    """z where it is a pinhole's image, else the distance."""
    points = projection.points(*np.random.default_rng(4).uniform(-0.9, 0.9, (2, 200)))
    depth = points[:, 2] if projection.pinhole else np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(depth, 1.0, rtol=1e-12)


def test_the_extent_of_a_field_is_where_its_edge_is_seen(projection) -> None:
    assert 0 < projection.usual_fov <= projection.largest_fov <= 2 * np.pi
    angles = np.linspace(0.01, 0.4999, 60) * projection.largest_fov
    extents = np.array([projection.half_extent(float(angle)) for angle in angles])
    assert (np.diff(extents) > 0).all() and np.isfinite(extents).all()
    edge = np.stack([np.sin(angles), np.zeros(60), np.cos(angles)], axis=-1)
    np.testing.assert_allclose(projection.plane(edge)[0], extents, rtol=1e-9)
    assert projection.surface in ("plane", "sphere")
    assert 0 < projection.half_height(extents[30], 0.75) < np.inf


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, 0.0), (0.5, -0.3)])
def test_a_view_shows_what_the_camera_sees(projection_name, yaw, pitch) -> None:
    camera = paper_camera()
    view = make_view(camera, projection_name, np.radians(90), (80, 60), yaw, pitch)
    points = 0.3 * view.points() @ view.camera_from_view.T
    column, row = np.meshgrid(np.arange(80), np.arange(60))
    np.testing.assert_allclose(view.project(points), np.stack([column, row], axis=-1), atol=1e-9)
    surface = "plane" if PROJECTIONS[projection_name].pinhole else "sphere"
    maps = surface_maps(camera, view, 0.3, surface)
    pixels, valid = camera.project(points)
    assert valid.mean() > 0.6
    np.testing.assert_allclose(np.stack([maps.x, maps.y], axis=-1)[valid], pixels[valid], atol=1e-3)


def test_camera_info_describes_it_or_cannot_be_taken_for_a_pinholes(projection, projection_name) -> None:
    view = View(projection_name, (64, 48), 30.0)
    info = rectified_camera_info(view)
    assert (info.width, info.height) == (64, 48)
    if not projection.pinhole:
        assert info.distortion_model == projection_name and not any(info.k) and not any(info.p)
        return
    point = np.array([0.03, -0.02, 0.2])
    projected = np.reshape(info.p, (3, 4)) @ [*point, 1.0]
    np.testing.assert_allclose(projected[:2] / projected[2], view.project(point))
