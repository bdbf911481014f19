"""Where images are looked at: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from fisheye_ep_calib.collection.look import Job
from fisheye_ep_calib.collection.results import FrameResult
from fisheye_ep_calib.collection.workers import FrameWorkers
from fisheye_ep_calib.storage.recording import Recording
from fisheye_ep_calib.target.base import Target


class FramePool(Protocol):
    """Looks at images of one recording; what comes out does not depend on where, or on how many look."""

    def add(self, jobs: Iterable[Job]) -> None:
        """Have these images looked at; more may be added while others are waited for."""

    def next_result(self) -> FrameResult | None:
        """What one of the images shows, in no particular order; None once all have been looked at."""

    def close(self) -> None:
        """Forget what waits, and let the workers go."""


def frame_pool(recording: Recording, target: Target, workers: int, scheduler: str | None = None) -> FramePool:
    """``workers`` processes here (0: the calling process), or the workers of the Dask ``scheduler`` at an address."""
    if scheduler is None:
        return FrameWorkers(recording, target, workers)
    from fisheye_ep_calib.collection.cluster import ClusterWorkers

    return ClusterWorkers(recording, target, scheduler)
