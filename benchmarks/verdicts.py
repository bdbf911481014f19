"""Whether an entrance pupil is claimed where there is one, and only there.

    OMP_NUM_THREADS=1 python benchmarks/verdicts.py [--draws 20] [--workers 2]

Synthetic: the Table 1 camera with an even pupil of several sizes, none among them, with new poses and noise for each
draw; once more with a lens that four terms of r(θ) do not follow; and with boards that are bent, rough, flex or stretch
from view to view, and shutters that roll. Real: public data sets, where they are at hand
(FISHEYE_EP_CALIB_DATA, or ../shared/data). Everything through the default ``auto``, which also decides skew,
tangential terms, the lens and the board's bow.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from findings import draw
from monte_carlo import markdown, spread_over

from fisheye_ep_calib import CalibrationResult, FisheyeCamera, Observations, calibrate
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.calibration.selecting.pupil_verdict import DOUBTFUL, SUPPORTED
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses, paper_target

MODELS = ("kannala", "ep_odd", "ep_even", "gennery")
DATA_SETS = ("ov_plane", "urban_fisheye2", "jy_left")
TRAINED = "ov_plane"  # has a split into training and test images
NOISE = 0.15  # px of each coordinate
SIZES = (0.0, 0.05, 0.1, 0.2, 1.0)  # of a real lens's pupil
BENT = 5e-4  # k6 of a lens that four terms follow no better than 0.3 px RMS
BENT_SIZES = (0.0, 0.2, 1.0)
DISTURBANCES: dict[str, dict] = {  # as in findings.py
    "flat": {},
    "bent": {"base": "wave .3"},
    "rough": {"rough": 0.05},
    "flexing": {"flex": 0.08},
    "stretching": {"in plane": 0.02},
    "rolling shutter": {"turn": 0.08, "shift": 0.2},
}
DISTURBED_SIZES = {0.0: 3, 0.1: 1, 0.2: 1}  # draws of each disturbance, with 25 and 8 views, both bends
PUPIL = np.array([-0.6e-3, -0.1e-3])  # E(80°) = −1.55 mm
REPOSITORY = Path(__file__).resolve().parents[1]


def camera_with(size: float, bend: float) -> FisheyeCamera:
    """A camera with a pupil of a size in a lens with a k6."""
    camera = replace(paper_camera(), model="ep_even", coefficients=tuple((size * PUPIL).tolist()))
    return replace(camera, lens="kannala_brandt_6", radial=(*camera.radial, 0.0, bend))


def one_disturbed(task: tuple[float, float, str, int, int]) -> str:
    """Verdict where something else than the pupil moves the points."""
    size, bend, disturbance, views, seed = task
    observations = draw(DISTURBANCES[disturbance], views, seed, camera_with(size, bend))
    return calibrate(observations).pupil_verdict.answer


def disturbed_table(workers: int) -> str:
    rows = []
    for size, draws in DISTURBED_SIZES.items():
        tasks = [
            (size, bend, disturbance, views, 100 * int(10 * size) + seed)
            for disturbance, bend, views, seed in product(DISTURBANCES, (0.0, BENT), (25, 8), range(draws))
        ]
        found = spread_over(one_disturbed, tasks, workers)
        edge = np.radians(80) ** np.array([2, 4]) @ (size * PUPIL)
        told = ", ".join(task[2] for task, answer in zip(tasks, found, strict=True) if answer == SUPPORTED)
        counts = (f"{found.count(answer)} of {len(tasks)}" for answer in (SUPPORTED, DOUBTFUL))
        rows.append((f"{1e3 * edge:.2f}", *counts, told))
    return markdown(("E(80°), mm", SUPPORTED, DOUBTFUL, "supported with"), rows)


def one_draw(task: tuple[float, float, int]) -> tuple[str, str]:
    """Verdict and chosen model for a pupil of a size in a lens with a k6."""
    size, bend, seed = task
    camera = camera_with(size, bend)
    target = replace(paper_target(), disc_radius=None)
    result = calibrate(observe(camera, target, paper_poses(target, seed), NOISE, seed))
    return result.pupil_verdict.answer, f"{result.model}{', 6 terms' * (result.camera.lens == camera.lens)}"


def synthetic_table(sizes: Sequence[float], bend: float, draws: int, workers: int) -> str:
    rows = []
    for size in sizes:
        verdicts = spread_over(one_draw, [(size, bend, seed) for seed in range(draws)], workers)
        edge = np.radians(80) ** np.array([2, 4]) @ (size * PUPIL)
        models = [model for _, model in verdicts]
        rows.append(
            (
                f"{1e3 * edge:.2f}",
                *(f"{sum(found == answer for found, _ in verdicts)} of {draws}" for answer in (SUPPORTED, DOUBTFUL)),
                "; ".join(f"{model}: {models.count(model)}" for model in sorted(set(models))),
            )
        )
    return markdown(("E(80°), mm", SUPPORTED, DOUBTFUL, "chosen"), rows)


def additions(result: CalibrationResult) -> str:
    """What ``auto`` estimates beside focal length, centre, lens and pupil."""
    structure = result.fit.structure
    names = ["skew"] * structure.skew + list(structure.extras)
    if np.any(result.board_warp):
        names.append(f"board shape, its bow {1e3 * np.abs(result.board_warp).max():.2f} mm")
    return ", ".join(names) or "nothing"


def pupil_at_edge(result: CalibrationResult) -> str:
    """E(80°) and its standard deviation, mm."""
    theta = np.radians(80)
    sigma = pupil_sigma(result.camera, result.uncertainty.covariance, theta)
    return f"{1e3 * result.camera.entrance_pupil(theta):.2f} ± {1e3 * sigma:.2f}"


def real_table(results: dict[str, CalibrationResult]) -> str:
    rows: list[Sequence[str]] = []
    for name, result in results.items():
        cells = [
            f"{result.comparison[model].rms_px:.4f} / {result.comparison[model].cross_validated_rms_px:.4f}"
            for model in MODELS
        ]
        verdict = result.pupil_verdict.answer
        rows.append((name, *cells, additions(result), result.model, verdict))
    return markdown(("data", *MODELS, "added", "chosen", "pupil supported"), rows)


def train_test_table(observations: Observations) -> str:
    """RMS of all images, and of the test images for the camera of the training images, with the board's bow."""
    assert observations.split is not None
    trained, tested = (
        observations.select_images(np.flatnonzero(observations.split == part)) for part in ("train", "test")
    )
    rows = []
    for model in MODELS:
        flat = calibrate(observations, model)
        whole = calibrate(observations, model, board_warp=True)
        result = calibrate(trained, model, board_warp=True)
        measured = evaluate_camera(result.camera, tested, result.board_warp)
        rows.append(
            (
                model,
                f"{flat.rms_px:.4f}",
                f"{whole.rms_px:.4f}",
                f"{result.rms_px:.4f}",
                f"{measured.rms_px:.4f}",
                f"{1e3 * np.abs(whole.board_warp).max():.2f}",
                pupil_at_edge(whole),
                str(len(whole.rejected)),
            )
        )
    fitted = ("model", "flat board", "with its bow", "training images", "test images")
    return markdown((*fitted, "bow, mm", "E(80°), mm", "points cut"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    folder = Path(os.environ.get("FISHEYE_EP_CALIB_DATA", REPOSITORY.parent / "shared" / "data"))
    if folder.is_dir():
        data = {name: Observations.load(folder / name / "observations.npz") for name in DATA_SETS}
        results = {name: calibrate(observations) for name, observations in data.items()}
        print(f"## Real data: RMS / cross-validated RMS, px\n\n{real_table(results)}\n")
        for name, result in results.items():
            print(f"{name}: {len(result.rejected)} points cut")
            print("".join(f"- {reason}\n" for reason in result.reasons))
        print(f"## {TRAINED}: RMS, px\n\n{train_test_table(data[TRAINED])}\n")
    else:
        print(f"no real data at {folder}: set FISHEYE_EP_CALIB_DATA to the folder that has them\n")
    for title, sizes, bend in (("", SIZES, 0.0), (f", k6 = {BENT:g}", BENT_SIZES, BENT)):
        table = synthetic_table(sizes, bend, arguments.draws, arguments.workers)
        print(f"## Synthetic{title}, {NOISE} px\n\n{table}\n", flush=True)
    print(f"## Where something else moves the points, 25 and 8 views\n\n{disturbed_table(arguments.workers)}")


if __name__ == "__main__":
    main()
