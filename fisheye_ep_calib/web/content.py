"""What the page shows of a live calibrator, and what its buttons do."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.camera.bands import entrance_pupil_band
from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.live.calibrator import LiveCalibrator
from fisheye_ep_calib.live.camera import LiveCamera
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.status import Status

CELLS = 28  # of the map of what is covered, along the image's longer side
_CURVE_SAMPLES = 46
_OFFERED = (".yaml", ".npz", ".html", ".png")  # endings of results


class PageContent:
    """Safe to use from several threads. Methods that act wait for what they do."""

    def __init__(self, live: LiveCalibrator, commit: Callable[[str | None], Answer], node: str) -> None:
        """commit: hands a camera's calibration, or all, to the drivers. node: its name."""
        self.node = node
        self._live = live
        self._commit = commit
        self._cameras: dict[str, dict[str, Any]] = {}
        self._rig: dict[str, Any] | None = None
        self._lock = threading.Lock()

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras that are calibrated."""
        return tuple(self._live.cameras)

    def update(self, cameras: Sequence[Status], rig: Status | None) -> None:
        """What was last told of all."""
        with self._lock:
            self._cameras = {status.name: status.as_dict() for status in cameras}
            self._rig = None if rig is None else rig.as_dict()

    def snapshot(self) -> dict[str, Any]:
        """The status of all, with what became of the last frame of each camera."""
        with self._lock:
            cameras, rig = dict(self._cameras), self._rig
        return {
            "node": self.node,
            "cameras": {name: {**cameras.get(name, {}), **_now(camera)} for name, camera in self._live.cameras.items()},
            "rig": rig,
        }

    def progress(self, name: str) -> dict[str, Any]:
        """What a camera's views cover: the image in cells, the apparent sizes, and E(θ) where it is calibrated."""
        camera = self._live.cameras[name]
        outcome = camera.outcome
        return {
            **_covered(camera),
            "pupil": None if outcome is None else _pupil(outcome),
        }

    def act(self, action: str, name: str | None) -> Answer:
        """calibrate, save, reset, commit or report; of one camera where the action knows one."""
        actions: dict[str, Callable[[], Answer]] = {
            "calibrate": self._live.calibrate,
            "save": self._live.save,
            "reset": lambda: self._live.reset(name),
            "commit": lambda: self._commit(name),
            "report": lambda: self._live.report(name),
        }
        return actions[action]()

    def files(self) -> list[dict[str, Any]]:
        """Results in the output folder itself that can be had, the newest first."""
        found = []
        for path in self._offered().values():
            with contextlib.suppress(OSError):  # renamed meanwhile
                found.append((path, path.stat()))
        return [
            {"name": path.name, "bytes": about.st_size, "report": path.suffix == ".html"}
            for path, about in sorted(found, key=lambda one: -one[1].st_mtime_ns)
        ]

    def file(self, name: str) -> Path | None:
        """The file of that name, if it is one of those; no name leads anywhere else."""
        return self._offered().get(name)

    def _offered(self) -> dict[str, Path]:
        try:
            paths = list(self._live.folder.iterdir())
        except OSError:
            return {}
        return {
            path.name: path
            for path in paths
            if path.suffix in _OFFERED and not path.name.startswith(".") and path.is_file() and not path.is_symlink()
        }


def _now(camera: LiveCamera) -> dict[str, Any]:
    look, steering, views = camera.looks.last, camera.guide.steering, camera.views
    shown = views.kept if camera.check is None else camera.check.views
    return {
        "look": {
            "number": look.number,
            "event": look.event.value,
            "points": look.points,
            "of": len(views.target.object_points),
            "view": len(shown),
        },
        "move": None if steering is None or views.full else steering.sentence,
        "calibrations": camera.standing.number,
        "views": len(shown),
        "version": f"{views.generation}.{shown[-1].name if shown else 0}.{camera.standing.number}",
        "checking": camera.check is not None,
    }


def _pupil(outcome: Outcome) -> dict[str, Any] | None:
    """E(θ) and its σ in millimetres, over the field that was seen; None where nothing is known about it."""
    if outcome.covariance is None:
        return None
    theta = np.linspace(0, outcome.camera.theta_max, _CURVE_SAMPLES)
    shift, sigma, _ = entrance_pupil_band(outcome.camera, outcome.covariance, theta)
    return {
        "theta_deg": np.degrees(theta).round(2).tolist(),
        "E_mm": (1e3 * shift).round(5).tolist(),
        "sigma_mm": (1e3 * np.nan_to_num(sigma)).round(5).tolist(),
    }


def _covered(camera: LiveCamera) -> dict[str, Any]:
    """cells (rows, columns): 0 dark, 1 lit, 2 covered. sizes: of the views, powers of two of image heights a metre."""
    size = camera.seeing.image_size or camera.views.image_size or (1, 1)
    scale = CELLS / max(size)
    columns, rows = (max(1, round(scale * length)) for length in size)
    y, x = np.mgrid[0:rows, 0:columns]
    middles = np.stack([(x + 0.5) / columns * size[0], (y + 0.5) / rows * size[1]], axis=-1) - 0.5
    cells = camera.seeing.sight().shows(middles, size).astype(int)
    kept = camera.views.kept if camera.check is None else camera.check.views
    for view in kept:
        place = np.clip(
            ((view.pixels + 0.5) * [columns, rows] / np.array(size)).astype(int), 0, [columns - 1, rows - 1]
        )
        cells[place[:, 1], place[:, 0]] = 2
    wanted = camera.guide.wanted
    signature = None if wanted is None else wanted.signature
    return {
        "cells": cells.tolist(),
        "image_size": list(size),
        "sizes": [round(view.signature.size, 3) for view in kept],
        "wanted_size": None if signature is None else round(signature.size, 3),
    }
