"""Bands of E on lenses that no family of pupils was made for: traced ones, whose E is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import CAMERA
from scipy.stats import norm

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.estimating.adjustment import evaluate
from fisheye_ep_calib.calibration.estimating.fit import refine
from fisheye_ep_calib.calibration.estimating.normal_equations import reduced_information
from fisheye_ep_calib.calibration.pupil_prior import ROOM, SHARES, PupilPrior
from fisheye_ep_calib.calibration.selecting.open_terms import with_open_terms
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import PUBLISHED_LENSES, observe, paper_poses, paper_target, published_camera

BOARD = replace(paper_target(), disc_radius=None)
POSES = paper_poses(BOARD, 0)
NOISE = 0.15  # px
THETA = np.radians([10, 30, 60, 80])


@pytest.fixture(scope="module")
def seen_through() -> dict:
    """Each lens and its views without noise."""
    lenses = {name: published_camera(name) for name in PUBLISHED_LENSES}
    return {name: (lens, observe(lens, BOARD, POSES)) for name, lens in lenses.items()}


def noisy(observations, seed: int):
    error = np.random.default_rng([seed, 31]).normal(0, NOISE, observations.pixels.shape)
    return replace(observations, pixels=observations.pixels + error)


def angles(lens) -> np.ndarray:
    """THETA and the rim, rad."""
    return np.minimum([*THETA, np.pi], 0.98 * lens.theta_limit)


def test_the_prior_leaves_the_first_terms_alone_and_is_what_it_says() -> None:
    precision = PupilPrior(scale=2e-3, angle=1.6, known=2, room=ROOM).precision()
    assert not precision[:2].any() and not precision[:, :2].any()
    covariance = np.linalg.inv(precision[2:, 2:])
    assert np.sqrt(covariance[1, 1]) == pytest.approx(ROOM * SHARES[4] * 2e-3)
    theta = np.linspace(0, 1.6, 201)[1:]
    nearest = np.linalg.lstsq(np.stack([theta**2, theta**4, theta**6], axis=1), theta**8, rcond=None)[0][2]
    along = np.array([1.0, nearest])
    assert np.sqrt(along @ covariance @ along) == pytest.approx(SHARES[3] * 2e-3)
    assert abs(along @ covariance[1]) < 1e-9 * covariance[1, 1] * nearest  # free of each other
    three = PupilPrior(scale=2e-3, angle=1.6, known=3).precision()
    assert np.count_nonzero(three) == 1 and three[3, 3] == pytest.approx((SHARES[4] * 2e-3) ** -2)
    assert not PupilPrior(2e-3, 1.6, known=4).precision().any()


def test_the_scale_of_a_lens_is_told_by_its_rim(seen_through) -> None:
    """Within a tenth, though two terms alone have an e1 that is lower by up to a quarter."""
    for lens, clean in seen_through.values():
        two = calibrate(clean, "ep_even").fit
        prior = PupilPrior.like(two.state.camera, two.largest_angle, known=2)
        assert prior.scale == pytest.approx(-float(lens.entrance_pupil(0.02)) / 0.02**2, rel=0.12)


def test_what_is_known_beforehand_has_its_gradient_and_its_information(seen_through) -> None:
    fit = calibrate(noisy(seen_through["muller_16"][1], 0), "ep_even").fit
    prior = PupilPrior(1e-3, fit.largest_angle, known=2)
    fit = refine(fit, replace(fit.structure, terms=4, pupil_prior=prior))
    names = fit.state.camera.parameter_names
    without = replace(fit.problem, prior=None)
    moved = fit.state.camera.parameters + np.where(np.isin(names, ["e3", "e4"]), 1e-5, 0.0)
    state = replace(fit.state, camera=fit.state.camera.with_parameters(moved))
    known, plain = (evaluate(problem, state) for problem in (fit.problem, without))
    pull = fit.problem.prior @ moved
    assert known.cost - plain.cost == pytest.approx(0.5 * moved @ pull)
    assert known.shared_gradient - plain.shared_gradient == pytest.approx(pull[fit.problem.free])
    more = reduced_information(known) - reduced_information(plain)
    free = fit.problem.free
    assert np.diag(more) == pytest.approx(np.diag(fit.problem.prior)[free], rel=1e-3, abs=1e-3 * np.diag(more).max())
    # At the minimum the data pull as much as the prior.
    assert np.abs(fit.adjustment.equations.shared_gradient).max() < 1e-3 * np.abs(pull).max()


def share_covered(lens, observations) -> np.ndarray:
    """How often 1σ covers E at the angles (5,), over all noise: estimate and band are linear in it.

    With the information H of four terms beside six of r(θ), its solution x without noise and the prior Λ, the estimate
    is (H + Λ)⁻¹ H x, its scatter σ² (H + Λ)⁻¹ H (H + Λ)⁻¹ and what is claimed σ² (H + Λ)⁻¹.
    """
    fit = calibrate(observations, "ep_even", terms=4, lens="kannala_brandt_6").fit
    names, values = fit.shared_parameters
    prior = replace(PupilPrior.like(fit.state.camera, fit.largest_angle, known=2), room=ROOM)
    penalty = prior.penalty(fit.state.camera, NOISE**2)[np.ix_(fit.problem.free, fit.problem.free)]
    information = reduced_information(fit.settled)
    scale = 1 / np.sqrt(np.diag(information + penalty))
    inverse = np.linalg.inv((information + penalty) * scale[:, None] * scale) * scale[:, None] * scale
    pupil = [names.index(f"e{term}") for term in (1, 2, 3, 4)]
    basis = angles(lens)[:, None] ** [2, 4, 6, 8]

    def sigma(covariance: np.ndarray) -> np.ndarray:
        return NOISE * np.sqrt(np.einsum("ai,ij,aj->a", basis, covariance[np.ix_(pupil, pupil)], basis))

    bias = basis @ (values - inverse @ penalty @ values)[pupil] - lens.entrance_pupil(angles(lens))
    claimed, scatter = sigma(inverse), sigma(inverse @ information @ inverse)
    return norm.cdf((claimed - bias) / scatter) - norm.cdf((-claimed - bias) / scatter)


def test_over_the_published_lenses_one_sigma_covers_68_per_cent(seen_through) -> None:
    """At 10, 30, 60, 80° and the rim; a single lens is one truth, covered more or less."""
    covered = np.array([share_covered(*lens) for lens in seen_through.values()])
    assert (np.abs(covered.mean(axis=0) - 0.683) <= 0.05).all(), covered.mean(axis=0)
    assert covered.min() > 0.4, covered.round(2)


@pytest.mark.parametrize("name", ["laikin_170", "nakagawa_8", "adachi_8"])
def test_open_terms_hold_what_two_terms_do_not_see(name, seen_through) -> None:
    lens, clean = seen_through[name]
    off = {"two": [], "open": []}
    for seed in range(2):
        plain = calibrate(noisy(clean, seed), "ep_even", lens="kannala_brandt_6").fit
        opened = with_open_terms(plain, lens_open=False)
        assert opened.structure.pupil_terms == 4 and opened.adjustment.converged
        for told, fit in (("two", plain), ("open", opened)):
            camera = replace(fit.state.camera, theta_max=fit.largest_angle)
            result = np.zeros((len(camera.parameters),) * 2)
            covariance = fit.noise_variance[0] * np.linalg.pinv(reduced_information(fit.settled), hermitian=True)
            result[np.ix_(fit.problem.free, fit.problem.free)] = covariance
            error = camera.entrance_pupil(angles(lens)) - lens.entrance_pupil(angles(lens))
            off[told].append(error / pupil_sigma(camera, result, angles(lens)))
    spread = {told: np.sqrt(np.mean(np.square(ratios), axis=0)) for told, ratios in off.items()}
    assert (spread["open"] < 2.2).all()
    if name == "laikin_170":
        assert spread["two"][:2].min() > 3.0


def test_a_pupil_that_the_data_tell_is_not_drawn_to_other_lenses(seen_through) -> None:
    """Terms that are supported have no prior, and a pupil of the sign that no lens has stays as it is."""
    observations = noisy(seen_through["isshiki_6"][1], 1)
    four = calibrate(observations, "ep_even", terms=4).fit
    same = with_open_terms(four, lens_open=False)
    assert same.state.camera.coefficients == pytest.approx(four.state.camera.coefficients, rel=1e-3)
    turned = replace(CAMERA, coefficients=tuple(-value for value in CAMERA.coefficients))
    two = calibrate(observe(turned, BOARD, POSES, NOISE, 1), "ep_even").fit
    assert with_open_terms(two, lens_open=True) is two


@pytest.mark.slow
def test_auto_covers_68_per_cent_over_the_published_lenses(seen_through) -> None:
    """All of calibrate(), 8 draws a lens: 88 draws scatter by 5 %."""
    inside = []
    for number, (lens, clean) in enumerate(seen_through.values()):
        for seed in range(8):
            result = calibrate(noisy(clean, 100 * number + seed))
            theta = np.minimum(angles(lens), result.fit.largest_angle)
            sigma = pupil_sigma(result.camera, result.uncertainty.covariance, theta)
            inside.append(np.abs(result.camera.entrance_pupil(theta) - lens.entrance_pupil(theta)) <= sigma)
    assert (np.abs(np.mean(inside, axis=0) - 0.683) <= 0.15).all(), np.mean(inside, axis=0)
