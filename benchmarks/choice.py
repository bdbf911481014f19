"""What the choice of images loses, against all of them and against the best choice there is.

    python benchmarks/choice.py [--recordings 12]

Recordings of 2,000 images of a board moved by hand, as in reading.py, with ideal detections, so that nothing is
rendered. For 150 images chosen from what the images before them showed, and for 150 chosen with the true camera and
every true pose known: σ of E(θ) over that of all images, and how often E(θ) at 10°, 20°, … 90° would be within 1.2 ×
and 2 × the band (2 σ) that all images give, were all noise independent.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from reading import CAMERAS, TARGET, handheld_poses

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.image_choice import FrameChoice, first_look, next_look
from fisheye_ep_calib.planning.view_information import view_information
from fisheye_ep_calib.simulation.truth import observe
from fisheye_ep_calib.target.detection import Detection

FRAMES = 2000
NOISE = 0.005
DRAWS = 2000
THETA = np.radians(np.arange(10, 91, 10))
SHOWN = [2, 5, 7, 8]  # of THETA


@dataclass(frozen=True)
class Film:
    """A recording: what is found in each image, and how much each tells of the camera (F, P, P)."""

    camera: FisheyeCamera
    detections: dict[int, Detection]
    information: np.ndarray

    @property
    def pupil_rows(self) -> np.ndarray:
        """∂E(θ)/∂parameters (T, P)."""
        rows = np.zeros((len(THETA), self.information.shape[-1]))
        columns = self.camera.parameter_slice("coefficients")
        rows[:, columns] = self.camera.pupil_family.basis(THETA, len(self.camera.coefficients)).T
        return rows


def film(seed: int) -> Film:
    camera, poses = tuple(CAMERAS.values())[seed % 2], handheld_poses(FRAMES, seed)
    seen = observe(camera, TARGET, poses, noise=NOISE, seed=seed)
    start = np.searchsorted(seen.image_index, np.arange(FRAMES + 1))
    parts = [slice(*pair) for pair in zip(start, start[1:], strict=False)]
    detections = {i: Detection(seen.point_index[part], seen.pixels[part]) for i, part in enumerate(parts)}
    told = [view_information(camera, TARGET.object_points, poses[i : i + 100]) for i in range(0, FRAMES, 100)]
    return Film(camera, detections, np.concatenate([one.information for one in told]))


def chosen(one: Film) -> list[int]:
    """The images that a collection would look at."""
    choice = FrameChoice()
    found = {i: detection if len(detection) >= 4 else None for i, detection in one.detections.items()}
    seen = set(first_look(FRAMES, choice))
    while fresh := next_look({i: found[i] for i in seen}, TARGET, one.camera.image_size, FRAMES, choice):
        seen.update(fresh)
    return sorted(seen)


def best(one: Film, count: int) -> list[int]:
    """Greedily the images that most lower the variances of E(θ) and of every parameter, all being known."""
    scale = np.sqrt(np.diag(one.information.sum(axis=0)))
    information = one.information / (scale * scale[:, None])
    sought = np.concatenate([one.pupil_rows / scale, np.diag(1 / scale)])
    total = 1e-6 * np.eye(len(scale))
    taken: list[int] = []
    for _ in range(count):
        covariance = np.linalg.inv(total)
        variance = np.einsum("qi,ij,qj->q", sought, covariance, sought)
        spread = (sought @ covariance) / np.sqrt(variance)[:, None]
        gain = np.einsum("nij,ij->n", information, spread.T @ spread)
        gain[taken] = -1
        taken.append(int(np.argmax(gain)))
        total = total + information[taken[-1]]
    return taken


def judge(one: Film, images: list[int], seed: int) -> tuple[np.ndarray, list[float]]:
    """σ of E(θ) (T,) over that of all images, and the shares of draws within 1.2 × and 2 × the band of all.

    The images are part of all of them, so their estimate differs from all images' by the difference of covariances.
    """
    few, every = (np.linalg.inv(information.sum(axis=0)) for information in (one.information[images], one.information))
    rows = one.pupil_rows
    sigma, sigma_all = (np.sqrt(np.einsum("ti,ij,tj->t", rows, each, rows)) for each in (few, every))
    columns = one.camera.parameter_slice("coefficients")
    difference = (few - every)[columns, columns]
    draws = np.random.default_rng(seed).multivariate_normal(np.zeros(len(difference)), difference, DRAWS)
    worst = np.abs(draws @ rows[:, columns].T / (2 * sigma_all)).max(axis=1)
    return sigma / sigma_all, [float((worst <= limit).mean()) for limit in (1.2, 2.0)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=12)
    films = [film(seed) for seed in range(parser.parse_args().recordings)]
    for name, choose in (("chosen", chosen), ("best", lambda one: best(one, FrameChoice().most))):
        judged = [judge(one, choose(one), seed) for seed, one in enumerate(films)]
        ratio = np.mean([ratios for ratios, _ in judged], axis=0)[SHOWN]
        within = np.mean([shares for _, shares in judged], axis=0)
        print(
            f"{name}: σ of E over that of all at {np.degrees(THETA[SHOWN]).round()}°: {ratio.round(2)}; "
            f"within 1.2 × the band {within[0]:.2f}, 2 × {within[1]:.2f}"
        )


if __name__ == "__main__":
    main()
