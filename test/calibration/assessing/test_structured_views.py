"""One view whose points are off together is named, and what was different in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from changing_boards import seen_changing

from fisheye_ep_calib.calibration import Observations, calibrate

CHANGES = {
    "the board bent": {"flex": 3e-4},
    "the board stretched": {"in_plane": 1e-4},
    "moved while its shutter rolled": {"turn": 1e-2, "shift": 3e-3},
}


def seen(changed: dict[str, float], which: tuple[int, ...], views: int = 20, seed: int = 3) -> Observations:
    """A wavy board that changes in some of the views alone."""
    steady, changing = (seen_changing(**each, wave=1e-4, views=views, seed=seed) for each in ({}, changed))
    own = np.isin(changing.image_index, which)
    assert np.array_equal(changing.point_index, steady.point_index)
    return replace(steady, pixels=np.where(own[:, None], changing.pixels, steady.pixels))


def found(observations: Observations):
    result = calibrate(observations, "ep_even", board_shape="auto")
    return next(each for each in result.diagnosis.findings if each.name == "structured_views"), result


@pytest.mark.parametrize("views", [8, 20])
@pytest.mark.parametrize("words", CHANGES)
def test_a_view_that_differs_is_named_with_its_cause(words, views) -> None:
    finding, result = found(seen(CHANGES[words], (5,), views))
    assert finding.concern and finding.values["image"] == 5 and finding.values["views"] == 1
    assert result.observations.image_names[5] in finding.sentence and words in finding.sentence
    assert "leave it out or record it again" in finding.sentence


def test_several_are_named() -> None:
    finding, result = found(seen(CHANGES["the board bent"], (2, 5, 11)))
    assert finding.values["views"] == 3
    assert all(result.observations.image_names[image] in finding.sentence for image in (2, 5, 11))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("changed", [{}, {"flex": 1e-4}, {"shift": 1e-3}])
def test_no_view_is_named_where_all_are_alike(changed, seed) -> None:
    finding, _ = found(seen_changing(**changed, wave=1e-4, views=(8, 20)[seed % 2], seed=seed))
    assert not finding.concern
