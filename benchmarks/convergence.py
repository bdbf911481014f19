"""Whether a calibration finds its way from nothing: random cameras, random views, with and without gross errors.

    OMP_NUM_THREADS=1 python benchmarks/convergence.py [--scenes 100] [--seed 0] [--workers 2]

Fields of view from 2 × 40 to 2 × 100°, principal points up to 5 % of the width off the middle, lenses on both sides of
equidistant, full-frame and circular images of several shapes, odd and even pupils, 10 to 30 views of partly visible
boards, 0.05 to 0.3 px of noise. Every scene is calibrated twice through calibrate(): as it is, and with one point in
ten put anywhere in the image. It has converged when the noise estimated from what is left is the noise that was added,
within four standard errors and 1 %.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from monte_carlo import markdown, spread_over

from fisheye_ep_calib import CalibrationError, FisheyeCamera, Observations, calibrate
from fisheye_ep_calib.simulation import look_pose, observe, paper_target

NARROWEST, WIDEST = 40.0, 100.0  # degrees, half the field of view
OFF_CENTRE = 0.05  # of the width
WRONG = 0.1  # share of the points
IMAGE_SIZES = ((2048, 2048), (1280, 800), (1920, 1080), (640, 480), (1280, 1280))


@dataclass(frozen=True)
class RandomScene:
    camera: FisheyeCamera
    clean: Observations
    noise: float


@dataclass(frozen=True)
class Outcome:
    """noise_ratio: estimated over true noise; allowed: how far from 1 it may be. cut_good: good points rejected.

    kept_wrong: points more than 6 σ off that were kept, in views of which at least half is good.
    """

    seed: int
    theta_max_deg: float
    wrong: float
    points: int
    noise_ratio: float
    allowed: float
    cut_good: int
    kept_wrong: int
    error: str = ""

    @property
    def good(self) -> bool:
        return abs(self.noise_ratio - 1) <= self.allowed


def random_camera(rng: np.random.Generator, theta_max: float) -> FisheyeCamera:
    """A camera whose r(θ) increases up to theta_max, rad, and fills its image there."""
    width, height = IMAGE_SIZES[rng.integers(len(IMAGE_SIZES))]
    radius = rng.uniform(0.45 * height, 0.5 * np.hypot(width, height))
    offset = OFF_CENTRE * width * np.sqrt(rng.uniform()) * np.exp(2j * np.pi * rng.uniform())
    shift = -rng.uniform(0.2e-3, 4e-3)  # E at 90°, metres
    share = rng.uniform(0.3, 0.9)
    quarter = np.pi / 2
    odd = rng.uniform() < 0.5
    coefficients = (
        (shift * share / quarter**3, shift * (1 - share) / quarter**5, 0.0, 0.0)
        if odd
        else (shift * share / quarter**2, shift * (1 - share) / quarter**4)
    )
    while True:
        radial = (rng.uniform(-0.06, 0.06), rng.uniform(-0.01, 0.01), rng.uniform(-0.002, 0.002), 0.0)
        unit = FisheyeCamera((width, height), 1.0, 1.0, 0.0, 0.0, radial=radial)
        if unit.theta_limit > theta_max + 0.05:
            break
    focal = radius / float(unit.radius(theta_max))
    return FisheyeCamera(
        (width, height),
        focal,
        focal * rng.uniform(0.995, 1.005),
        (width - 1) / 2 + offset.real,
        (height - 1) / 2 + offset.imag,
        skew=rng.uniform(-0.5, 0.5),
        radial=radial,
        model="ep_odd" if odd else "ep_even",
        coefficients=coefficients,
        theta_max=theta_max,
    )


def random_scene(seed: int, theta_max_deg: float) -> RandomScene:
    rng = np.random.default_rng([seed, 5])
    camera = random_camera(rng, np.radians(theta_max_deg))
    target = replace(paper_target(), disc_radius=None)
    poses = np.stack(
        [
            look_pose(
                target,
                theta=0.85 * camera.theta_max * np.sqrt(rng.uniform()),
                azimuth=rng.uniform(0, 2 * np.pi),
                distance=rng.uniform(0.09, 0.30),
                tilt=np.radians(rng.uniform(0, 45)),
                tilt_azimuth=rng.uniform(0, 2 * np.pi),
                roll=rng.uniform(0, 2 * np.pi),
            )
            for _ in range(rng.integers(10, 31))
        ]
    )
    return RandomScene(camera, observe(camera, target, poses), rng.uniform(0.05, 0.3))


def run(task: tuple[int, float, float]) -> Outcome:
    """Draw noise and wrong points, calibrate, compare."""
    seed, theta_max_deg, wrong = task
    scene = random_scene(seed, theta_max_deg)
    rng = np.random.default_rng([seed, 6])
    count = len(scene.clean.pixels)
    pixels = scene.clean.pixels + rng.normal(0, scene.noise, (count, 2))
    moved = rng.uniform(size=count) < wrong
    pixels[moved] = rng.uniform(0, np.array(scene.camera.image_size) - 1, (int(moved.sum()), 2))
    observations = replace(scene.clean, pixels=pixels)
    try:
        result = calibrate(observations, scene.camera.model)
    except CalibrationError as error:
        return Outcome(seed, theta_max_deg, wrong, count, np.inf, 0.0, 0, 0, str(error))
    used = np.isin(observations.image_index, result.view_images)
    cut = {(one.view, one.point) for one in result.rejected}
    rejected = np.array([pair in cut for pair in zip(observations.image_index, observations.point_index, strict=True)])
    far = np.hypot(*(pixels - scene.clean.pixels).T) > 6 * scene.noise
    return Outcome(
        seed,
        theta_max_deg,
        wrong,
        count,
        result.uncertainty.sigma_px / scene.noise,
        4 / np.sqrt(2 * result.fit.degrees_of_freedom) + 0.01,
        int((rejected & ~moved).sum()),
        int((used & ~rejected & far).sum()),
        "" if result.converged else "not converged",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="of the first scene")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    angles = NARROWEST + (WIDEST - NARROWEST) * (np.arange(arguments.scenes) + 0.5) / arguments.scenes
    rows, failures = [], []
    for wrong in (0.0, WRONG):
        tasks = [(arguments.seed + scene, float(angle), wrong) for scene, angle in enumerate(angles)]
        outcomes = spread_over(run, tasks, arguments.workers)
        good = [outcome for outcome in outcomes if outcome.good and not outcome.error]
        failures += [outcome for outcome in outcomes if outcome not in good]
        ratios = [outcome.noise_ratio for outcome in good]
        rows.append(
            (
                f"{100 * wrong:.0f} %",
                f"{len(good)} of {len(outcomes)}",
                f"{min(ratios, default=np.nan):.3f} to {max(ratios, default=np.nan):.3f}",
                f"{sum(outcome.points for outcome in outcomes)}",
                f"{sum(outcome.cut_good for outcome in outcomes)}",
                f"{sum(outcome.kept_wrong for outcome in outcomes)}",
            )
        )
    header = ("gross errors", "converged", "noise found / added", "points", "good points cut", "wrong points kept")
    print(markdown(header, rows))
    for outcome in failures:
        print(f"failed: {outcome}")
    raise SystemExit(1 if failures else 0)


if __name__ == "__main__":
    main()
