"""Whether an existing calibration still holds: its reprojection, measured again on what the camera sees now."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.coverage import azimuth_and_distance
from fisheye_ep_calib.calibration.assessing.evaluated_board import evaluated_board
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation, evaluate_camera
from fisheye_ep_calib.calibration.evaluation_words import (
    camera_variance,
    evaluation_findings,
    evaluation_verdict,
    expected_rms,
    used_sightings,
)
from fisheye_ep_calib.calibration.words import BAD
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.live.camera_views import Verdict
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.outcome import Outcome
from fisheye_ep_calib.live.view_store import View, observations_of, view_of
from fisheye_ep_calib.live.work_pool import Task, WorkPool
from fisheye_ep_calib.planning.view_selection import is_new
from fisheye_ep_calib.target import Target

WINDOW = 60.0  # seconds after which a view says nothing of the camera as it is now
MOST_VIEWS = 25
RING_DEGREES = 15
_LESS_WELL, _NO_LONGER = 1.25, 3.0  # RMS over what is expected; a target in motion alone may double it
_DISTANCES = 4  # parts of the points by distance


@dataclass(frozen=True)
class CheckResult:
    """level: GOOD, CAUTION or BAD (calibration.words). sentence: whether the camera holds. figures: JSON-ready."""

    level: str
    sentence: str
    figures: dict[str, Any]


def check_views(observations: Observations, known: Outcome) -> CheckResult:
    """What a worker process runs: poses refitted, the camera as it is, the board of the shape that explains most."""
    camera = known.camera
    try:
        chosen = evaluated_board(camera, observations, known.board)
        evaluation = evaluate_camera(camera, observations, board=chosen.board)
    except CalibrationError as error:
        return CheckResult(BAD, f"the calibration does not hold: {error}", {"rms_px": None, "expected_rms_px": None})
    covariance = known.covariance
    own = 0.0 if covariance is None else camera_variance(evaluation, observations, camera, covariance)
    expected = expected_rms(evaluation, known.figures.get("noise_px"), own)
    findings = evaluation_findings(evaluation, observations, camera.theta_max)
    findings = findings if chosen.finding is None else (*findings, chosen.finding)
    verdict = evaluation_verdict(evaluation, expected, findings, camera.image_size)
    figures = _figures(evaluation, observations, expected)
    figures |= {
        "board": chosen.sentence,
        "verdict": verdict.headline,
        "concerns": [finding.sentence for finding in findings if finding.concern],
    }
    level = BAD if expected is not None and evaluation.rms_px > _NO_LONGER * expected else verdict.level
    return CheckResult(level, _sentence(level, evaluation.rms_px, expected), figures)


def _sentence(level: str, rms: float, expected: float | None) -> str:
    than = "" if expected is None else f", {expected:.2f} px expected"
    if level == BAD:
        return f"the calibration no longer holds: {rms:.2f} px{than}"
    if expected is None:
        return f"the calibration leaves {rms:.2f} px; what is to be expected its file does not tell"
    if rms > _LESS_WELL * expected:
        return f"the calibration holds less well than it did: {rms:.2f} px{than}"
    return f"the calibration holds: {rms:.2f} px{than}"


def _figures(evaluation: Evaluation, observations: Observations, expected: float | None) -> dict[str, Any]:
    used = used_sightings(evaluation, observations)
    square = (evaluation.error[used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
    theta = np.degrees(evaluation.theta[used])
    _, distance = azimuth_and_distance(observations, evaluation.images, evaluation.camera_from_target, used)
    rings = np.arange(0, theta.max() + RING_DEGREES, RING_DEGREES)
    parts = np.unique(np.quantile(distance, np.linspace(0, 1, _DISTANCES + 1)))
    return {
        "rms_px": evaluation.rms_px,
        "expected_rms_px": expected,
        "views": len(evaluation.images),
        "points": evaluation.points,
        "by_angle": _by_part(theta, rings, square, "deg"),
        "by_distance": _by_part(distance, parts, square, "m"),
    }


def _by_part(of: np.ndarray, edges: np.ndarray, square: np.ndarray, unit: str) -> list[dict[str, float]]:
    """RMS of the sightings in each part between two edges, but for empty ones; square: px²."""
    told = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        inside = (of >= low) & ((of < high) | (high == edges[-1]))
        if inside.any():
            rms = float(np.sqrt(square[inside].mean()))
            part = {f"from_{unit}": round(float(low), 3), f"to_{unit}": round(float(high), 3)}
            told.append({**part, "rms_px": rms, "points": int(inside.sum())})
    return told


class Check:
    """One camera's; safe to use from several threads."""

    def __init__(
        self,
        name: str,
        target: Target,
        known: Outcome,
        pool: WorkPool,
        announcer: Announcer,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._name, self._target, self._known = name, target, known
        self._pool, self._announcer, self._clock = pool, announcer, clock
        self._views: list[tuple[float, View]] = []
        self._busy = False
        self._stale = False
        self._result: CheckResult | None = None
        self._lock = threading.Lock()

    @property
    def result(self) -> CheckResult | None:
        """Of what was seen lately; None while nothing was."""
        return self._result

    @property
    def views(self) -> tuple[View, ...]:
        """What was seen lately, each place once."""
        return tuple(view for _, view in self._views)

    def take(self, sighting: Sighting) -> Verdict:
        """Another look of the camera; what it shows takes the place of what showed the same before."""
        if len(sighting.detection) == 0:
            return Verdict.NOT_FOUND
        view = view_of(sighting, self._target)
        if view is None:
            return Verdict.TOO_FEW_POINTS
        if sighting.image_size != self._known.camera.image_size:
            return Verdict.OTHER_SIZE
        now = self._clock()
        with self._lock:
            lately = [(when, view_kept) for when, view_kept in self._views if now - when < WINDOW]
            others = [(when, view_kept) for when, view_kept in lately if is_new(view.signature, [view_kept.signature])]
            self._views = [*others, (now, view)][-MOST_VIEWS:]
            self._stale = True
        self._measure()
        return Verdict.CHECKED

    def _measure(self) -> None:
        with self._lock:
            if self._busy or not self._stale:
                return
            self._busy, self._stale = True, False
        self._pool.queue_job(Task(check_views, self._arguments, self._done))

    def _arguments(self) -> tuple[Any, ...]:
        return observations_of(self.views, self._target, self._known.camera.image_size), self._known

    def _done(self, result: CheckResult | None, error: CalibrationError | None) -> None:
        with self._lock:
            self._busy = False
            if result is not None:
                self._result = result
        key = f"{self._name} check"
        if result is not None and result.level == BAD:
            self._announcer.warn_once(key, f"{self._name}: {result.sentence}")
        elif result is not None:
            self._announcer.over(key, f"{self._name}: {result.sentence}")
        else:
            self._announcer.mention(key, f"{self._name}: not checked: {error}")
        self._measure()
