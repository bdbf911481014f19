"""The error budget of simulated mixtures against what each source does by itself.

    OMP_NUM_THREADS=1 python benchmarks/error_budget.py [--draws 10] [--views 25] [--workers 2]

Every mixture is drawn once whole and once a source, the others away: the RMS of the fit to that alone is what its share
should be. The lens's source is a field that is not symmetric. The table has the mean of found over true, and its
scatter over draws.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import board_shape
import findings
import numpy as np
from findings import draw
from monte_carlo import markdown, spread_over

from fisheye_ep_calib.calibration.assessing.error_budget import error_budget
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.simulation import paper_camera

SHARES = {
    "board_px": ("base", "stretch"),
    "board_rough_px": ("rough",),
    "lens_px": ("lens",),
    "view_px": ("flex", "in plane", "turn", "shift"),
    "corner_noise_px": ("noise",),
}
MIXTURES = {
    "bow, noise": {"base": "bow .3", "noise": 0.15},
    "weak bow, noise": {"base": "bow .3", "weaker": 0.2, "noise": 0.15},
    "weak bow, rough, noise": {"base": "bow .3", "weaker": 0.2, "rough": 0.02, "noise": 0.1},
    "wave, noise": {"base": "wave .1", "noise": 0.15},
    "rough, noise": {"rough": 0.03, "noise": 0.15},
    "wave, rough, noise": {"base": "wave .3", "rough": 0.05, "noise": 0.15},
    "bow, rough, noise": {"base": "bow .3", "rough": 0.05, "noise": 0.1},
    "bow, flex, noise": {"base": "bow .3", "flex": 0.08, "noise": 0.15},
    "wave, rough, flex, noise": {"base": "wave .3", "rough": 0.03, "flex": 0.08, "in plane": 0.01, "noise": 0.1},
    "wave, motion, noise": {"base": "wave .1", "turn": 0.08, "shift": 0.2, "noise": 0.1},
    "wave, lens, noise": {"base": "wave .1", "lens": 1.0, "noise": 0.1},
    "all": {"base": "wave .3", "rough": 0.03, "flex": 0.05, "lens": 1.0, "noise": 0.1},
}
_ABSENT = {"base": "flat", "noise": 1e-3}
_ANY = 0.2  # of the corner noise: a source that does less is not there
LIMITS = dict.fromkeys(SHARES, 0.15) | {"lens_px": 0.5}


def fitted(mixture: dict[str, float | str], views: int, seed: int) -> Fit:
    amounts = _ABSENT | mixture
    strength = float(amounts.pop("lens", 0.0))
    field = strength * np.random.default_rng([seed, 79]).normal(0, 1.0, len(LENS_FIELD.coefficient_names))
    camera = replace(paper_camera(), extras={LENS_FIELD.name: tuple(field.tolist())} if strength else {})
    findings.camera_of = lambda _: camera
    weaker, whole = float(amounts.pop("weaker", 1.0)), board_shape.true_points

    def weakened(kind: str, rng: np.random.Generator) -> np.ndarray:
        flat = whole("flat", rng)
        return flat + weaker * (whole(kind, rng) - flat)

    findings.true_points = weakened
    return refine(first_fit(prepare(draw(amounts, views, seed))), Structure("ep_odd"))


def one_draw(task: tuple[str, int, int]) -> tuple[list[float], list[float]]:
    """Found and true, px, of every share."""
    name, views, seed = task
    mixture = MIXTURES[name]
    found = error_budget(fitted(mixture, views, seed)).to_dict()
    true = []
    for sources in SHARES.values():
        own = {source: mixture[source] for source in (*sources, "weaker") if source in mixture}
        true.append(fitted(own, views, seed).rms_px if any(source in mixture for source in sources) else 0.0)
    true[-1] = float(np.sqrt(2)) * float(mixture["noise"])
    return [found[share] for share in SHARES], true


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--views", type=int, default=25, choices=[25, 8])
    parser.add_argument("--mixtures", nargs="+", default=list(MIXTURES), choices=list(MIXTURES), metavar="MIXTURE")
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    rows, good = [], True
    for name in arguments.mixtures:
        tasks = [(name, arguments.views, seed) for seed in range(arguments.draws)]
        found, true = (np.array(each) for each in zip(*spread_over(one_draw, tasks, arguments.workers), strict=True))
        cells = [name]
        for index, share in enumerate(SHARES):
            if true[:, index].mean() < _ANY * true[:, -1].mean():
                cells.append(f"– ({found[:, index].mean():.3f})")
                continue
            ratio = found[:, index] / true[:, index]
            good &= bool(abs(ratio.mean() - 1) <= LIMITS[share])
            cells.append(f"{true[:, index].mean():.3f}: {ratio.mean():.2f} ± {ratio.std():.2f}")
        print(" | ".join(cells), flush=True)
        rows.append(cells)
    print(markdown(("mixture", *(f"{share.removesuffix('_px')}, px: found / true" for share in SHARES)), rows))
    print("within the limits" if good else "OUTSIDE the limits")


if __name__ == "__main__":
    main()
