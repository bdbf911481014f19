"""What a calibration still lacks, for the person who holds the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board, Sight, light_ends
from fisheye_ep_calib.planning.field import RING_DEGREES, SECTORS, Field
from fisheye_ep_calib.planning.first_views import assumed_camera, first_views
from fisheye_ep_calib.planning.guidance import (
    Suggestion,
    candidates,
    faces_away,
    few_points,
    next_views,
    sigma_against_guided,
)
from fisheye_ep_calib.planning.steering import steer
from fisheye_ep_calib.planning.view_selection import ViewSignature, view_signature
from fisheye_ep_calib.target import Target

GOAL_ANGLE = 60  # degrees at which the band is held against the goal
AHEAD = 6  # poses planned: a calibration takes as long as a few views
# What the person who holds the target can do something about, the most urgent first; other findings come after these.
_BY_SHOWING = ("few_views", "coverage", "depth", "pupil_against_depth", "near_far")


@dataclass(frozen=True)
class Wanted:
    """A pose to be shown. sentence: in words. outline (k, 2): the board's edge there, pixels, in order.

    signature: of the view as it would be; None where too little of the board would be seen to tell.
    """

    sentence: str
    outline: np.ndarray
    signature: ViewSignature | None
    suggestion: Suggestion

    def shown_by(self, view: ViewSignature) -> bool:
        """Whether a view shows it; one that nobody can tell counts as shown."""
        return self.signature is None or steer(view, self.signature).reached


@dataclass(frozen=True)
class Advice:
    """plan: poses to show in turn. findings: those open, the most urgent first, in words; lacking: of these,
    what showing the target more can end. figures: coverage and concerns, JSON-ready.

    against_guided: σ of E at GOAL_ANGLE over what 40 guided views are predicted to give; NaN where that cannot be told.
    """

    plan: tuple[Wanted, ...]
    findings: tuple[str, ...]
    lacking: tuple[str, ...]
    figures: dict[str, Any]
    against_guided: float = float("nan")


def advise(
    result: CalibrationResult,
    observations: Observations,
    board: Board,
    sight: Sight = EVERYWHERE,
    tried: Sequence[Suggestion] = (),
) -> Advice:
    """From a calibration and what it was made from. tried: poses that could not be reached."""
    camera = _with_pupil(result.camera)
    poses = result.camera_from_target
    offered = candidates(camera, board, faces_away(board, poses), sight)
    ends = light_ends(camera, 2 * np.pi * np.arange(SECTORS) / SECTORS, sight)
    field = Field.of(few_points(board.points), poses, offered.poses, ends)
    findings = _open([field.finding, *(other for other in result.diagnosis.findings if other.name != "coverage")])
    known = _known_beforehand(result, board)
    views = _signatures(observations)

    def shown(suggestion: Suggestion) -> bool:
        wanted = _wanted(suggestion, result.camera, board)
        return any(wanted.shown_by(view) for view in views)

    suggestions = next_views(camera, board, poses, offered, AHEAD, field, tried, known, shown)
    against = sigma_against_guided(camera, board, poses, offered, _goal_angle(camera), beforehand=known)
    rings = int(np.flatnonzero(field.reachable.any(axis=1)).max(initial=0)) + 1
    figures = {
        "coverage": round(field.share, 3),
        "coverage_ring_deg": RING_DEGREES,
        "coverage_counts": field.counts[:rings].tolist(),
        "coverage_reachable": field.reachable[:rings].tolist(),
        "concerns": [finding.sentence for finding in findings],
        "gain": round(suggestions[0].gain, 3) if suggestions else 0.0,
        "sigma_against_40_guided": round(against, 3) if np.isfinite(against) else None,
    }
    plan = tuple(_wanted(suggestion, result.camera, board) for suggestion in suggestions)
    told = tuple(finding.sentence for finding in findings)
    lacking = tuple(finding.sentence for finding in findings if finding.name in _BY_SHOWING)
    return Advice(plan, told, lacking, figures, against)


def _signatures(observations: Observations) -> list[ViewSignature]:
    """Of the views, but for those that nobody can tell."""
    views = []
    for seen in observations.rows_of(np.unique(observations.image_index)):
        points = observations.object_points[observations.point_index[seen]]
        views.append(view_signature(points, observations.pixels[seen], observations.image_size))
    return [view for view in views if view is not None]


def first_plan(
    target: Target, image_size: tuple[int, int], sight: Sight, known: FisheyeCamera | None = None
) -> tuple[Wanted, ...]:
    """What to show before the first calibration. known: the camera, where a file has it."""
    board = Board.of(target)
    views = first_views(board, image_size, sight, not target.y_up, known)
    return tuple(_wanted(suggestion, known or assumed_camera(image_size, sight), board) for suggestion in views)


def _open(findings: Sequence[Finding]) -> list[Finding]:
    rank = {name: number for number, name in enumerate(_BY_SHOWING)}
    return sorted(
        (finding for finding in findings if finding.concern), key=lambda finding: rank.get(finding.name, len(rank))
    )


def _goal_angle(camera: FisheyeCamera) -> float:
    return min(float(np.radians(GOAL_ANGLE)), camera.theta_max)


def _known_beforehand(result: CalibrationResult, board: Board) -> np.ndarray | float:
    """What the calibration knew of its pupil without any view, in the scale of the few points that guidance weighs."""
    prior = result.fit.problem.prior
    return 0.0 if prior is None else prior * len(few_points(board.points)) / len(board.points)


def _with_pupil(camera: FisheyeCamera) -> FisheyeCamera:
    """A camera whose pupil is not supported yet still wants views that would tell."""
    if camera.coefficients:
        return camera
    return replace(camera, model="ep_even", coefficients=(0.0, 0.0))


def _wanted(suggestion: Suggestion, camera: FisheyeCamera, board: Board) -> Wanted:
    camera = replace(camera, theta_max=np.pi)
    pose = suggestion.camera_from_target
    outline, outline_valid = camera.project(board.outline @ pose[:3, :3].T + pose[:3, 3])
    pixels, valid = camera.project(board.points @ pose[:3, :3].T + pose[:3, 3])
    signature = view_signature(board.points[valid], pixels[valid], camera.image_size)
    return Wanted(suggestion.sentence, outline[outline_valid], signature, suggestion)
