"""Copies and boards at rest are one view; boards that moved are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.estimating.fit import first_fit, prepare
from fisheye_ep_calib.calibration.selecting.independent_views import without_copies, without_resting_views
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target

CAMERA, TARGET, NOISE = paper_camera(), paper_target(), 0.05
POSES = paper_poses(TARGET)[:12]


def seen(poses: np.ndarray, noise: float = NOISE, seed: int = 1) -> Observations:
    return observe(CAMERA, TARGET, poses, noise, seed)


def merged(observations: Observations):
    return without_resting_views(first_fit(prepare(observations)))


def shuffled_rows(observations: Observations, image: int, order: np.ndarray) -> Observations:
    rows = np.flatnonzero(observations.image_index == image)
    row = np.arange(len(observations.pixels))
    row[rows] = rows[order]
    return replace(
        observations,
        point_index=observations.point_index[row],
        pixels=observations.pixels[row],
        weights=observations.weights[row],
    )


def test_exact_copies_count_once_whatever_the_order_of_their_points():
    once = seen(POSES)
    images = np.repeat(np.arange(12), 3)
    rows = [np.flatnonzero(once.image_index == image) for image in images]
    copies = Observations.create(
        once.object_points,
        np.repeat(np.arange(36), [len(each) for each in rows]),
        once.point_index[np.concatenate(rows)],
        once.pixels[np.concatenate(rows)],
        once.image_size,
        disc_radius=once.disc_radius,
    )
    count = int((copies.image_index == 4).sum())
    found = without_copies(shuffled_rows(copies, 4, np.random.default_rng(0).permutation(count)))
    assert found.images == {3 * place: (3 * place, 3 * place + 1, 3 * place + 2) for place in range(12)}
    np.testing.assert_array_equal(found.observations.pixels, once.pixels)


def test_images_of_a_board_at_rest_are_averaged():
    found = merged(seen(np.repeat(POSES, 4, axis=0)))
    assert found.images == {4 * place: tuple(range(4 * place, 4 * place + 4)) for place in range(12)}
    truth = seen(np.repeat(POSES, 4, axis=0), noise=0.0)
    clean = {(i, p): x for i, p, x in zip(truth.image_index, truth.point_index, truth.pixels, strict=True)}
    keys = zip(found.observations.image_index, found.observations.point_index, strict=True)
    error = found.observations.pixels - np.array([clean[key] for key in keys])
    assert error.std() == pytest.approx(NOISE / 2, rel=0.1)
    np.testing.assert_allclose(found.observations.weights, 1.0)


def test_views_that_differ_stay_apart():
    assert merged(seen(paper_poses(TARGET))).images == {}


@pytest.mark.parametrize("noises, together", [(0.2, True), (8.0, False)])
def test_a_motion_counts_by_the_noise_of_a_point(noises, together):
    """Each place twice, shifted across the view by so many times a single point's noise."""
    distance = np.linalg.norm(POSES[:, :3, 3], axis=1)
    step = np.zeros((12, 6))
    step[:, 3] = noises * NOISE * distance / CAMERA.fx
    found = merged(seen(np.concatenate([POSES, moved_poses(POSES, step)])))
    assert len(found.images) == (12 if together else 0)


def test_a_board_whose_names_change_is_the_same_place():
    """A plain lattice, seen in part, may be named from another corner in the next image."""
    inner = [row * 11 + column for row in range(7) for column in range(10)]
    first = seen(POSES)
    first = replace(first, weights=np.where(np.isin(first.point_index, inner), 1.0, 0.0))
    second = seen(POSES, seed=2)
    kept = np.isin(second.point_index, inner)
    both = Observations.create(
        first.object_points,
        np.concatenate([first.image_index, second.image_index[kept] + 12]),
        np.concatenate([first.point_index, second.point_index[kept] + 1]),
        np.concatenate([first.pixels, second.pixels[kept]]),
        first.image_size,
        weights=np.concatenate([first.weights, np.ones(kept.sum())]),
        disc_radius=first.disc_radius,
    )
    found = merged(both)
    assert found.images == {place: (place, place + 12) for place in range(12)}
    used = found.observations.weights > 0
    assert set(found.observations.point_index[used]) <= set(inner)


def test_points_that_only_a_copy_has_are_kept():
    half = seen(np.repeat(POSES, 2, axis=0))
    lost = (half.image_index % 2 == 0) & (half.point_index < 30)
    found = merged(replace(half, weights=np.where(lost, 0.0, 1.0)))
    assert len(found.images) == 12
    assert (found.observations.weights > 0).all() and len(found.observations.pixels) == 12 * 77
