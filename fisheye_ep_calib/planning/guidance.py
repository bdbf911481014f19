"""Where to hold the target next: poses that narrow most what is known least about E(θ) and r(θ), and can be seen.

A greedy design (view_information.variance_reduction): the variances, each relative to its present value, are those
of E(θ) and of r(θ) over the field. Where parts of the field are not covered yet, a pose that covers some is worth more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fisheye_ep_calib.calibration.assessing.coverage import SECTOR_NAMES, sector_of
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board, Sight, detectable, light_ends
from fisheye_ep_calib.planning.field import Field
from fisheye_ep_calib.planning.view_information import variance_reduction, view_information
from fisheye_ep_calib.rotation import placed, rotation_from_vector
from fisheye_ep_calib.target.shape.frame import board_middle

_DIRECTIONS = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.72, 0.84, 0.95])  # of the angle at which the image ends
_AZIMUTHS = 8
_TILTS = np.radians([0.0, 25.0, 45.0])
_TILT_AZIMUTHS = 4
_MOST_POINTS = 40  # of the target: enough to tell poses apart
_DISTANCES = 7  # from the nearest at which the board may be held to the farthest at which its features are seen
_NEAREST, _FARTHEST = 0.9, 10.0  # in half diagonals of the board
_TURNS = 3  # of so many views one is chosen for what it covers alone, while something is not covered
_FIELD = 0.2  # share of the variances that covering a ring of the field, or doubling the depth at the rim, is worth
_MOST_PASSED_OVER = 300  # poses that views show already, before it is enough
_PLAIN = {"upper": "top", "lower": "bottom"}
_SAME_ANGLE, _SAME_DISTANCE = np.radians(15.0), 1.3  # within which a pose is one that was tried
_SAME_TILT = np.radians(20.0)  # within which one there is another view of the same


@dataclass(frozen=True)
class Suggestion:
    """A pose worth recording. theta, azimuth: direction of the target's middle, rad; distance: metres; tilt: rad.

    camera_from_target (4, 4). gain: the share by which these variances would shrink in the mean. guessed: the camera
    is not known yet, nor then are angles and distances.
    """

    theta: float
    azimuth: float
    distance: float
    tilt: float
    camera_from_target: np.ndarray
    gain: float
    guessed: bool = False

    @property
    def sentence(self) -> str:
        """What to tell the person who holds the target."""
        if self.guessed:
            return f"hold the target {self.where}, as large as the outline, {self.how}"
        return f"hold the target {self.where}, about {100 * self.distance:.0f} cm away, {self.how}"

    @property
    def short(self) -> str:
        """The same in as few words as can be read from afar."""
        sector = SECTOR_NAMES[sector_of(self.azimuth, len(SECTOR_NAMES))]
        where = "in the middle" if self.theta <= np.radians(10) else f"at the {_PLAIN.get(sector, sector)}"
        away = "" if self.guessed else f", {100 * self.distance:.0f} cm away"
        return f"hold the target {where}{away}, {self.how.replace('by about ', '')}"

    @property
    def where(self) -> str:
        degrees = np.degrees(self.theta)
        if degrees <= 10:
            return "in the middle of the image"
        sector = SECTOR_NAMES[sector_of(self.azimuth, len(SECTOR_NAMES))]
        place = f"towards the {sector} {'edge' if degrees > 60 else 'part'} of the image"
        return place if self.guessed else f"{place} ({degrees:.0f}° off the axis)"

    @property
    def how(self) -> str:
        if self.tilt < np.radians(10):
            return "facing the camera"
        return f"tilted by about {np.degrees(self.tilt):.0f}°"

    def like(self, other: Suggestion) -> bool:
        """Whether the two are nearly the same place and distance."""
        return bool(_near(self, np.array([[other.theta, other.azimuth, other.distance]]))[0])


class Candidates(NamedTuple):
    """grid (F, 4) of (θ, azimuth, distance, tilt); poses (F, 4, 4); information (F, P, P) on the camera.

    rim: rad, the incidence angle at which the image, or half of space, ends.
    """

    grid: np.ndarray
    poses: np.ndarray
    information: np.ndarray
    rim: float

    def suggestion(self, number: int, gain: float) -> Suggestion:
        theta, azimuth, distance, tilt = (float(value) for value in self.grid[number])
        return Suggestion(theta, azimuth, distance, tilt, self.poses[number], gain)

    def near(self, suggestion: Suggestion) -> np.ndarray:
        """Which (F,) are nearly at the place and distance of a suggestion, tilted as may be."""
        return _near(suggestion, self.grid)

    def alike(self, number: int) -> np.ndarray:
        """Which (F,) are nearly that one: at its place and distance, and tilted likewise."""
        normals = self.poses[:, :3, 2]
        result: np.ndarray = self.near(self.suggestion(number, 0.0)) & (normals @ normals[number] > np.cos(_SAME_TILT))
        return result


def candidates(camera: FisheyeCamera, board: Board, away: bool, sight: Sight = EVERYWHERE) -> Candidates:
    """Poses that the detector could see, over the whole field, near and far; none where it can see none.

    camera: as calibrated so far, with a pupil model. away: whether the board's z axis points away from the camera.
    """
    azimuths = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    rim = min(float(light_ends(camera, azimuths, sight).max()), camera.theta_limit, np.pi / 2)
    grid, poses = candidate_poses(board.points, away, _distances(camera, board, sight), rim * _DIRECTIONS)
    visible = detectable(camera, board, poses, sight)
    grid, poses = grid[visible], poses[visible]
    information = view_information(replace(camera, theta_max=np.pi), few_points(board.points), poses).information
    return Candidates(grid, poses, information, rim)


def next_views(
    camera: FisheyeCamera,
    board: Board,
    camera_from_target: np.ndarray,
    offered: Candidates,
    count: int = 1,
    field: Field | None = None,
    tried: Sequence[Suggestion] = (),
    beforehand: np.ndarray | float = 0.0,
    shown: Callable[[Suggestion], bool] = lambda suggestion: False,
) -> list[Suggestion]:
    """The views to take next, each the one that tells most once those before it are taken; fewer where none is left.

    camera_from_target (V, 4, 4): the views so far. field: what is covered of what can be: poses that cover more come
    first. tried: poses that could not be reached. beforehand (P, P): information without any view, per px⁻² of noise.
    shown: whether a view so far shows a pose: another there would not be kept.
    """
    so_far = beforehand + view_information(
        replace(camera, theta_max=np.pi), few_points(board.points), camera_from_target
    ).information.sum(axis=0)
    sought = sought_rows(camera, offered.rim)
    left = np.ones(len(offered.grid), dtype=bool)
    for vain in tried:
        left &= ~offered.near(vain)
    chosen: list[Suggestion] = []
    passed_over = 0
    while len(chosen) < count and left.any():
        gain = variance_reduction(offered.information, so_far, sought) / len(sought)
        share = gain / (1 + gain)
        worth = share
        if field is not None:
            wanting = field.worth(offered.poses)
            turn = (len(camera_from_target) + len(chosen)) % _TURNS == _TURNS - 1
            worth = wanting + 1e-3 * share if turn and wanting[left].any() else share + _FIELD * wanting
        best = int(np.argmax(np.where(left, worth, -np.inf)))
        while passed_over < _MOST_PASSED_OVER and left.any() and shown(offered.suggestion(best, float(share[best]))):
            left[best], passed_over = False, passed_over + 1
            best = int(np.argmax(np.where(left, worth, -np.inf)))
        if not left[best] or passed_over >= _MOST_PASSED_OVER:
            break
        chosen.append(offered.suggestion(best, float(share[best])))
        so_far = so_far + offered.information[best]
        field = None if field is None else field.with_view(offered.poses[best])
        left &= ~offered.alike(best)
    return chosen


def sigma_against_guided(
    camera: FisheyeCamera,
    board: Board,
    camera_from_target: np.ndarray,
    offered: Candidates,
    theta: float,
    views: int = 40,
    beforehand: np.ndarray | float = 0.0,
) -> float:
    """σ of E(theta) from the views so far over that from so many guided ones, both from their geometry alone.

    With M the information of either set, σ² = bᵀ M⁻¹ b, b the pupil's basis at theta. The guided set is chosen
    greedily from nothing but what is known beforehand, as in ``next_views``. NaN where there is nothing to choose from.
    """
    if len(offered.grid) == 0:
        return float("nan")
    own = view_information(replace(camera, theta_max=np.pi), few_points(board.points), camera_from_target)
    so_far = own.information.sum(axis=0)
    row = np.zeros(len(camera.parameters))
    row[camera.parameter_slice("coefficients")] = camera.pupil_family.basis(np.array(theta), len(camera.coefficients))
    sought = sought_rows(camera, offered.rim)
    guided = 1e-3 * so_far / max(len(camera_from_target), 1) + beforehand
    so_far = so_far + beforehand
    left = np.ones(len(offered.grid), dtype=bool)
    for _ in range(views):
        if not left.any():
            break
        gain = variance_reduction(offered.information, guided, sought)
        best = int(np.argmax(np.where(left, gain, -np.inf)))
        guided, left = guided + offered.information[best], left & ~offered.alike(best)  # they would not be kept
    return float(np.sqrt(_variance(so_far, row) / _variance(guided, row)))


def _near(suggestion: Suggestion, grid: np.ndarray) -> np.ndarray:
    """Which of (θ, azimuth, distance, …) (F, 3 or more) are nearly the suggestion's place and distance, bool (F,)."""
    theta, azimuth, distance = grid.T[:3]
    cosine = np.cos(theta) * np.cos(suggestion.theta) + np.sin(theta) * np.sin(suggestion.theta) * np.cos(
        azimuth - suggestion.azimuth
    )
    close = np.abs(np.log(distance / suggestion.distance)) < np.log(_SAME_DISTANCE)
    result: np.ndarray = (cosine > np.cos(_SAME_ANGLE)) & close
    return result


def few_points(points: np.ndarray) -> np.ndarray:
    """Some of the target's points (n, 3), spread over it."""
    return points[:: max(1, len(points) // _MOST_POINTS)]


def faces_away(board: Board, camera_from_target: np.ndarray) -> bool:
    """Whether the board's z axis points away from the camera, in the views (V, 4, 4) so far."""
    in_camera = placed(camera_from_target, board_middle(board.points))
    return bool(np.median((camera_from_target[:, :3, 2] * in_camera).sum(axis=-1)) > 0)


def sought_rows(camera: FisheyeCamera, rim: float) -> np.ndarray:
    """Rows (Q, P): derivatives of E(θ) and of fx r(θ) by the camera's parameters, over the field out to the rim."""
    theta = np.linspace(0.3, 1.0, 12) * rim
    count = len(camera.parameters)
    radial = np.zeros((len(theta), count))
    radial[:, 0] = camera.radius(theta)
    radial[:, camera.parameter_slice("radial")] = (
        camera.fx * camera.lens_model.radius_jacobian(theta, camera.radial_array).T
    )
    pupil = np.zeros((len(theta), count))
    pupil[:, camera.parameter_slice("coefficients")] = camera.pupil_family.basis(theta, len(camera.coefficients)).T
    return np.concatenate([pupil, radial])


def candidate_poses(
    object_points: np.ndarray,
    away: bool,
    distances: Sequence[float] | np.ndarray,
    directions: Sequence[float] | np.ndarray,
    tilts: Sequence[float] | np.ndarray = _TILTS,
) -> tuple[np.ndarray, np.ndarray]:
    """Grid (F, 4) of (θ, azimuth, distance, tilt) and poses (F, 4, 4); the side that was shown so far is shown."""
    middle = board_middle(object_points)
    azimuths = 2 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    turns = 2 * np.pi * np.arange(_TILT_AZIMUTHS) / _TILT_AZIMUTHS
    axes = np.meshgrid(np.array(directions), azimuths, np.array(distances), np.array(tilts), turns, indexing="ij")
    theta, azimuth, distance, tilt, turn = (axis.ravel() for axis in axes)
    unique = ((theta > 0) | (azimuth == 0)) & ((tilt > 0) | (turn == 0))
    theta, azimuth, distance, tilt, turn = (axis[unique] for axis in (theta, azimuth, distance, tilt, turn))
    zero = np.zeros_like(theta)
    toward = rotation_from_vector(np.stack([-theta * np.sin(azimuth), theta * np.cos(azimuth), zero], axis=-1))
    tilted = rotation_from_vector(np.stack([tilt * np.cos(turn), tilt * np.sin(turn), zero], axis=-1))
    facing = np.eye(3) if away else np.diag([1.0, -1.0, -1.0])
    poses = np.tile(np.eye(4), (len(theta), 1, 1))
    poses[:, :3, :3] = toward @ tilted @ facing
    poses[:, :3, 3] = distance[:, None] * toward[:, :, 2] - poses[:, :3, :3] @ middle
    return np.stack([theta, azimuth, distance, tilt], axis=-1), poses


def _distances(camera: FisheyeCamera, board: Board, sight: Sight) -> np.ndarray:
    """Where the target may be held, metres: f s / d px across is what its smallest feature s has in the middle."""
    nearest = _NEAREST * board.radius
    farthest = min(camera.fx * board.feature / board.least_feature(sight), _FARTHEST * board.radius)
    return np.geomspace(nearest, max(farthest, 1.2 * nearest), _DISTANCES)


def _variance(information: np.ndarray, row: np.ndarray) -> float:
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * scale * scale[:, None] + 1e-12 * np.eye(len(information))
    return float((row * scale) @ np.linalg.solve(scaled, row * scale))
