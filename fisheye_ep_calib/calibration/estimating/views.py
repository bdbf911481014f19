"""Observations as padded arrays, one row a view, in blocks small enough to stay in the processor's cache."""

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations

_SLOTS_PER_BLOCK = 2560  # sightings; larger blocks spill the Jacobian out of the cache, smaller ones cost calls


@dataclass(frozen=True)
class ViewBlock:
    """B views padded to N sightings each; padding has weight 0 and repeats the view's first sighting.

    views (B,): positions in the pose array. rows (B, N): rows of the observations. real (B, N): not padding.
    points (B, N): rows of object_points. object_points (3, B, N): metres, target frame, as the file has them.
    pixels (2, B, N). weights (B, N).
    """

    views: np.ndarray
    rows: np.ndarray
    real: np.ndarray
    points: np.ndarray
    object_points: np.ndarray
    pixels: np.ndarray
    weights: np.ndarray


def view_blocks(observations: Observations, images: np.ndarray) -> tuple[ViewBlock, ...]:
    """Blocks over the given image numbers (V,), sorted; ``views`` counts positions in that array.

    Views of similar size share a block, so that unequal numbers of points cost little padding.
    """
    starts = np.searchsorted(observations.image_index, images, side="left")
    counts = np.searchsorted(observations.image_index, images, side="right") - starts
    order = np.argsort(counts, kind="stable")
    blocks, first = [], 0
    while first < len(order):
        last = first + 1
        while last < len(order) and counts[order[last]] * (last + 1 - first) <= _SLOTS_PER_BLOCK:
            last += 1
        blocks.append(_block(observations, order[first:last], starts, counts))
        first = last
    return tuple(blocks)


def _block(observations: Observations, views: np.ndarray, starts: np.ndarray, counts: np.ndarray) -> ViewBlock:
    slots = np.arange(counts[views].max(initial=0))
    real = slots < counts[views][:, None]
    rows = starts[views][:, None] + np.where(real, slots, 0)
    points = observations.point_index[rows]
    return ViewBlock(
        views,
        rows,
        real,
        points,
        np.ascontiguousarray(np.moveaxis(observations.object_points[points], -1, 0)),
        np.ascontiguousarray(np.moveaxis(observations.pixels[rows], -1, 0)),
        np.where(real, observations.weights[rows], 0.0),
    )
