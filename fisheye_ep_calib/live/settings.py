"""What a live calibrator is told at its start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.planning.view_selection import Novelty
from fisheye_ep_calib.rig import USUAL_TOLERANCE
from fisheye_ep_calib.target import Target

RELATIVE_GOAL = 1.3  # σ of E(60°) over what 40 guided views are predicted to give, at which it is enough


@dataclass(frozen=True)
class Limits:
    """When a view is kept. maximum_views: after so many, no more are."""

    novelty: Novelty = Novelty()
    maximum_views: int = 150


@dataclass(frozen=True)
class CameraSettings:
    """One camera.

    topic: of its images, without the transport's suffix; compressed ones come on topic/compressed.
    target: what it sees; None where the camera is only published. initial: a camera to publish from the start.
    camera_info_topic, set_camera_info_service: where a camera driver has them.
    options: of every calibration beside the model (calibration/options.py).
    """

    name: str
    topic: str
    compressed: bool
    target: Target | None
    model: str
    initial: Outcome | None
    camera_info_topic: str
    set_camera_info_service: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def image_topic(self) -> str:
        """The topic that carries the images."""
        return f"{self.topic}/compressed" if self.compressed else self.topic


@dataclass(frozen=True)
class RigSettings:
    """tolerance: seconds within which images are of the same time. views: common views wanted of two cameras."""

    tolerance: float = USUAL_TOLERANCE
    views: int = 40


@dataclass(frozen=True)
class Settings:
    """The whole calibrator. workers: processes that detect and calibrate. rig: None: cameras stay by themselves.

    keep_images: store the images of the views that are kept. check: hold cameras against the calibrations that they
    have, and keep and calibrate nothing.
    """

    cameras: tuple[CameraSettings, ...]
    output_directory: Path
    resume: bool
    workers: int
    rig: RigSettings | None = None
    keep_images: bool = False
    check: bool = False


@dataclass(frozen=True)
class Tuning:
    """What may change while the calibrator runs.

    auto_calibrate: calibrate without being asked, from minimum_views on. limits: which views are kept.
    goal_mm: standard deviation of E(60°) at which the user is told that it is enough; 0: RELATIVE_GOAL holds.
    show_refused: draw what looked like a feature and was none.
    """

    auto_calibrate: bool = True
    minimum_views: int = 10
    goal_mm: float = 0.0
    limits: Limits = Limits()
    show_refused: bool = False
