"""Flexing boards and rolling shutters: told apart by likelihood, and the camera that is left."""

from __future__ import annotations

import numpy as np
import pytest
from changing_boards import seen_changing
from known_scenes import CAMERA

from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.nuisance_models import NuisanceModel, nuisance_models
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure

ANGLES = np.radians([30, 60])


def fitted(**changes) -> Fit:
    return refine(first_fit(prepare(seen_changing(**changes))), Structure("ep_even"))


def models(fit: Fit) -> dict[str, NuisanceModel]:
    return {each.name: each for each in nuisance_models(fit, ANGLES)}


@pytest.mark.parametrize(
    ("changes", "expected", "variances"),
    [
        ({"flex": 2e-4}, "flex and in-plane change", {"flex": 2e-4}),
        ({"flex": 1e-4, "wave": 2e-4}, "flex and in-plane change", {"flex": 1e-4}),
        ({"in_plane": 5e-5}, "flex and in-plane change", {"in plane": 5e-5}),
        ({"turn": 3e-3, "shift": 1e-3}, "rolling shutter", {"shutter turn": 3e-3, "shutter shift": 1e-3}),
    ],
)
def test_the_likeliest_model_is_the_true_one_and_its_pupil_right(changes, expected, variances) -> None:
    found = models(fitted(**changes))
    best = min(found.values(), key=lambda each: each.deviance)
    assert best.deviance == pytest.approx(found[expected].deviance, abs=2)
    best = found[expected]
    assert best.deviance < found["shape"].deviance - 100
    for name, tau in variances.items():
        assert best.variances[name] == pytest.approx(tau, rel=0.3)
    assert best.noise_px == pytest.approx(0.1, rel=0.06)
    assert (np.abs(best.pupil - CAMERA.entrance_pupil(ANGLES)) < 3 * best.sigma).all()


def test_where_nothing_changes_all_models_are_one() -> None:
    fit = fitted()
    found = models(fit)
    for each in found.values():
        assert found["shape"].deviance - 12 < each.deviance <= found["shape"].deviance + 1e-2
        assert each.pupil == pytest.approx(fit.state.camera.entrance_pupil(ANGLES), abs=0.3 * each.sigma.max())
