"""Whether a calibration is as accurate as its noise allows, and whether it knows how accurate it is.

    OMP_NUM_THREADS=1 python benchmarks/efficiency.py [--draws 1000] [--seed 0] [--workers 2]

Each draw of the noise is fitted from nothing. The standard deviation of every parameter and of E(θ) over the draws is
divided by the Cramér–Rao bound, the inverse of the information at the truth; and the share of draws is counted in
which the truth lies within the standard deviation that the fit itself claims (68 % if the claim is true). Fewer draws
go through the whole of calibrate(), to show what the search for wrong points costs on data that have none; and as many
are left to "auto" altogether, which knows neither the family of the pupil nor that the board is flat.

Sampling alone scatters a ratio by 1/√(2 draws) and a share by 0.47/√draws: 2.2 % and 1.5 % with 1,000.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from monte_carlo import Scene, fit_from_nothing, markdown, spread_over

from fisheye_ep_calib import FisheyeCamera, calibrate
from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target

NOISE = 0.15  # px of each coordinate
ANGLES = np.array([30, 60, 80])  # degrees
RATIO_LIMIT = 1.07
AUTO_LIMIT = 1.15
COVERAGE = (0.63, 0.73)


def even_camera() -> FisheyeCamera:
    """The Table 1 camera with a pupil like a real lens's: even, −0.17 / −0.78 / −1.80 mm at 30 / 60 / 85°."""
    return replace(paper_camera(), model="ep_even", coefficients=(-0.6e-3, -0.1e-3))


@dataclass(frozen=True)
class Case:
    """model: of the camera and of the fit. discs: centres of gravity of discs, else points. whole: calibrate()."""

    model: str
    discs: bool = False
    whole: bool = False

    @property
    def title(self) -> str:
        features = "discs" if self.discs else "points"
        return f"{self.model}, {features}, {'calibrate()' if self.whole else 'one fit'}"


@cache
def scene(case: Case) -> Scene:
    camera = paper_camera() if case.model == "ep_odd" else even_camera()
    target = paper_target()
    poses = paper_poses(target)
    return Scene.create(camera, target if case.discs else replace(target, disc_radius=None), poses)


def quantities(camera: FisheyeCamera, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters and E at ANGLES (P + 3,), and their standard deviations under a covariance (P, P)."""
    theta = np.radians(ANGLES)
    sigma = np.concatenate([np.sqrt(np.diag(covariance)), pupil_sigma(camera, covariance, theta)])
    return np.concatenate([camera.parameters, camera.entrance_pupil(theta)]), sigma


def one_draw(task: tuple[Case, int]) -> tuple[np.ndarray, np.ndarray, int]:
    """Estimates, the standard deviations claimed for them, and the points cut as wrong."""
    case, seed = task
    observations = scene(case).draw(NOISE, seed)
    if case.whole:
        result = calibrate(observations, case.model)
        return *quantities(result.camera, result.uncertainty.covariance), len(result.rejected)
    fit = fit_from_nothing(observations, Structure(case.model))
    assert fit.adjustment.converged
    return *quantities(fit.state.camera, uncertainty(fit).covariance), 0


def report(case: Case, seeds: range, workers: int) -> bool:
    """Print a case's table; whether all of it lies within the limits, sampling error of few draws included."""
    draws = len(seeds)
    truth, bound = quantities(scene(case).camera, NOISE**2 * scene(case).bound)
    results = spread_over(one_draw, [(case, seed) for seed in seeds], workers)
    estimates, claimed = (np.stack([result[i] for result in results]) for i in (0, 1))
    error = estimates - truth
    ratio = error.std(axis=0, ddof=1) / bound
    bias = error.mean(axis=0) / bound
    covered = (np.abs(error) <= claimed).mean(axis=0)
    names = [*scene(case).camera.parameter_names, *(f"E({angle}°)" for angle in ANGLES)]
    cut = sum(result[2] for result in results)
    print(f"\n**{case.title}, {draws} draws, {NOISE} px**, {cut} points cut as wrong\n")
    header = ("", "bound (px, mm)", "std / bound", "bias / bound", "claimed σ / bound", "1σ covers")
    rows = [
        (
            name,
            f"{bound[i] * (1e3 if name[0] in 'eE' else 1):.2g}",
            f"{ratio[i]:.3f}",
            f"{bias[i]:+.3f}",
            f"{claimed[:, i].mean() / bound[i]:.3f}",
            f"{100 * covered[i]:.1f} %",
        )
        for i, name in enumerate(names)
    ]
    print(markdown(header, rows))
    # Below 1,000 draws the limits widen as the sampling error does.
    slack = np.sqrt(max(1000 / draws, 1.0))
    middle, reach = np.mean(COVERAGE), slack * np.ptp(COVERAGE) / 2
    good = ratio.max() <= 1 + slack * (RATIO_LIMIT - 1) and (np.abs(covered - middle) <= reach).all()
    print(
        f"\nlargest std / bound {ratio.max():.3f}; 1σ covers {100 * covered.min():.1f} to {100 * covered.max():.1f} %: "
        f"{'within' if good else 'OUTSIDE'} the limits"
    )
    return bool(good)


def auto_draw(task: tuple[Case, int]) -> tuple[np.ndarray, np.ndarray, str]:
    """Errors of fx, cx and E at ANGLES, what "auto" claims for each, and the model that it took."""
    case, seed = task
    known = scene(case)
    result = calibrate(known.draw(NOISE, seed))
    theta = np.radians(ANGLES)
    truth = np.array([known.camera.fx, known.camera.cx, *known.camera.entrance_pupil(theta)])
    found = np.array([result.camera.fx, result.camera.cx, *result.camera.entrance_pupil(theta)])
    covariance = result.uncertainty.covariance
    places = [result.camera.parameter_names.index(name) for name in ("fx", "cx")]
    sigma = [*np.sqrt(np.diag(covariance)[places]), *pupil_sigma(result.camera, covariance, theta)]
    return found - truth, np.array(sigma), result.model


def report_auto(case: Case, seeds: range, workers: int) -> bool:
    """Print what "auto" reaches on a case's camera; whether its errors are near the bound that knows the model."""
    _, bound = quantities(scene(case).camera, NOISE**2 * scene(case).bound)
    places = [scene(case).camera.parameter_names.index(name) for name in ("fx", "cx")] + [-3, -2, -1]
    bound = bound[places]
    results = spread_over(auto_draw, [(case, seed) for seed in seeds], workers)
    error, claimed = (np.stack([result[part] for result in results]) for part in (0, 1))
    ratio = np.sqrt((error**2).mean(axis=0)) / bound
    covered = (np.abs(error) <= claimed).mean(axis=0)
    models = Counter(result[2] for result in results)
    chosen = ", ".join(f"{name} {count}" for name, count in models.most_common())
    print(f"\n**auto on the {case.model} camera, {len(seeds)} draws**: {chosen}\n")
    names = ("fx", "cx", *(f"E({angle}°)" for angle in ANGLES))
    rows = [(names[i], f"{ratio[i]:.3f}", f"{100 * covered[i]:.1f} %") for i in range(len(names))]
    print(markdown(("", "rms error / bound", "1σ covers"), rows))
    good = ratio.max() <= AUTO_LIMIT
    print(f"\nlargest rms error / bound {ratio.max():.3f}: {'within' if good else 'OUTSIDE'} the limit")
    return bool(good)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1000, help="of one fit to points; a fifth of it for the rest")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw")
    parser.add_argument("--auto", action="store_true", help='nothing but "auto", with all draws')
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    many = range(arguments.seed, arguments.seed + arguments.draws)
    few = many[: max(len(many) // 5, 2)]
    good = True
    for model in ("ep_odd", "ep_even"):
        if arguments.auto:
            good &= report_auto(Case(model), many, arguments.workers)
            continue
        good &= report(Case(model), many, arguments.workers)
        good &= report(Case(model, discs=True), few, arguments.workers)
        good &= report(Case(model, whole=True), few, arguments.workers)
        good &= report_auto(Case(model), few, arguments.workers)
    raise SystemExit(0 if good else 1)


if __name__ == "__main__":
    main()
