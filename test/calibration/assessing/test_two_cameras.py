"""Two cameras among the images of one are found by the residuals; nothing else that disagrees is taken for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.calibration.assessing.two_cameras import split_in_two, two_cameras
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.simulation import observe, paper_camera, paper_target, random_poses

TARGET, CAMERA = paper_target(), paper_camera()
HALF = 20


def joined(parts: list[Observations]) -> Observations:
    first = parts[0]
    starts = np.cumsum([0, *(len(one.image_names) for one in parts)])
    names = [f"{number:03d}.png" for number in range(starts[-1])]
    return Observations.create(
        object_points=first.object_points,
        image_index=np.concatenate([one.image_index + start for one, start in zip(parts, starts, strict=False)]),
        point_index=np.concatenate([one.point_index for one in parts]),
        pixels=np.concatenate([one.pixels for one in parts]),
        image_size=first.image_size,
        image_names=names,
        disc_radius=first.disc_radius,
    )


def seen(camera, seed: int, count: int = HALF, target=TARGET, noise: float = 0.1) -> Observations:
    return observe(camera, target, random_poses(TARGET, count, seed, (0.1, 0.3)), noise, seed=seed)


def finding(observations: Observations, model: str = "ep_odd"):
    """The finding of a calibration, None where there is none, the split, and the images (V,) of the views."""
    result = calibrate(observations, model)
    found = next((one for one in result.diagnosis.findings if one.name == "two_cameras"), None)
    fit = result.fit
    middles = (fit.state.camera_from_target @ np.append(fit.problem.features.board.middle, 1))[:, :3]
    points = 2 * fit.sightings.point_count
    split = two_cameras(fit.adjustment.equations, fit.shared_parameters[0], points, middles)
    return found, split, result.view_images


def raised(found) -> bool:
    return found is not None and found.concern


@pytest.mark.parametrize("step", [(10, 10, 0, 0), (3, 3, 0, 0), (0, 0, 10, -5), (0, 0, 3, 2), (5, 5, 4, -4)])
def test_two_cameras_are_found_and_told_apart(step) -> None:
    names = ("fx", "fy", "cx", "cy")
    other = replace(CAMERA, **{name: getattr(CAMERA, name) + px for name, px in zip(names, step, strict=True)})
    found, split, images = finding(joined([seen(CAMERA, 1), seen(other, 2)]))
    assert raised(found) and "two cameras" in found.sentence and split is not None
    truth = images >= HALF
    wrong = min((split.group != truth).sum(), (split.group == truth).sum())
    assert wrong <= 3
    sign = 1 if (split.group == truth).mean() > 0.5 else -1
    shift = sign * (split.corrections[1] - split.corrections[0])
    np.testing.assert_allclose(shift, step, atol=0.1 * max(map(abs, step)) + 0.6)


def test_siblings_of_one_make() -> None:
    found, _, _ = finding(joined([seen(CAMERA, 1), seen(paper_camera(1), 2)]))
    assert raised(found)


def bent(seed: int, state: int = 0):
    """The target with a bow of its own, ±0.4 mm."""
    points = TARGET.object_points.copy()
    half = points[:, :2].max(axis=0) / 2
    x, y = ((points[:, :2] - half) / half).T
    bow = np.random.default_rng([seed, state]).uniform(-4e-4, 4e-4, 3)
    points[:, 2] += bow[0] * (1 - x**2) + bow[1] * (1 - y**2) + bow[2] * x * y
    return replace(TARGET, object_points=points)


def as_flat(observations: Observations) -> Observations:
    return replace(observations, object_points=TARGET.object_points)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("model", ["ep_odd", "ep_even", "kannala"])
def test_one_camera_is_one(seed, model) -> None:
    found, _, _ = finding(seen(CAMERA, seed, 2 * HALF), model)
    assert not raised(found)
    assert found is None or found.sentence == "the residuals are those of one camera"


@pytest.mark.parametrize("seed", range(3))
def test_a_bent_board_is_no_second_camera(seed) -> None:
    found, _, _ = finding(as_flat(seen(CAMERA, seed, 2 * HALF, bent(seed))))
    assert not raised(found)


@pytest.mark.parametrize("seed", range(3))
def test_a_board_that_flexes_is_no_second_camera(seed) -> None:
    poses = random_poses(TARGET, 2 * HALF, seed, (0.1, 0.3))
    views = [
        as_flat(observe(CAMERA, bent(seed, number), poses[number : number + 1], 0.1, seed=number))
        for number in range(2 * HALF)
    ]
    found, _, _ = finding(joined(views))
    assert not raised(found)


def test_one_bad_view_is_no_second_camera() -> None:
    good = seen(CAMERA, 1, 2 * HALF)
    pixels = good.pixels.copy()
    rows = good.image_index == 5
    pixels[rows] += 2 * np.random.default_rng(0).normal(size=(rows.sum(), 2)) + 0.01 * (pixels[rows] - 1024)
    found, _, _ = finding(replace(good, pixels=pixels))
    assert not raised(found)


def test_few_views_say_nothing() -> None:
    assert split_in_two(np.zeros((7, 4)), np.tile(np.eye(4), (7, 1, 1)), np.arange(4), 1.0) is None


def test_corrections_that_scatter_are_no_two_groups() -> None:
    """The function alone: information of one unit, corrections drawn around one place or around two."""
    rng = np.random.default_rng(0)
    information = np.tile(np.eye(4), (60, 1, 1))
    side = rng.integers(0, 2, 60)
    raised = {0: 0, 1: 0}
    for _ in range(30):
        scatter = rng.normal(size=(60, 4)) * (20, 3, 3, 3)
        apart = rng.normal(size=(60, 4)) + 10 * np.outer(2 * side - 1, (1, 0, 0, 0))
        for number, own in enumerate((scatter, apart)):
            found = split_in_two(-own, information, np.arange(4), 1.0)
            assert found is not None
            raised[number] += found.raised
    assert raised == {0: 0, 1: 30}
