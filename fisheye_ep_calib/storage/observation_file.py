"""Observation files (.npz): detected points on disk, to calibrate again without the images."""

from __future__ import annotations

import io
from os import PathLike
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.storage.atomic import atomic_write


def load_observations(path: str | PathLike[str]) -> Observations:
    """Read an observation file; lengths become metres. Raises InputError with the path and what is wrong."""
    return Observations.load(path)


def save_observations(path: str | PathLike[str], observations: Observations) -> None:
    """Write an observation file in metres, whole or not at all."""
    atomic_write(path, observation_content(observations))


def observation_content(observations: Observations) -> bytes:
    """What an observation file holds; in metres."""
    arrays: dict[str, Any] = {
        "object_points": observations.object_points,
        "unit": np.array("m"),
        "image_index": observations.image_index,
        "point_index": observations.point_index,
        "pixels": observations.pixels,
        "image_size": np.array(observations.image_size, dtype=np.int64),
        "weights": observations.weights,
        "image_names": np.array(observations.image_names, dtype=np.str_),
    }
    if observations.split is not None:
        arrays["split"] = np.asarray(observations.split, dtype=np.str_)
    if observations.disc_radius is not None:
        arrays["disc_radius"] = np.array(observations.disc_radius)
    if observations.board is not None:
        arrays["board_deviation"] = observations.board.deviation
    if observations.mistakable:
        arrays["mistakable"] = np.array(True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()
