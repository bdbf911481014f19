"""This calibration beside others on the same observations: `make benchmark`, or

    python benchmarks/peers/accuracy.py [--sets NAME ...] [--peers NAME ...] [--data ../shared/data]

Synthetic sets have a known lens: the error is the RMS of the pixels by which the fitted camera misses it over the field
of the recording, at each distance after the best rigid motion of its frame, which no calibration can know. Real sets
are fitted to some of their views and measured on the others, camera and target frozen, poses refitted. Time is
processor time over that of cv2.fisheye with a good focal length, in one run, where that does not fail. What is not
installed, or fails, has a line that says so.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from fits import PEERS, Fitted, Project, views_of
from scipy.optimize import least_squares

from fisheye_ep_calib import Observations, calibrate
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.rotation import rotation_from_vector
from fisheye_ep_calib.simulation import observe, paper_camera, paper_poses
from fisheye_ep_calib.simulation.ray_traced_camera import laikin_camera
from fisheye_ep_calib.target.boards.chessboard import Chessboard

VOLUME = (0.10, 0.125, 0.15)  # metres
DISTANCES = {"volume": VOLUME, "1 m": (1.0,), "∞": (1e5,)}
FIELD = np.radians(np.arange(4, 81, 4))  # of all but the views at the rim
REFERENCE = "OpenCV fisheye"


@dataclass(frozen=True)
class Known:
    """A recording of a known lens. project: what the lens does."""

    observations: Observations
    focal: float
    project: Project


@dataclass(frozen=True)
class Split:
    """A real recording, views to fit and views to measure on."""

    fitted: Observations
    held_out: Observations
    focal: float


def synthetic_sets(views: int = 25) -> dict[str, Callable[[], Known]]:
    board = Chessboard.create("board", 11, 7, spacing=0.012)

    def of(camera, noise: float) -> Known:
        observations = observe(camera, board, paper_poses(board), noise=noise)

        def project(points: np.ndarray) -> np.ndarray:
            pixels, valid = camera.project(points)
            return np.where(valid[..., None], pixels, np.nan)

        return Known(observations, float(getattr(camera, "fx", 590.0)), project)

    return {
        "Table 1 of the paper": lambda: of(paper_camera(), 0.15),
        "ray-traced 170° lens": lambda: of(laikin_camera(), 0.05),
    }


def real_sets(data: Path) -> dict[str, Callable[[], Split]]:
    def marked() -> Split:
        all_views = Observations.load(data / "ov_plane" / "observations.npz")
        parts = [all_views.select_images(np.flatnonzero(all_views.split == name)) for name in ("train", "test")]
        return Split(parts[0], parts[1], 360.0)

    def alternating(name: str, focal: float) -> Split:
        all_views = Observations.load(data / name / "observations.npz")
        images = np.unique(all_views.image_index)
        return Split(all_views.select_images(images[::2]), all_views.select_images(images[1::2]), focal)

    return {
        "ov_plane": marked,
        "jy_left": lambda: alternating("jy_left", 560.0),
        "urban_fisheye2": lambda: alternating("urban_fisheye2", 240.0),
    }


def errors_by_distance(known: Known, fitted: Fitted) -> dict[str, float]:
    """Pixels, RMS over the field, at each distance after the best motion of the camera's frame."""
    theta, azimuth = np.meshgrid(FIELD, np.radians(np.arange(0, 360, 20)))
    rays = direction(theta, azimuth).reshape(-1, 3)
    errors = {}
    for name, distances in DISTANCES.items():
        points = np.concatenate([distance * rays for distance in distances])
        true = known.project(points)
        seen = np.isfinite(true[:, 0])
        scale = min(distances)

        def missed(motion, points=points[seen], true=true[seen], scale=scale) -> np.ndarray:
            moved = points @ rotation_from_vector(motion[:3]).T + scale * motion[3:]
            return finite(fitted.project(moved) - true)

        best = least_squares(missed, np.zeros(6), method="lm", x_scale=1e-3)
        errors[name] = rms(missed(best.x))
    return errors


def held_out_error(split: Split, fitted: Fitted) -> float:
    """Pixels, RMS over the views held out, poses refitted."""
    start = calibrate(split.held_out, "kannala")  # poses that do for a start, the same for all
    poses = dict(zip(start.view_images.tolist(), start.camera_from_target, strict=True))
    left = []
    images = np.unique(split.held_out.image_index).tolist()
    for image, (names, pixels) in zip(images, views_of(split.held_out), strict=True):
        if image not in poses:
            continue
        pose, points = poses[image], fitted.object_points[names]

        def missed(motion, pose=pose, points=points, pixels=pixels) -> np.ndarray:
            turned = points @ pose[:3, :3].T + pose[:3, 3]
            return finite(fitted.project(turned @ rotation_from_vector(motion[:3]).T + motion[3:]) - pixels)

        best = least_squares(missed, np.zeros(6), method="lm", x_scale=1e-3)
        left.append(missed(best.x).reshape(-1, 2))
    return rms(np.concatenate(left))


def finite(error: np.ndarray) -> np.ndarray:
    """Flat, a projection that is missing counting as 100 px."""
    return np.where(np.isfinite(error), error, 100.0).reshape(-1)


def rms(error: np.ndarray) -> float:
    """√ mean(dx² + dy²) of (n, 2), or of its flat form."""
    return float(np.sqrt(2 * np.mean(error**2)))


def rows(case: Known | Split, peers: list[str]) -> Iterator[dict[str, object]]:
    observations = case.observations if isinstance(case, Known) else case.fitted
    for name in peers:
        began = time.process_time()
        try:
            with quiet():
                fitted = PEERS[name](observations, case.focal)
        except ImportError as error:
            yield {"peer": name, "said": f"not installed: {error.name}"}
            continue
        except Exception as error:  # noqa: BLE001 - a peer may fail in any way, and that is a result
            yield {"peer": name, "said": f"fails: {str(error).strip().splitlines()[-1][:90]}"}
            continue
        seconds = time.process_time() - began
        with quiet():
            if isinstance(case, Known):
                judged = errors_by_distance(case, fitted)
            else:
                judged = {"held out": held_out_error(case, fitted)}
        yield {"peer": name, "RMS": fitted.rms_px, **judged, "seconds": seconds}


@contextmanager
def quiet() -> Iterator[None]:
    """Without what C libraries write on stderr, thousands of lines."""
    kept = os.dup(2)
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def table(title: str, found: list[dict[str, object]]) -> str:
    """A table in Markdown, times as ratios to the reference's where that ran."""
    columns = [key for key in max(found, key=len) if key not in ("peer", "seconds", "said")]
    reference = next((row["seconds"] for row in found if row["peer"] == REFERENCE and "seconds" in row), None)
    head = ["", *(f"{column} px" for column in columns), "time"]
    lines = [f"### {title}", "", f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for row in found:
        if "said" in row:
            cells = [str(row["said"]), *[""] * len(columns)]
        else:
            ratio = f"{row['seconds'] / reference:.2f}" if reference else f"{row['seconds']:.1f} s"
            cells = [*(f"{row[column]:.3g}" for column in columns), ratio]
        lines.append(f"| {row['peer']} | {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[3] / "shared" / "data")
    parser.add_argument("--sets", nargs="*", help="some of the sets alone")
    parser.add_argument("--peers", nargs="*", default=list(PEERS), help=", ".join(PEERS))
    parser.add_argument("--json", type=Path, help="write the figures here too")
    arguments = parser.parse_args()
    sets: dict[str, Callable[[], Known | Split]] = {**synthetic_sets()}
    if arguments.data.is_dir():
        sets |= real_sets(arguments.data)
    else:
        print(f"no real sets: {arguments.data} is not there", file=sys.stderr)
    figures = {}
    for name, make in sets.items():
        if arguments.sets and name not in arguments.sets:
            continue
        figures[name] = list(rows(make(), arguments.peers))
        print(table(name, figures[name]), flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1, ensure_ascii=False), encoding="utf-8")


if __name__ == "__main__":
    main()
