"""Scenes with known truth, noise draws fitted from nothing, and the Cramér–Rao bound they are held against."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fisheye_ep_calib import FisheyeCamera, Observations
from fisheye_ep_calib.calibration.estimating.adjustment import AdjustmentProblem, AdjustmentState, evaluate
from fisheye_ep_calib.calibration.estimating.fit import Fit, first_fit, refine
from fisheye_ep_calib.calibration.estimating.normal_equations import reduced_information
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.simulation import observe
from fisheye_ep_calib.target import Target


@dataclass(frozen=True)
class Scene:
    """A camera, the poses (V, 4, 4) of a target and what is seen of it without noise."""

    camera: FisheyeCamera
    poses: np.ndarray
    clean: Observations

    @staticmethod
    def create(camera: FisheyeCamera, target: Target, poses: np.ndarray) -> Scene:
        return Scene(camera, poses, observe(camera, target, poses))

    def draw(self, noise: float, seed: int) -> Observations:
        """The observations under Gaussian noise, σ in px of each coordinate."""
        error = np.random.default_rng([seed, 11]).normal(0, noise, self.clean.pixels.shape)
        return replace(self.clean, pixels=self.clean.pixels + error)

    @cached_property
    def bound(self) -> np.ndarray:
        """Covariance (P, P) of the camera's parameters at the Cramér–Rao bound, for noise of 1 px; zero where fixed.

        The inverse of the Fisher information at the truth, JᵀJ with every pose free and eliminated.
        """
        sightings = prepare(self.clean)
        structure = Structure(self.camera.model, terms=len(self.camera.coefficients) or None)
        free = structure.free(self.camera)
        # The edge of a disc may lie a little beyond theta_max.
        limit = min(self.camera.theta_max + 0.1, np.pi)
        problem = AdjustmentProblem(sightings.blocks, sightings.features, free, sightings.target, theta_limit=limit)
        equations = evaluate(
            problem, AdjustmentState(self.camera, self.poses[sightings.images], sightings.target.start())
        )
        assert equations.valid
        information = reduced_information(equations)
        scale = 1 / np.sqrt(np.diag(information))
        covariance = np.zeros((len(free),) * 2)
        inverse = np.linalg.inv(information * scale[:, None] * scale)
        covariance[np.ix_(free, free)] = inverse * scale[:, None] * scale
        return covariance


def fit_from_nothing(observations: Observations, structure: Structure) -> Fit:
    """The paper's three steps, with nothing known beforehand."""
    return refine(first_fit(prepare(observations)), structure)


def spread_over(function: Callable, items: Iterable, workers: int) -> list:
    """function of every item, in order, over processes of one thread each."""
    if workers <= 1:
        return [function(item) for item in items]
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    with ProcessPoolExecutor(workers) as pool:
        return list(pool.map(function, items, chunksize=4))


def markdown(header: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    titles = list(header)
    lines: list[Sequence[str]] = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
