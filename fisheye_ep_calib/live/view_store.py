"""The accepted views of one camera, in memory and on disk: what was accepted survives the node's death."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.planning.view_selection import ViewSignature, view_signature
from fisheye_ep_calib.storage.kept_file import KeptFile
from fisheye_ep_calib.storage.observation_file import load_observations, observation_content
from fisheye_ep_calib.target import Target


@dataclass(frozen=True)
class View:
    """One accepted view: which points (k,) of the target were seen at which pixels (k, 2)."""

    name: str
    point_index: np.ndarray
    pixels: np.ndarray
    signature: ViewSignature


def view_of(sighting: Sighting, target: Target) -> View | None:
    """A view from what was found in a frame; None where that is too little."""
    detection = sighting.detection
    signature = view_signature(target.object_points[detection.point_index], detection.pixels, sighting.image_size)
    return None if signature is None else View(sighting.name, detection.point_index, detection.pixels, signature)


def observations_of(views: Sequence[View], target: Target, image_size: tuple[int, int]) -> Observations:
    """Views, one at least, as observations."""
    counts = [len(view.point_index) for view in views]
    return Observations.create(
        target.object_points,
        np.repeat(np.arange(len(views)), counts),
        np.concatenate([view.point_index for view in views]),
        np.concatenate([view.pixels for view in views]),
        image_size,
        image_names=[view.name for view in views],
        disc_radius=target.disc_radius,
        board=target.shape,
        mistakable=not target.unmistakable,
    )


class ViewStore:
    """Views of one target by one camera; every change is written to an observation file at once.

    Not safe for several threads at a time; its owner locks.
    """

    def __init__(self, path: Path, target: Target) -> None:
        self.path = path
        self.target = target
        self.views: tuple[View, ...] = ()
        self.image_size: tuple[int, int] | None = None
        self._file = KeptFile(path)

    @property
    def unwritten(self) -> bool:
        """Whether the disk does not hold the views; looks at the disk."""
        return bool(self.views) and not self._file.held

    @property
    def gone(self) -> bool:
        """Whether the views were on the disk and are there no longer; looks at the disk."""
        return bool(self.views) and self._file.gone

    def resume(self) -> int:
        """Take up the views of an earlier run, if there is one; their number. Raises InputError."""
        if not self.path.exists():
            return 0
        observations = load_observations(self.path)
        target_points = self.target.object_points
        if observations.object_points.shape != target_points.shape or not np.allclose(
            observations.object_points, target_points, atol=1e-9
        ):
            raise InputError(
                f"{self.path} holds views of another target than {self.target.name}: "
                "give another output directory, or set resume to false"
            )
        self.image_size = observations.image_size
        self.views = tuple(self._views(observations))
        self._file.adopt()
        return len(self.views)

    def set_aside(self) -> None:
        """Start empty; an earlier run's file is renamed, not lost. Raises CalibrationError, and keeps all then."""
        if self.path.exists():
            self._rename()
        self.views, self.image_size = (), None
        self._file.changed()

    def _rename(self) -> None:
        stamp = time.strftime("%Y%m%d-%H%M%S")
        aside = self.path.with_name(f"{self.path.stem}.{stamp}{self.path.suffix}")
        count = 1
        while aside.exists():
            count += 1
            aside = self.path.with_name(f"{self.path.stem}.{stamp}-{count}{self.path.suffix}")
        try:
            self.path.rename(aside)
        except OSError as error:
            raise CalibrationError(f"cannot rename {self.path}: {error.strerror}") from None

    def add(self, view: View, image_size: tuple[int, int]) -> None:
        """Keep a view and write the file. Raises CalibrationError where that fails; the view is kept anyway."""
        self.views += (view,)
        self.image_size = image_size
        self._file.changed()
        self.write()

    def write(self, again: bool = False) -> None:
        """Write the views if the disk does not hold them, or ``again``. Raises CalibrationError."""
        observations = self.observations()
        if observations is not None and (again or not self._file.held):
            self._file.write(observation_content(observations))

    def observations(self) -> Observations | None:
        """All views as observations; None while there are none."""
        if not self.views or self.image_size is None:
            return None
        return observations_of(self.views, self.target, self.image_size)

    def _views(self, observations: Observations) -> Iterator[View]:
        rows_of = observations.rows_of(np.arange(len(observations.image_names)))
        for name, rows in zip(observations.image_names, rows_of, strict=True):
            points, pixels = observations.point_index[rows], observations.pixels[rows]
            signature = view_signature(self.target.object_points[points], pixels, observations.image_size)
            if signature is not None:
                yield View(name, points, pixels, signature)
