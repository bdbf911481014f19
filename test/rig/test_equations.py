"""A rig's equations kept by camera are those kept by moment, and take memory by the views."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from fisheye_ep_calib.rig import equations
from fisheye_ep_calib.rig.equations import EquationsByCamera, RigProducts, rig_information, solve_rig


def summed(cameras: int, moments: int, own: int = 6, held: bool = False):
    """Random equations of a chain of cameras, each moment seen by two of them; own columns a camera, and one of all.

    held: nothing is shared that the first camera's views depend on, as of the reference with known parameters.
    """
    rng = np.random.default_rng(0)
    size = 6 + own * cameras + 1 + 1
    first = np.arange(moments) % (cameras - 1)
    seen = [np.flatnonzero((first == camera) | (first == camera - 1)) for camera in range(cameras)]
    columns = [
        np.concatenate([np.arange(6), 6 + own * camera + np.arange(own), [size - 2, size - 1]])
        for camera in range(cameras)
    ]
    if held:
        columns[0], size = np.append(np.arange(6), size - 1 - own), size - own
        columns[1:] = [np.where(of_camera < 6, of_camera, of_camera - own) for of_camera in columns[1:]]
    sums = RigProducts(seen, columns, moments, size)
    for camera, of_camera in enumerate(seen):
        for part in np.array_split(rng.permutation(of_camera), 3):
            rows = rng.normal(size=(len(part), 20, len(columns[camera])))
            sums.add(camera, part, np.swapaxes(rows, 1, 2) @ rows)
    return sums.equations(1.0, True)


@pytest.mark.parametrize(("damping", "held"), [(0.0, False), (1e-3, False), (1e-3, True)])
def test_both_ways_to_keep_them_give_the_same_step_and_information(monkeypatch, damping, held) -> None:
    whole = summed(5, 40, held=held)
    monkeypatch.setattr(equations, "MOST_DENSE", 0)
    by_camera = summed(5, 40, held=held)
    assert isinstance(by_camera, EquationsByCamera) and not isinstance(whole, EquationsByCamera)
    np.testing.assert_allclose(rig_information(by_camera), rig_information(whole), rtol=1e-9, atol=1e-9)
    step, expected = solve_rig(by_camera, damping), solve_rig(whole, damping)
    np.testing.assert_allclose(step.shared, expected.shared, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(step.pose, expected.pose, rtol=1e-7, atol=1e-9)
    assert step.predicted_decrease == pytest.approx(expected.predicted_decrease, rel=1e-8)


def test_a_rig_of_many_cameras_takes_memory_by_its_views() -> None:
    tracemalloc.start()
    found = summed(32, 3000, own=16)
    solve_rig(found, 1e-4)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1e8  # bytes; an array of all columns a moment takes 6 GB
