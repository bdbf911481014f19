"""The tables of "Calibration of fisheye camera using entrance pupil" (Fasogbon and Aksu), run again on synthetic views.

    OMP_NUM_THREADS=1 python benchmarks/paper_tables.py [--draws 300] [--noise 0.156] [--seed 0] [--workers 2]
                                                        [--field 97.5] [--pupil 1]

25 views at 100–150 mm of the 11 × 7 circle target (12 mm pitch and 4 mm radius, which the paper does not state). The
features are true centres of gravity of projected discs, by an area integral, with Gaussian noise of σ per coordinate.
The paper does not state its noise; 0.156 px is where points measured by a perfect camera have the mean error 0.1956 px
of its Table 1 (σ √(π/2)). Its pupil coefficients have no unit; read as millimetres they are a usable truth.

Table 1: views of the proposed method's camera of Table 1, calibrated by every method.
Table 2: noise drawn again and again. For each method the truth is the camera of its own kind that is nearest to the
Table 1 camera (fitted to noiseless views of it), so that the Cramér–Rao bound means the same for all of them.
--draws 0 leaves Table 2 out. --field and --pupil narrow the views and shrink E(θ): what do the paper's errors imply?
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from monte_carlo import Scene, fit_from_nothing, markdown, spread_over

from fisheye_ep_calib import FisheyeCamera
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import paper_camera, paper_poses, paper_target

METHODS = {
    "Kannala": Structure("kannala"),
    "Gennery, 2 terms": Structure("gennery"),
    "Gennery, 3 terms": Structure("gennery", terms=3),
    "proposed (odd)": Structure("ep_odd"),
    "even, 2 terms": Structure("ep_even"),
    "even, 4 terms": Structure("ep_even", terms=4),
}
NAMES = ("fx", "fy", "skew", "cx", "cy", "e1", "e2", "e3", "e4", "k1", "k2", "k3", "k4")

# As printed; the pupil of the Gennery column has four coefficients there, three in his own model.
PAPER_TABLE_1 = {
    "Kannala": "587.9521 593.1520 0.2314 1020.3841 1028.0564 – – – – 0.0152 0.0161 -0.0232 0.0065 0.2913 0.0891",
    "Gennery, 3 terms": "597.3014 594.0581 0.1526 1013.7982 1024.2808 0.0712 -0.1092 0.2917 0.4861 "
    "-0.0096 0.0028 -0.0132 0.0027 0.2115 0.0792",
    "proposed (odd)": "591.7301 592.0340 0.1978 1013.2001 1025.0300 0.0851 -0.2577 0.3016 0.5368 "
    "0.0109 -0.0013 0.0008 -0.0004 0.1956 0.0735",
}
PAPER_TABLE_2 = {
    "Kannala": (0.1145, 0.1982, 0.3023, None, 0.0298),
    "Gennery, 3 terms": (0.9275, 0.2140, 0.2312, 0.0313, 0.0311),
    "proposed (odd)": (0.9081, 0.2047, 0.2147, 0.0305, 0.0354),
}
GROUPS = (("fx, fy", "f"), ("skew", "s"), ("cx, cy", "c"), ("e, mm", "e"), ("k", "k"))
ANGLES = (30, 60, 80)  # degrees


@dataclass(frozen=True)
class Setting:
    """noise: σ, px of each coordinate. field: degrees from the axis. pupil: factor on the Table 1 camera's E(θ)."""

    noise: float
    field: float = 97.5
    pupil: float = 1.0

    @property
    def camera(self) -> FisheyeCamera:
        camera = paper_camera()
        coefficients = tuple(self.pupil * value for value in camera.coefficients)
        return replace(camera, coefficients=coefficients, theta_max=np.radians(self.field))


@cache
def table_1_scene(setting: Setting) -> Scene:
    target = paper_target()
    return Scene.create(setting.camera, target, paper_poses(target))


@cache
def own_scene(setting: Setting, method: str) -> Scene:
    """Views, from the same poses, of the method's own camera that is nearest to the Table 1 camera."""
    scene = table_1_scene(setting)
    nearest = fit_from_nothing(scene.clean, METHODS[method]).state.camera
    nearest = replace(nearest, theta_max=np.radians(setting.field))
    return Scene.create(nearest, paper_target(), scene.poses)


def in_millimetres(name: str) -> float:
    return 1e3 if name[0] == "e" else 1.0


def table_1(setting: Setting, seed: int) -> Iterator[str]:
    """Parameters, mean error and its standard deviation over the points, px."""
    observations = table_1_scene(setting).draw(setting.noise, seed)
    fits = {method: fit_from_nothing(observations, METHODS[method]) for method in METHODS}
    ours = {method: _column(fit) for method, fit in fits.items()}
    printed = {method: text.split() for method, text in PAPER_TABLE_1.items()}
    truth = dict(zip(setting.camera.parameter_names, setting.camera.parameters, strict=True))
    header = ["", "truth"]
    rows: list[Sequence[str]]
    for method in METHODS:
        header += [method] + ["paper"] * (method in printed)
    rows = []
    for row, name in enumerate((*NAMES, "mean error, px", "std of error, px")):
        cells = [name, f"{truth[name] * in_millimetres(name):.4f}" if name in truth else ""]
        for method in METHODS:
            cells += [ours[method][row]] + ([printed[method][row]] if method in printed else [])
        rows.append(cells)
    yield markdown(header, rows)
    theta = np.radians(ANGLES)
    rows = [("truth", *(f"{value:+.3f}" for value in 1e3 * setting.camera.entrance_pupil(theta)))]
    for method, fit in fits.items():
        rows.append((method, *(f"{value:+.3f}" for value in 1e3 * fit.state.camera.entrance_pupil(theta))))
    yield markdown(("", *(f"E({angle}°), mm" for angle in ANGLES)), rows)


def _column(fit: Fit) -> list[str]:
    known = dict(zip(fit.state.camera.parameter_names, fit.state.camera.parameters, strict=True))
    cells = [f"{known[name] * in_millimetres(name):.4f}" if name in known else "–" for name in NAMES]
    length = np.hypot(*fit.residuals[0].T)
    return [*cells, f"{np.nanmean(length):.4f}", f"{np.nanstd(length):.4f}"]


def one_draw(task: tuple[Setting, str, int]) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (P,) and E at ANGLES, metres, of one draw."""
    setting, method, seed = task
    fit = fit_from_nothing(own_scene(setting, method).draw(setting.noise, seed), METHODS[method])
    assert fit.adjustment.converged
    return fit.state.camera.parameters, fit.state.camera.entrance_pupil(np.radians(ANGLES))


def table_2(setting: Setting, draws: int, seed: int, workers: int) -> Iterator[str]:
    """Standard deviations over the draws beside the bound and the paper's: by group, then by parameter."""
    groups: list[Sequence[str]] = []
    single: dict[str, dict[str, str]] = {}
    for method in METHODS:
        scene = own_scene(setting, method)
        results = spread_over(one_draw, [(setting, method, seed + draw) for draw in range(draws)], workers)
        found, pupil = (np.stack([result[part] for result in results]) for part in (0, 1))
        camera, names = scene.camera, scene.camera.parameter_names
        unit = np.array([in_millimetres(name) for name in names])
        spread = unit * found.std(axis=0, ddof=1)
        bound = unit * setting.noise * np.sqrt(np.diag(scene.bound))
        for label, values in (("measured", spread), ("bound", bound)):
            groups.append((method, label, *_by_group(names, values)))
        if method in PAPER_TABLE_2:
            printed = ["–" if value is None else f"{value:.4f}" for value in PAPER_TABLE_2[method]]
            groups.append((method, "paper", *printed))
        single[method] = {
            name: f"{spread[i]:.4g} / {bound[i]:.4g} = {spread[i] / bound[i]:.3f}" for i, name in enumerate(names)
        }
        if len(camera.coefficients):
            part = camera.parameter_slice("coefficients")
            basis = camera.pupil_family.basis(np.radians(ANGLES), len(camera.coefficients))
            limit = setting.noise * np.sqrt(np.einsum("it,ij,jt->t", basis, scene.bound[part, part], basis))
            for i, angle in enumerate(ANGLES):
                spread_e, limit_e = 1e3 * pupil[:, i].std(ddof=1), 1e3 * limit[i]
                single[method][f"E({angle}°)"] = f"{spread_e:.4g} / {limit_e:.4g} = {spread_e / limit_e:.3f}"
    yield markdown(("method", "", *(title for title, _ in GROUPS)), groups)
    rows = [
        (name, *(single[method].get(name, "–") for method in METHODS))
        for name in (*NAMES, *(f"E({angle}°)" for angle in ANGLES))
    ]
    yield "Measured / bound, e and E in mm:\n"
    yield markdown(("", *METHODS), rows)


def _by_group(names: tuple[str, ...], values: np.ndarray) -> list[str]:
    """The mean standard deviation of each group of parameters, as the paper gives it."""
    means = []
    for _, first in GROUPS:
        chosen = [value for name, value in zip(names, values, strict=True) if name[0] == first]
        means.append(f"{np.mean(chosen):.3g}" if chosen else "–")
    return means


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=300, help="of the noise, for Table 2")
    parser.add_argument("--noise", type=float, default=0.156, help="px of each coordinate")
    parser.add_argument("--seed", type=int, default=0, help="of the first draw")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--field", type=float, default=97.5, help="degrees from the axis that the views reach")
    parser.add_argument("--pupil", type=float, default=1.0, help="factor on the Table 1 camera's E(θ)")
    arguments = parser.parse_args()
    setting = Setting(arguments.noise, arguments.field, arguments.pupil)
    print(f"## Table 1, {setting.noise} px of noise\n")
    for part in table_1(setting, arguments.seed):
        print(part, end="\n\n")
    if arguments.draws == 0:
        return
    print(f"## Table 2: standard deviations over {arguments.draws} draws, {setting.noise} px of noise\n")
    for part in table_2(setting, arguments.draws, arguments.seed, arguments.workers):
        print(part, end="\n\n" if part.endswith("|") else "\n")


if __name__ == "__main__":
    main()
