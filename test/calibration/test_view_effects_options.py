"""``flex`` and ``rolling_shutter``: the camera that is left when they are estimated."""

from __future__ import annotations

from dataclasses import replace

import changing_boards
import numpy as np
import pytest
from changing_boards import seen_changing
from known_scenes import CAMERA

from fisheye_ep_calib.calibration.calibrate import calibrate
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.joint_posterior import JOINT_GROUPS, LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.lens_field_estimate import with_lens_field
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD

THETA = np.radians(60)


@pytest.mark.parametrize(
    ("option", "changes"),
    [
        ({"flex": True}, {"flex": 2e-4}),
        ({"flex": True, "board_shape": "free"}, {"flex": 2e-4, "wave": 2e-4}),
        ({"rolling_shutter": True}, {"turn": 2e-3, "shift": 1e-3}),
    ],
)
def test_what_differs_by_view_is_taken_out_of_residuals_and_pupil(option, changes) -> None:
    observations = seen_changing(**changes)
    without, result = (calibrate(observations, "ep_even", **given) for given in ({}, option))
    assert result.converged and result.fit.sigma_px == pytest.approx(0.1, rel=0.08)
    assert result.rms_px < 0.75 * without.rms_px
    sigma = float(pupil_sigma(result.camera, result.uncertainty.covariance, THETA))
    assert sigma < 0.15e-3
    assert abs(result.camera.entrance_pupil(THETA) - CAMERA.entrance_pupil(THETA)) < 2.5 * sigma


def test_where_nothing_differs_nothing_is_estimated() -> None:
    observations = seen_changing()
    result = calibrate(observations, "ep_even", flex=True, rolling_shutter=True)
    assert result.fit.problem.effects is None
    assert result.rms_px == pytest.approx(calibrate(observations, "ep_even").rms_px, rel=1e-6)


@pytest.mark.parametrize("amount", [0.0, 1.0])
def test_auto_takes_a_lens_field_where_there_is_one(amount, monkeypatch) -> None:
    field = tuple(np.random.default_rng(5).normal(0, 1.0, len(LENS_FIELD.coefficient_names)) * amount)
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    result = calibrate(seen_changing(views=16), lens_field=True, board_shape="flat")
    assert ("lens_field" in result.camera.extras) == (amount > 0)
    assert any(reason.startswith("lens_field") for reason in result.reasons)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_lens_field_does_not_turn_the_axis(seed) -> None:
    """A turned axis looks like a part of a field: with that free the centre was known to 10 px, a stand-in lost 4."""
    result = calibrate(seen_changing(views=16, seed=seed), "ep_even", lens_field=True, board_shape="flat")
    at = [result.camera.parameter_names.index(name) for name in ("cx", "cy")]
    sigma = np.sqrt(np.diag(result.uncertainty.covariance)[at])
    assert sigma.max() < 1.0 and result.iterations < 20
    assert (np.abs([result.camera.cx - CAMERA.cx, result.camera.cy - CAMERA.cy]) < 4 * sigma).all()
    assert result.stand_in.loss_px[10.0] < 1.0


def test_a_shape_that_vanishes_beside_what_changes_is_that_of_the_file() -> None:
    options = {"flex": True, "rolling_shutter": True, "lens_field": True, "board_shape": "free"}
    board = calibrate(seen_changing(views=10, noise=0.2), "ep_even", **options).board
    assert board.kind == "flat" and not board.bends


@pytest.mark.parametrize("views", [8, 16])
def test_a_symmetric_lens_is_given_no_field(views) -> None:
    """Its 26 numbers, free of any prior, cost eight views a tenth of what they predict."""
    observations = seen_changing(views=views)
    result, plain = (calibrate(observations, "ep_even", **given) for given in ({"lens_field": True}, {}))
    assert not result.camera.extras and result.rms_px == pytest.approx(plain.rms_px, rel=1e-9)


def test_of_a_field_what_few_views_do_not_tell_stays_near_zero(monkeypatch) -> None:
    names = LENS_FIELD.coefficient_names
    field = tuple(np.where(np.array(LENS_FIELD.orders) == 2, 1.0, 0.0).tolist())
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    result = calibrate(seen_changing(views=8), "ep_even", lens_field=True)
    found = np.array(result.camera.extras["lens_field"])
    part = result.camera.parameter_slice("lens_field")
    sigma = np.sqrt(np.diag(result.uncertainty.covariance[part, part]))
    assert result.fit.sigma_px == pytest.approx(0.1, rel=0.08) and len(found) == len(names)
    assert np.sqrt((((found - field) / sigma) ** 2).mean()) < 1.5
    other = np.array(LENS_FIELD.orders) != 2
    assert np.abs(found[other]).max() < 0.5


def test_the_variances_of_a_field_are_the_same_once_it_is_in_the_fit(monkeypatch) -> None:
    """Its coefficients, and not what is left of them, have the prior."""
    field = tuple(np.random.default_rng(5).normal(0, 1.0, len(LENS_FIELD.coefficient_names)))
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    plain = refine(first_fit(prepare(seen_changing(views=16))), Structure("ep_even"))
    with_field = with_lens_field(plain)
    before, after = (joint_variances(fit).most_likely(LENS_GROUPS)[0] for fit in (plain, with_field))
    own = [JOINT_GROUPS.index(name) for name in LENS_GROUPS]
    np.testing.assert_allclose(after.deviation[own], before.deviation[own], rtol=0.1)
    assert after.noise == pytest.approx(before.noise, rel=0.02)
