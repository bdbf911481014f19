"""The error budget against mixtures of which every part is known by itself."""

from __future__ import annotations

from dataclasses import replace

import changing_boards
import numpy as np
import pytest
from changing_boards import seen_changing
from known_scenes import CAMERA

from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget, error_budget
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.report.panels import budget_bars

NOTHING = {"wave": 0.0, "rough": 0.0, "flex": 0.0, "in_plane": 0.0, "turn": 0.0, "shift": 0.0, "noise": 0.0}
MIXTURES = {
    "stretches less than it bends": {"wave": 3e-4, "flex": 1.5e-4, "in_plane": 1.5e-5, "noise": 0.05},
    "bends": {"wave": 2e-4, "flex": 1e-4, "noise": 0.1},
    "crumples": {"wave": 3e-4, "flex": 1e-4, "in_plane": 3e-5, "noise": 0.2},
    "scatters alone": {"rough": 1e-4, "noise": 0.15},
    "moves": {"wave": 1e-4, "turn": 2e-3, "shift": 5e-4, "noise": 0.1},
}
PARTS = {"board_px": ("wave",), "board_rough_px": ("rough",), "view_px": ("flex", "in_plane", "turn", "shift")}


def fitted(**amounts: float) -> Fit:
    return refine(first_fit(prepare(seen_changing(**(NOTHING | amounts), views=25))), Structure("ep_even"))


@pytest.mark.parametrize("name", MIXTURES)
def test_every_share_is_what_its_source_does_by_itself(name) -> None:
    mixture = MIXTURES[name]
    fit = fitted(**mixture)
    budget = error_budget(fit).to_dict()
    assert list(budget) == ["corner_noise_px", "board_px", "board_rough_px", "lens_px", "view_px"]
    assert budget["corner_noise_px"] == pytest.approx(np.sqrt(2) * mixture["noise"], rel=0.06)
    for share, sources in PARTS.items():
        if not any(mixture.get(source) for source in sources):
            assert budget[share] < 0.5 * budget["corner_noise_px"], share
            continue
        alone = fitted(**{source: mixture.get(source, 0.0) for source in sources}).rms_px
        assert budget[share] == pytest.approx(alone, rel=0.15), share
    assert budget["lens_px"] < 0.3 * budget["corner_noise_px"]
    assert np.sqrt(sum(px**2 for px in budget.values())) == pytest.approx(fit.rms_px, rel=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_points_that_are_off_beside_a_board_that_bends_have_their_share(seed) -> None:
    budget = error_budget(fitted(wave=2e-4, rough=1e-4, noise=0.15, seed=seed))
    alone = fitted(rough=1e-4, seed=seed).rms_px
    assert budget.board_rough_px == pytest.approx(alone, rel=0.15)
    assert 0 < budget.board_px < 0.7 * budget.board_rough_px


def test_the_lens_has_its_share(monkeypatch) -> None:
    """Of a camera with a field of its own that no lens model of the fit holds."""
    field = tuple(np.random.default_rng(5).normal(0, 1.0, len(LENS_FIELD.coefficient_names)))
    monkeypatch.setattr(changing_boards, "CAMERA", replace(CAMERA, extras={"lens_field": field}))
    budget = error_budget(fitted(noise=0.1, wave=1e-4))
    alone = fitted().rms_px
    assert alone > 0.1
    assert budget.lens_px == pytest.approx(alone, rel=0.3)


def test_what_would_help_most() -> None:
    def advice(**shares: float) -> str:
        return ErrorBudget(
            **({"corner_noise_px": 0.1, "board_px": 0, "board_rough_px": 0, "lens_px": 0, "view_px": 0} | shares)
        ).sentence

    assert "glue it to glass" in advice(board_px=0.3, lens_px=0.1)
    assert "your lens limits you" in advice(board_px=0.1, lens_px=0.3)
    assert "corner noise limits you" in advice(board_px=0.03)
    assert "use a stiff one" in advice(view_px=0.3)
    assert "shutter" in advice(view_px=0.3, rolling=True)


def test_the_page_has_a_bar_for_every_source() -> None:
    shares = {"corner_noise_px": 0.14, "board_px": 0.38, "board_rough_px": 0.17, "lens_px": 0.07, "view_px": 0.12}
    bars = {bar.label: bar for bar in budget_bars(ErrorBudget(**shares))}
    assert list(bars) == ["corner noise", "board, its shape", "board, single points", "lens", "from view to view"]
    assert bars["board, its shape"].text == "0.380" and bars["board, its shape"].share == 1
    assert bars["corner noise"].share == pytest.approx(0.14 / 0.38)
