"""Copies and boards at rest are one view; boards that moved are not."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.calibration import Observations, calibrate, rough_camera
from fisheye_ep_calib.calibration.estimating.fit import first_fit
from fisheye_ep_calib.calibration.estimating.sightings import prepare, sightings_of
from fisheye_ep_calib.calibration.selecting.cross_validation import fold_of_view
from fisheye_ep_calib.calibration.selecting.independent_views import places, without_copies, without_resting_views
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target, random_poses

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
    copies = _tripled(once)
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


def test_small_boards_that_lie_alike_stay_apart():
    """Far off, the points of one view come to lie near others of the next."""
    poses = random_poses(TARGET, 20, 3, (0.6, 1.0), (0.0, 2.0), (5.0, 50.0))
    assert merged(seen(poses)).images == {}


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


@pytest.mark.parametrize("model", ["auto", "ep_odd"])
def test_copies_change_nothing_in_a_calibration(model):
    poses = paper_poses(TARGET)
    once, many = calibrate(seen(poses), model), calibrate(_tripled(seen(poses)), model)
    np.testing.assert_array_equal(many.camera.parameters, once.camera.parameters)
    np.testing.assert_array_equal(many.uncertainty.covariance, once.uncertainty.covariance)
    assert many.views == once.views == len(poses) and many.reasons == once.reasons
    told = [finding.sentence for finding in many.diagnosis.findings if finding.name == "copies"]
    assert len(told) == 1 and f"{3 * len(poses)} images show {len(poses)} places" in told[0]
    assert not [finding for finding in once.diagnosis.findings if finding.name == "copies"]


def test_resting_boards_narrow_a_band_by_no_more_than_the_noise():
    poses = paper_poses(TARGET)
    once, many = calibrate(seen(poses), "ep_odd"), calibrate(seen(np.repeat(poses, 4, axis=0)), "ep_odd")
    sigma_once, sigma_many = (
        pupil_sigma(result.camera, result.uncertainty.covariance, np.radians([30.0, 60.0, 80.0]))
        for result in (once, many)
    )
    assert many.views == len(poses)
    assert (sigma_many > 0.4 * sigma_once).all() and (sigma_many < 0.65 * sigma_once).all()


def test_the_second_look_knows_where_all_images_of_a_place_are():
    rough = rough_camera(seen(np.repeat(POSES, 2, axis=0)), "ep_odd")
    np.testing.assert_array_equal(rough.view_images, np.arange(24))
    np.testing.assert_array_equal(rough.camera_from_target[0::2], rough.camera_from_target[1::2])


def _tripled(once: Observations) -> Observations:
    rows = [np.flatnonzero(once.image_index == image) for image in np.repeat(np.arange(once.view_count), 3)]
    taken = np.concatenate(rows)
    return Observations.create(
        once.object_points,
        np.repeat(np.arange(len(rows)), [len(each) for each in rows]),
        once.point_index[taken],
        once.pixels[taken],
        once.image_size,
        disc_radius=once.disc_radius,
    )


def test_twins_of_a_view_share_its_fold():
    poses = paper_poses(TARGET)
    step = np.zeros((len(poses), 6))
    step[:, 3] = 5 * np.linalg.norm(poses[:, :3, 3], axis=1) / CAMERA.fx
    sightings = prepare(seen(np.concatenate([poses, moved_poses(poses, step)])))
    fold = fold_of_view(places(sightings))
    np.testing.assert_array_equal(fold[: len(poses)], fold[len(poses) :])
    assert np.bincount(fold).tolist() == [10] * 5


def test_folds_of_views_that_all_differ():
    assert sorted(np.bincount(fold_of_view(places(prepare(seen(paper_poses(TARGET))))))) == [5] * 5


def test_thousands_of_views_of_a_board_at_rest_are_one_place_and_take_little_memory():
    moved, count = seen(POSES[:2]), 3000
    first, other = (moved.image_index == image for image in (0, 1))
    image = np.concatenate([np.repeat(np.arange(count), first.sum()), np.full(other.sum(), count)])
    point = np.concatenate([np.tile(moved.point_index[first], count), moved.point_index[other]])
    pixels = np.concatenate([np.tile(moved.pixels[first], (count, 1)), moved.pixels[other]])
    sightings = sightings_of(Observations.create(moved.object_points, image, point, pixels, moved.image_size))
    tracemalloc.start()
    number = places(sightings)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (number[:count] == 0).all() and number[count] == 1
    assert most < 2e8  # bytes; a list of the neighbours of each view takes 360 MB more
