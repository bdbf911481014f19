"""Centres of gravity of projected discs: the integral, its derivative, and what ignoring it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_cameras import random_camera, random_rays, ray_points

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.simulation import look_pose, observe, paper_camera, paper_poses, paper_target
from fisheye_ep_calib.target.discs.centroid import boundary_directions, curve_centroid
from fisheye_ep_calib.target.shape.measured import BoardShape

pytestmark = pytest.mark.filterwarnings("error")
RADIUS = 0.004


def tilted_disc(rng, camera, points: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Points (k, n, 3) at plane coordinates ``samples`` (k, 2) of discs around points (n, 3), tilted by up to 50°."""
    sight = points / np.linalg.norm(points, axis=-1, keepdims=True)
    normal = sight + np.tan(np.radians(50)) * rng.uniform(-0.7, 0.7, points.shape)
    first = np.cross(normal, rng.normal(size=points.shape))
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    second = np.cross(normal, first)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return points + RADIUS * (samples[:, None, :1] * first + samples[:, None, 1:] * second)


def area_centroid(pixels: np.ndarray, side: int) -> np.ndarray:
    """Mean of the quadrilaterals' centres of a mapped grid (side, side, n, 2), weighted by their mapped areas."""
    a, b, c, d = pixels[:-1, :-1], pixels[1:, :-1], pixels[1:, 1:], pixels[:-1, 1:]
    (x1, y1), (x2, y2) = np.moveaxis(c - a, -1, 0), np.moveaxis(d - b, -1, 0)
    area = (0.5 * np.abs(x1 * y2 - y1 * x2))[..., None]
    return ((a + b + c + d) / 4 * area).sum(axis=(0, 1)) / area.sum(axis=(0, 1))


def test_eight_boundary_samples_give_the_centroid_of_the_image_of_the_whole_disc() -> None:
    rng = np.random.default_rng(1)
    camera = paper_camera()
    theta, phi = np.radians(rng.uniform(1, 88, 40)), rng.uniform(-np.pi, np.pi, 40)
    points = ray_points(camera, theta, phi, rng.uniform(0.09, 0.3, 40))
    side = 181
    radius = np.sqrt((np.arange(side)) / (side - 1))  # rings of equal area
    angle = np.linspace(0, 2 * np.pi, side)
    grid = (radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    state = rng.bit_generator.state
    pixels, valid = camera.project(tilted_disc(rng, camera, points, grid))
    truth = area_centroid(pixels.reshape(side, side, 40, 2), side)
    rng.bit_generator.state = state
    edge, _ = camera.project(tilted_disc(rng, camera, points, boundary_directions(8)))
    found, _ = curve_centroid(edge[..., 0], edge[..., 1])
    assert valid.all()
    assert np.abs(found.T - truth).max() < 2e-3  # what is left is the quadrilaterals'
    centres, _ = camera.project(points)
    assert np.abs(centres - truth).max() > 0.1  # the image of the centre is something else


def test_more_samples_change_nothing() -> None:
    rng = np.random.default_rng(2)
    for model in ("kannala", "ep_odd", "gennery"):
        camera = random_camera(rng, model)
        theta, phi, distance = random_rays(rng, camera, 100, least=0.1)
        points = ray_points(camera, theta, phi, distance)
        seed = rng.integers(1 << 30)
        results = []
        for samples in (8, 64):
            edge, _ = camera.project(
                tilted_disc(np.random.default_rng(seed), camera, points, boundary_directions(samples))
            )
            results.append(curve_centroid(edge[..., 0], edge[..., 1])[0])
        assert np.abs(results[0] - results[1]).max() < 1e-4


def test_eight_samples_are_right_to_a_millionth_of_a_pixel_for_the_papers_views() -> None:
    camera, target = paper_camera(), paper_target()
    poses = paper_poses(target, 0)
    results = []
    for samples in (8, 64):
        edge = np.zeros((samples, 1, 3))
        edge[:, 0, :2] = target.disc_radius * boundary_directions(samples)
        boundary = (target.object_points + edge)[:, None] @ np.swapaxes(poses[:, :3, :3], 1, 2)
        pixels, valid = camera.project(boundary + poses[:, None, :3, 3])
        found, _ = curve_centroid(pixels[..., 0], pixels[..., 1])
        results.append(np.where(valid.all(axis=0), found, np.nan))
    assert np.isfinite(results[0]).any()
    assert np.nanmax(np.abs(results[0] - results[1])) < 1e-6


def test_an_ellipse_has_its_middle_and_a_limacon_its_integral() -> None:
    angle = 2 * np.pi * np.arange(16) / 16
    found, _ = curve_centroid(3e3 + 5 * np.cos(angle + 0.3), 40 - 2 * np.sin(angle))
    assert np.allclose(found, [3e3, 40], atol=1e-11)
    # r = 1 + b cos a: x_c = b (4 + b²) / (2 (2 + b²)), y_c = 0.
    b = 0.4
    radius = 1 + b * np.cos(angle)
    found, _ = curve_centroid(radius * np.cos(angle), radius * np.sin(angle))
    assert np.allclose(found, [b * (4 + b * b) / (2 * (2 + b * b)), 0], atol=1e-14)


@pytest.mark.parametrize("samples", [5, 6, 8, 11])
def test_its_derivative_by_every_sample(samples: int) -> None:
    rng = np.random.default_rng(3)
    angle = 2 * np.pi * np.arange(samples)[:, None] / samples
    curve = np.stack(
        [
            900 + 20 * np.cos(angle) + rng.normal(0, 0.5, (samples, 6)),
            700 + 12 * np.sin(angle + 0.2) + rng.normal(0, 0.5, (samples, 6)),
        ]
    )
    _, jacobian = curve_centroid(*curve)
    assert jacobian.shape == (2, 2, samples, 6)
    step = 1e-3
    for axis in range(2):
        for sample in range(samples):
            moved = np.zeros_like(curve)
            moved[axis, sample] = step
            numeric = (curve_centroid(*(curve + moved))[0] - curve_centroid(*(curve - moved))[0]) / (2 * step)
            assert np.abs(jacobian[:, axis, sample] - numeric).max() < 1e-7
    # A shift of all samples shifts the centre.
    assert np.allclose(jacobian.sum(axis=2), np.eye(2)[..., None], atol=1e-12)


def test_discs_are_calibrated_by_their_centres_of_gravity() -> None:
    """Naive centres fit almost as well and invent a pupil shift and a longer r(θ)."""
    camera, target = paper_camera(), paper_target()
    observations = observe(camera, target, paper_poses(target))
    theta = np.radians([30, 60, 80])
    right = calibrate(observations, "ep_odd")
    assert right.rms_px < 1e-4
    assert np.abs(right.camera.entrance_pupil(theta) - camera.entrance_pupil(theta)).max() < 1e-6
    assert np.abs(right.camera.parameters[:5] - camera.parameters[:5]).max() < 1e-3
    naive = calibrate(observations, "ep_odd", disc_centers="naive")
    assert 0.005 < naive.rms_px < 0.05
    invented = naive.camera.entrance_pupil(theta[2]) - camera.entrance_pupil(theta[2])
    assert 0.2e-3 < abs(invented) < 1e-3
    radius = naive.camera.fx * naive.camera.radius(theta) - camera.fx * camera.radius(theta)
    assert np.abs(radius).max() > 0.2


def test_noisy_discs_by_auto() -> None:
    camera, target = paper_camera(), paper_target()
    result = calibrate(observe(camera, target, paper_poses(target), noise=0.05))
    assert result.model == "ep_odd" and result.entrance_pupil_supported
    assert result.uncertainty.sigma_px == pytest.approx(0.05, rel=0.05)
    theta = np.radians([30, 60, 80])
    assert np.abs(result.camera.entrance_pupil(theta) - camera.entrance_pupil(theta)).max() < 0.1e-3
    assert not result.rejected


def test_a_disc_on_a_bent_board_bends_with_it() -> None:
    """Truth: the image's area and first moments of a disc drawn on the surface itself, as a fine polygon."""
    target = paper_target()
    points, radius = target.object_points, 4e-3
    size = points[:, :2].max(axis=0)
    camera = replace(paper_camera(), model="ep_even", coefficients=(-0.004, -0.0005))
    heights = 2e-3  # of a bow over the board

    def surface(plane: np.ndarray) -> np.ndarray:
        x, y = (2 * plane / size - 1).T
        return np.column_stack([plane, heights * (1 - x**2) + 0.5 * heights * x * y])

    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    pose = look_pose(target, np.radians(50), 0.7, 0.11, np.radians(40), 1.0, 0.3)
    truth = []
    for point in points:
        curve, _ = camera.project(surface(point[:2] + rim) @ pose[:3, :3].T + pose[:3, 3])
        middle = curve.mean(axis=0)
        (u, v), (u_next, v_next) = (curve - middle).T, np.roll(curve - middle, -1, axis=0).T
        cross = u * v_next - u_next * v
        truth.append(
            middle + np.array([((u + u_next) * cross).sum(), ((v + v_next) * cross).sum()]) / (3 * cross.sum())
        )
    true_points = surface(points[:, :2])
    slope_x = np.column_stack([np.zeros((len(points), 2)), _slopes(surface, points[:, :2])[:, 0]])
    slope_y = np.column_stack([np.zeros((len(points), 2)), _slopes(surface, points[:, :2])[:, 1]])
    shape = BoardShape("free", points, true_points - points, slopes=np.concatenate([slope_x, slope_y], axis=1))
    index = np.arange(len(points))
    seen = Observations.create(
        points, np.zeros_like(index), index, np.array(truth), camera.image_size, disc_radius=radius, board=shape
    )
    bent = np.hypot(*evaluate_camera(camera, seen).error.T)
    flat_discs = replace(shape, slopes=np.zeros((len(points), 6)))
    flat = np.hypot(*evaluate_camera(camera, replace(seen, board=flat_discs)).error.T)
    assert np.sqrt((bent**2).mean()) < 0.02
    assert np.sqrt((bent**2).mean()) < 0.3 * np.sqrt((flat**2).mean())


def _slopes(surface, plane: np.ndarray) -> np.ndarray:
    """∂z/∂x and ∂z/∂y (n, 2) by central differences."""
    step = 1e-6 * np.eye(2)
    return np.column_stack([(surface(plane + one) - surface(plane - one))[:, 2] / 2e-6 for one in step])
