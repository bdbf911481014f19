"""What is kept between choices of variances changes nothing, and what is solved is the dense normal equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from changing_boards import seen_changing

from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, opened, refine
from fisheye_ep_calib.calibration.estimating.joint_posterior import JOINT_GROUPS, linearised_jointly, seen_points
from fisheye_ep_calib.calibration.estimating.shape_equations import BlockSystem
from fisheye_ep_calib.calibration.estimating.shape_posterior import Linearisation
from fisheye_ep_calib.calibration.estimating.sightings import of_images, prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.rotation import rotation_from_vector, vector_from_rotation
from fisheye_ep_calib.target.shape.model import FREE, GROUPS, free_model
from fisheye_ep_calib.target.shape.variances import Variances


@pytest.fixture(scope="module")
def fit() -> Fit:
    return refine(first_fit(prepare(seen_changing(flex=2e-4))), Structure("ep_even"))


def test_what_is_kept_of_other_variances_does_not_show(fit):
    linearisation = linearised_jointly(fit)
    whole = np.array([1e-4 if name in linearisation.available else 0.0 for name in JOINT_GROUPS])
    without = np.where([name == "flex" for name in JOINT_GROUPS], 0.0, whole)
    views_alone = np.where([name in ("flex", "in plane") for name in JOINT_GROUPS], 3e-5, whole)
    for deviation in (whole, without, views_alone, 2 * whole, whole):
        variances = Variances(deviation, 0.1)
        kept, fresh = linearisation(variances), linearised_jointly(fit)(variances)
        likelihood = linearisation.likelihood(variances)
        assert likelihood.deviance(variances) == kept.deviance(variances) == fresh.deviance(variances)
        np.testing.assert_array_equal(kept.value, fresh.value)
        np.testing.assert_array_equal(kept.variance, fresh.variance)
        np.testing.assert_array_equal(kept.camera, fresh.camera)


@pytest.mark.parametrize("views", [6, None])
def test_what_was_eliminated_serves_variances_of_fewer_smooth_groups(fit, views):
    """With few views points are eliminated first, else the views."""
    sightings = of_images(fit.sightings, fit.sightings.images[::2][:views])
    sightings = replace(sightings, free=free_model(sightings.target, seen_points(sightings)))
    opened_up = opened(refine(fit, fit.structure, sightings), Structure("ep_even", board_shape=FREE), sightings)
    linearisation = Linearisation(*opened_up, sightings.point_count)
    whole = np.full(len(GROUPS), 1e-4)
    fewer = whole * ~np.isin(GROUPS, ("z3", "xy1", "xy4"))
    for deviation in (whole, fewer, whole * (fewer == 0), 2 * fewer, fewer, whole):
        variances = Variances(deviation, 0.1)
        kept, fresh = linearisation(variances), Linearisation(*opened_up, sightings.point_count)(variances)
        assert linearisation.likelihood(variances).deviance(variances) == kept.deviance(variances)
        assert kept.deviance(variances) == pytest.approx(fresh.deviance(variances), rel=1e-11)
        np.testing.assert_array_equal(kept.group, fresh.group)
        np.testing.assert_allclose(kept.value, fresh.value, rtol=1e-8, atol=1e-13)
        np.testing.assert_allclose(kept.variance, fresh.variance, rtol=1e-9)


def test_an_eliminated_system_has_solution_inverse_and_determinant_of_the_whole():
    rng = np.random.default_rng(2)
    k, b, d = 7, 3, 5
    columns = rng.normal(size=(60, k * b + d))
    whole = np.zeros((k * b + d,) * 2)
    information = columns.T @ columns
    for block in range(k):  # blocks do not touch each other
        own = slice(block * b, block * b + b)
        whole[own, own] = information[own, own]
    whole[k * b :], whole[:, k * b :] = information[k * b :], information[:, k * b :]
    whole[range(len(whole)), range(len(whole))] += 30
    places = {"rough": (False, slice(0, k * b)), "camera": (True, slice(0, 2)), "pose": (True, slice(2, d))}
    blocks = np.stack([whole[i * b : i * b + b, i * b : i * b + b] for i in range(k)])
    system = BlockSystem(blocks, whole[: k * b, k * b :].reshape(k, b, d), whole[k * b :, k * b :], places)
    penalties = {name: rng.uniform(1, 9, size) for name, size in (("rough", k * b), ("camera", 2), ("pose", d - 2))}
    gradient = {name: rng.normal(size=len(each)) for name, each in penalties.items()}
    solved = system.eliminated(gradient, penalties["rough"]).factored(penalties)
    whole[range(len(whole)), range(len(whole))] += np.concatenate([penalties[name] for name in places])
    inverse, g = np.linalg.inv(whole), np.concatenate([gradient[name] for name in places])
    for told, expected in ((solved.step, -inverse @ g), (solved.variance, np.diag(inverse))):
        np.testing.assert_allclose(np.concatenate([told[name] for name in places]), expected, rtol=1e-10)
    np.testing.assert_allclose(solved.camera, inverse[k * b : k * b + 2, k * b : k * b + 2], rtol=1e-10)
    assert solved.log_determinant == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-12)
    assert solved.decrease == pytest.approx(g @ inverse @ g, rel=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-5, 1.0, 3.1])
def test_a_rotation_vector_comes_back(angle):
    vector = angle * np.array([0.6, -0.48, 0.64])
    rotation = rotation_from_vector(vector)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1, abs=1e-14)
    np.testing.assert_allclose(vector_from_rotation(rotation), vector, atol=1e-14, rtol=1e-9)
