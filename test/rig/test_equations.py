"""A rig's equations kept by camera are those kept by moment, and take memory by the views."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from fisheye_ep_calib.calibration.estimating.normal_equations import NormalEquations, reduced_information, solve_damped
from fisheye_ep_calib.rig.equations import RigProducts, rig_information, solve_rig

POSE = np.arange(6)


class Chain:
    """Random products of a chain of cameras, each moment seen by two; ``own`` columns a camera, and one of all.

    held: nothing that is a camera's own is free of the first one, as of a reference with known parameters.
    """

    def __init__(self, cameras: int, moments: int, own: int, held: bool = False) -> None:
        first = np.arange(moments) % (cameras - 1)
        self.count = moments
        self.moments = [np.flatnonzero((first == camera) | (first == camera - 1)) for camera in range(cameras)]
        starts = [own * (camera - held) for camera in range(cameras)]
        self.shared = own * (cameras - held) + 1
        self.columns = [np.append(np.arange(max(start, 0), start + own), self.shared - 1) for start in starts]

    def products(self) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Camera, moments (B,) and JᵀJ of each of them, some at a time."""
        rng = np.random.default_rng(0)
        for camera, seen in enumerate(self.moments):
            for part in np.array_split(rng.permutation(seen), 3):
                rows = rng.normal(size=(len(part), 20, 6 + len(self.columns[camera]) + 1))
                yield camera, part, np.swapaxes(rows, 1, 2) @ rows

    def by_camera(self):
        sums = RigProducts(self.moments, self.columns, self.count, self.shared)
        for camera, moments, products in self.products():
            sums.add(camera, moments, products)
        return sums.equations(1.0, True)

    def by_moment(self) -> NormalEquations:
        size = 6 + self.shared + 1
        whole = np.zeros((self.count, size, size))
        for camera, moments, products in self.products():
            columns = np.concatenate([POSE, 6 + self.columns[camera], [size - 1]])
            whole[moments[:, None, None], columns[:, None], columns] += products
        return NormalEquations(whole, 1.0, True)


@pytest.mark.parametrize(("damping", "held"), [(0.0, False), (1e-3, False), (1e-3, True)])
def test_step_and_information_are_those_of_whole_moments(damping, held) -> None:
    chain = Chain(5, 40, own=6, held=held)
    ours, whole = chain.by_camera(), chain.by_moment()
    np.testing.assert_allclose(rig_information(ours), reduced_information(whole), rtol=1e-9, atol=1e-9)
    step, expected = solve_rig(ours, damping), solve_damped(whole, damping)
    np.testing.assert_allclose(step.shared, expected.shared, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(step.pose, expected.pose, rtol=1e-7, atol=1e-9)
    assert step.predicted_decrease == pytest.approx(expected.predicted_decrease, rel=1e-8)


def test_a_rig_of_many_cameras_takes_memory_by_its_views() -> None:
    tracemalloc.start()
    solve_rig(Chain(32, 3000, own=16).by_camera(), 1e-4)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1e8  # bytes; an array of all columns a moment takes 6 GB
