"""The findings of boards that bend between views and of motion while the shutter rolls."""

from __future__ import annotations

import pytest
from changing_boards import seen_changing

from fisheye_ep_calib.calibration.assessing.view_changes import changes_found, view_changes
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure

CHANGES = {
    "board_flexes": {"flex": 8e-5, "in_plane": 1e-5},
    "rolling_shutter": {"turn": 1.5e-3, "shift": 5e-4},
}


def findings(**changes) -> dict:
    fit = refine(first_fit(prepare(seen_changing(**changes))), Structure("ep_even"))
    return {each.name: each for each in changes_found(view_changes(joint_variances(fit)))}


@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize(("views", "larger"), [(8, 2.0), (20, 1.0)])
@pytest.mark.parametrize("name", CHANGES)
def test_what_changes_is_told_and_nothing_else(name, views, larger, seed) -> None:
    amounts = {kind: larger * amount for kind, amount in CHANGES[name].items()}
    found = findings(**amounts, wave=1e-4, views=views, seed=seed)
    assert [each.name for each in found.values() if each.concern] == [name]


def test_their_words() -> None:
    flexes = findings(**CHANGES["board_flexes"])["board_flexes"]
    assert "the board bent between views" in flexes.sentence and "use a stiff one" in flexes.sentence
    assert flexes.values["flex_mm"] == pytest.approx(0.08, rel=0.3)
    rolls = findings(**CHANGES["rolling_shutter"])["rolling_shutter"]
    assert "moved while the shutter rolled" in rolls.sentence
    assert rolls.values["shift_mm"] == pytest.approx(0.5, rel=0.3)


@pytest.mark.parametrize("wave", [0.0, 2e-4])
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_a_board_that_stays_as_it_is_raises_nothing(wave, seed) -> None:
    found = findings(wave=wave, seed=seed, views=(8, 20)[seed % 2])
    assert not [name for name, each in found.items() if each.concern or each.values["gain"] > 25]
