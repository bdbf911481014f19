"""What a rig still lacks, for the person who holds the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fisheye_ep_calib.rig.assembly import MIN_COMMON_VIEWS

ENOUGH = 10  # common views of two cameras from which on more add little


def next_step(names: Sequence[str], counts: np.ndarray, joined: Sequence[str], uncalibrated: Sequence[str]) -> str:
    """What would help most, in one sentence.

    counts (cameras, cameras): common views of each two. joined: cameras that they join to the first, itself included.
    uncalibrated: those without a calibration of their own.
    """
    inside = [number for number, name in enumerate(names) if name in joined]
    outside = [number for number, name in enumerate(names) if name not in joined]
    if outside:
        a, b = max(((a, b) for a in inside for b in outside), key=lambda pair: counts[pair])
        missing = MIN_COMMON_VIEWS - int(counts[a, b])
        return (
            f"hold the target where {names[a]} and {names[b]} both see it: "
            f"{missing} more common view{'s' if missing > 1 else ''} at least"
        )
    if uncalibrated:
        return f"calibrate {', '.join(uncalibrated)} first: show the target there"
    weak = [number for number in range(len(names)) if np.delete(counts[number], number).max() < ENOUGH]
    if weak:
        a = weak[-1]
        b = int(np.argmax(np.where(np.arange(len(names)) == a, -1, counts[a])))
        return (
            f"move and tilt the target where {names[min(a, b)]} and {names[max(a, b)]} both see it: "
            f"{counts[a, b]} common views so far"
        )
    return "save, or go on moving the target where two cameras see it"
