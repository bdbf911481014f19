"""Whether the band of E(θ) that "auto" gives holds on lenses that no family of pupils was made for.

    OMP_NUM_THREADS=1 python benchmarks/coverage.py [--draws 20] [--seed 0] [--views 25] [--noise 0.15] [--far]

Every published lens of the package is traced at f = 3.5 mm on 2048 × 2048 pixels, its field to 1000 px; a board of
11 × 7 points is seen at 100–150 mm, 25 times as in the paper or at random, and calibrated from nothing. Counted is in
how many draws the true E lies within the 1σ that is claimed, 68 % if the claim is true, beside the root mean square of
error/σ, 1 then. A lens is one truth: where its E departs from what most lenses have, it is covered less, another more.
--far: a board
three times as large at 0.8–2 m, from where hardly a pupil shows, and its band is that of what is left open. Over all
lenses the share should be right. Sampling alone scatters a share by 0.47/√draws.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from efficiency import even_camera
from monte_carlo import markdown, spread_over

from fisheye_ep_calib import calibrate
from fisheye_ep_calib.camera.bands import entrance_pupil_band
from fisheye_ep_calib.simulation import (
    PUBLISHED_LENSES,
    observe,
    paper_poses,
    paper_target,
    published_camera,
    random_poses,
)

ANGLES = (10, 30, 60, 80)  # degrees, and the rim
FEWEST_OF_PAPER = 25  # views
INSIDE = "even camera"  # of two terms: a family of pupils that "auto" knows

FAR, LARGER = (0.8, 2.0), 3  # metres; times the paper's board

Task = tuple[str, int, int, float, bool]  # lens, seed, views, noise, far


def one_draw(task: Task) -> tuple[np.ndarray, np.ndarray, str]:
    """Error of E and error/σ at ANGLES and the rim, metres, and the model taken with its terms of E and of r(θ)."""
    name, seed, views, noise, far = task
    camera = even_camera() if name == INSIDE else published_camera(name)
    target = replace(paper_target(), disc_radius=None)
    own_noise = 1000 * [*PUBLISHED_LENSES, INSIDE].index(name) + seed
    if far:
        target = replace(target, object_points=LARGER * target.object_points)
        poses = random_poses(target, views, own_noise, FAR)
    else:
        poses = paper_poses(target, 0) if views == FEWEST_OF_PAPER else random_poses(target, views, seed)
    result = calibrate(observe(camera, target, poses, noise, own_noise))
    theta = np.minimum(np.radians([*ANGLES, 180]), result.fit.largest_angle)
    pupil, sigma, _ = entrance_pupil_band(result.camera, result.uncertainty.covariance, theta)
    error = pupil - camera.entrance_pupil(theta)
    terms = len(result.camera.coefficients), len(result.camera.radial)
    return error, error / sigma, f"{result.model} {terms[0]}, r {terms[1]}"


def row(name: str, draws: Sequence[tuple[np.ndarray, np.ndarray, str]]) -> list[str]:
    """Of the table: shares covered, root mean square of error/σ, of the error, and what was chosen."""
    error, ratio = (np.stack([draw[part] for draw in draws]) for part in (0, 1))
    covered = [f"{100 * share:.0f}" for share in (np.abs(ratio) <= 1).mean(axis=0)]
    spread = " ".join(f"{value:.2f}" for value in np.sqrt((ratio**2).mean(axis=0)))
    size = " ".join(f"{1e3 * value:.2g}" for value in np.sqrt((error**2).mean(axis=0)))
    chosen = ", ".join(f"{model}: {count}" for model, count in Counter(draw[2] for draw in draws).most_common(2))
    return [name, *covered, spread, size, chosen]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20, help="of each lens")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw")
    parser.add_argument("--views", type=int, default=FEWEST_OF_PAPER)
    parser.add_argument("--noise", type=float, default=0.15, help="px of each coordinate")
    parser.add_argument("--far", action="store_true")
    parser.add_argument("--lenses", nargs="+", default=[*PUBLISHED_LENSES, INSIDE])
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.draws)
    how = (arguments.views, arguments.noise, arguments.far)
    tasks = [(name, seed, *how) for name in arguments.lenses for seed in seeds]
    results = spread_over(one_draw, tasks, arguments.workers)
    by_lens = {
        name: [result for task, result in zip(tasks, results, strict=True) if task[0] == name]
        for name in arguments.lenses
    }
    rows = [row(name, draws) for name, draws in by_lens.items()]
    traced = [draw for name, draws in by_lens.items() if name != INSIDE for draw in draws]
    if traced:
        rows.append(row("all traced lenses", traced))
    header = ("lens", *(f"{angle}°" for angle in ANGLES), "rim", "rms of error/σ", "rms error, mm", "chosen")
    print(f"1σ of E covers, %: {arguments.draws} draws of {arguments.views} views, {arguments.noise} px\n")
    print(markdown(header, rows))


if __name__ == "__main__":
    main()
