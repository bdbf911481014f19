"""A rig from views of one target: where every camera is, in the first one's frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.calibration.estimating.levenberg_marquardt import Minimum
from fisheye_ep_calib.calibration.estimating.prediction import FeatureModel
from fisheye_ep_calib.calibration.estimating.robust import Loss, noise_variance, robust_spread
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.rig.adjustment import (
    RigProblem,
    RigState,
    adjust_rig,
    camera_views,
    rig_residuals,
)
from fisheye_ep_calib.rig.assembly import (
    Assembly,
    CameraPoses,
    ContradictoryViews,
    assemble,
    refuse_contradictions,
)
from fisheye_ep_calib.rig.board import rig_board
from fisheye_ep_calib.rig.clocks import clocks_of_rig
from fisheye_ep_calib.rig.result import RigCalibration, RigPair
from fisheye_ep_calib.rig.symmetry import no_symmetry, symmetries
from fisheye_ep_calib.rig.synchronisation import nearest_ns, simultaneous
from fisheye_ep_calib.rig.uncertainty import of_inverse, pose_covariance
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.frame import board_frame
from fisheye_ep_calib.target.shape.measured import BoardShape, known_board
from fisheye_ep_calib.target.shape.model import bow_model, flat_model

USUAL_TOLERANCE = 0.01  # seconds
_WRONG_VIEW = 8.0  # times the spread: a view whose median residual is larger was taken at another time
_LEAST_SPREAD = 1e-3  # pixels
_HUBER = 3.0  # times the spread: where a sighting stops counting fully


@dataclass(frozen=True)
class RigCamera:
    """One camera and what it saw. stamps_ns: when each image was taken, by image number.

    covariance (P, P): of the camera's parameters, as its file gives it; zero, or None: they are taken as exact.
    board: the target's shape as this camera's calibration found it.
    """

    name: str
    camera: FisheyeCamera
    observations: Observations
    stamps_ns: np.ndarray
    covariance: np.ndarray | None = None
    board: BoardShape | None = None


def calibrate_rig(
    cameras: Sequence[RigCamera],
    tolerance: float = USUAL_TOLERANCE,
    unmistakable: bool = False,
    free_cameras: bool = False,
    board_warp: np.ndarray | None = None,
    warp_free: bool = False,
    find_clocks: bool = False,
) -> RigCalibration:
    """Each camera's pose in the first one's frame. tolerance: seconds within which images are of the same time.

    unmistakable: no detector can take the target for itself turned. free_cameras: the cameras' parameters are refined
    too, those with a covariance above zero, or all. The target has the shape that explains its views best: as the
    observations bring it, as a camera's calibration found it, or estimated here (board.py); known ones alone where
    cameras or bow are free. board_warp (3,): a bow on top of it, metres; warp_free: it is refined. find_clocks: the
    cameras' clocks differ by constants, which the views tell. Raises CalibrationError.
    """
    _check(cameras)
    bow = np.zeros(len(WARP_NAMES)) if board_warp is None else np.asarray(board_warp, dtype=float)
    measured = known_board((rig_camera.board for rig_camera in cameras), cameras[0].observations.object_points)
    board = known_board([rig_camera.observations.board for rig_camera in cameras]) or measured
    poses = [_poses(rig_camera, bow, board) for rig_camera in cameras]
    points = cameras[0].observations.object_points
    turns = no_symmetry(points) if unmistakable else symmetries(points)
    names = [rig_camera.name for rig_camera in cameras]
    of_poses = [of_camera.camera_from_target for of_camera in poses]

    def clocks() -> list[int | None]:
        stamps = [rig_camera.stamps_ns for rig_camera in cameras]
        return clocks_of_rig(stamps, of_poses, turns, points, round(tolerance * 1e9))

    clock = clocks() if find_clocks else [0] * len(cameras)
    corrected = [_by_first_clock(rig_camera, names[0], ns) for rig_camera, ns in zip(cameras, clock, strict=True)]
    try:
        assembly = assemble(poses, names, _moments(corrected, tolerance), turns, keep_single=free_cameras)
        chosen = None
        if not (free_cameras or warp_free or bow.any()):
            chosen = rig_board([rig_camera.camera for rig_camera in cameras], _common_views(assembly), measured)
            board = chosen.board
        assembly = _with_board(assembly, board)
        minimum, assembly, problem, wrong = _fit(cameras, assembly, bow, free_cameras, warp_free)
    except ContradictoryViews as error:
        raise CalibrationError(f"{error}{'' if find_clocks else _said_of_clocks(names, clocks())}") from None
    covariances = None if free_cameras else [rig_camera.covariance for rig_camera in cameras]
    result = _result(cameras, assembly, problem, minimum, wrong, covariances, tuple(ns or 0 for ns in clock))
    return replace(result, board=chosen)


def _common_views(assembly: Assembly) -> list[Observations]:
    """What each camera saw at the moments in use, every point under the name that all agree on."""
    common = []
    for observations, images in zip(assembly.observations, assembly.moments.T, strict=True):
        used = np.isin(observations.image_index, images[images >= 0])
        common.append(replace(observations, weights=np.where(used, observations.weights, 0.0)))
    return common


def _with_board(assembly: Assembly, board: BoardShape | None) -> Assembly:
    return replace(assembly, observations=tuple(replace(of_camera, board=board) for of_camera in assembly.observations))


def _by_first_clock(rig_camera: RigCamera, first: str, offset_ns: int | None) -> RigCamera:
    if offset_ns is None:
        raise CalibrationError(
            f"no constant difference of the clocks makes the views of {rig_camera.name} and {first} agree, or the "
            "target moved too little to tell: move it more where both see it"
        )
    return replace(rig_camera, stamps_ns=np.asarray(rig_camera.stamps_ns, dtype=np.int64) - offset_ns)


def _said_of_clocks(names: Sequence[str], clocks: Sequence[int | None]) -> str:
    """What a constant difference of the clocks would mend, in words that follow an error."""
    ahead = [
        f"{name}'s clock {1e-6 * abs(ns):.1f} ms {'ahead of' if ns > 0 else 'behind'} {names[0]}'s"
        for name, ns in zip(names, clocks, strict=True)
        if ns
    ]
    return f" With {', '.join(ahead)} they agree (--time-offset auto, find_clocks)" if ahead else ""


def _fit(
    cameras: Sequence[RigCamera], assembly: Assembly, bow: np.ndarray, free_cameras: bool, warp_free: bool
) -> tuple[Minimum[RigState], Assembly, RigProblem, tuple[tuple[int, int], ...]]:
    """The adjusted rig, and what it was adjusted to once views that contradict the others were left out."""
    names = [rig_camera.name for rig_camera in cameras]
    refuse_contradictions(assembly, names)
    free = [
        _free(rig_camera) if free_cameras else np.zeros(len(rig_camera.camera.parameters), bool)
        for rig_camera in cameras
    ]
    state = RigState(
        tuple(rig_camera.camera for rig_camera in cameras),
        assembly.chains.camera_from_reference,
        assembly.reference_from_target,
        bow,
    )
    problem = _problem(assembly, free, warp_free)
    state = adjust_rig(replace(problem, loss=_loss(problem, state, "cauchy")), state, max_iterations=30).state
    assembly, state, wrong = _without_wrong_views(assembly, problem, state, least=1 if free_cameras else 2)
    refuse_contradictions(assembly, names)
    problem = _problem(assembly, free, warp_free)
    problem = replace(problem, loss=_loss(problem, state, "huber"))
    return adjust_rig(problem, state), assembly, problem, wrong


def _check(cameras: Sequence[RigCamera]) -> None:
    if len(cameras) < 2:
        raise InputError("a rig has two cameras at least")
    if len({rig_camera.name for rig_camera in cameras}) < len(cameras):
        raise InputError("two cameras of the rig have the same name")
    first = cameras[0].observations
    for rig_camera in cameras:
        observations = rig_camera.observations
        if (
            not np.array_equal(observations.object_points, first.object_points)
            or observations.disc_radius != first.disc_radius
        ):
            raise InputError(f"{cameras[0].name} and {rig_camera.name} were shown different targets")
        if len(rig_camera.stamps_ns) < len(observations.image_names):
            raise InputError(f"{rig_camera.name}: there are fewer stamps than images")


def _moments(cameras: Sequence[RigCamera], tolerance: float) -> np.ndarray:
    """Image numbers (m, C) of what was seen at the same time, −1 for nothing."""
    images = [np.unique(rig_camera.observations.image_index) for rig_camera in cameras]
    stamps = [
        np.asarray(rig_camera.stamps_ns, dtype=np.int64)[of_camera]
        for rig_camera, of_camera in zip(cameras, images, strict=True)
    ]
    together = simultaneous(stamps, round(tolerance * 1e9))
    moments = np.full_like(together, -1)
    for camera, of_camera in enumerate(images):
        has = together[:, camera] >= 0
        moments[has, camera] = of_camera[together[has, camera]]
    if not ((moments >= 0).sum(axis=1) > 1).any():
        gaps = [
            (nearest_ns(stamps[a], stamps[b]) * 1e-9, cameras[a].name, cameras[b].name)
            for a in range(len(stamps))
            for b in range(a + 1, len(stamps))
            if len(stamps[a]) and len(stamps[b])
        ]
        gap, a, b = min(gaps, default=(np.inf, cameras[0].name, cameras[1].name))
        raise CalibrationError(
            f"no two cameras saw the target within {1e3 * tolerance:g} ms of each other; the nearest two images, of "
            f"{a} and {b}, are {1e3 * gap:.1f} ms apart: widen --tolerance if the target was held still, "
            "or have the clocks compared: --time-offset auto, find_clocks"
        )
    return moments


def _poses(rig_camera: RigCamera, board_warp: np.ndarray, board: BoardShape | None) -> CameraPoses:
    try:
        evaluation = evaluate_camera(rig_camera.camera, rig_camera.observations, board_warp, board=board)
    except CalibrationError as error:
        raise type(error)(f"{rig_camera.name}: {error}") from None
    poses = {int(image): pose for image, pose in zip(evaluation.images, evaluation.camera_from_target, strict=True)}
    image_index = rig_camera.observations.image_index[rig_camera.observations.weights > 0]
    points = np.bincount(image_index, minlength=len(rig_camera.observations.image_names))
    return CameraPoses(rig_camera.observations, poses, points)


def _free(rig_camera: RigCamera) -> np.ndarray:
    if rig_camera.covariance is None or not np.any(rig_camera.covariance):
        return np.ones(len(rig_camera.camera.parameters), bool)
    return np.diag(rig_camera.covariance) > 0


def _problem(assembly: Assembly, free: Sequence[np.ndarray], warp_free: bool) -> RigProblem:
    views = []
    for camera, observations in enumerate(assembly.observations):
        moments = np.flatnonzero(assembly.moments[:, camera] >= 0)
        images = assembly.moments[moments, camera]
        order = np.argsort(images)
        views.append(camera_views(observations, images[order], moments[order], free[camera]))
    first = assembly.observations[0]
    features = FeatureModel(board_frame(first.object_points), first.disc_radius)
    board = known_board([observations.board for observations in assembly.observations])
    measured = None if board is None else board.local
    return RigProblem(tuple(views), features, bow_model(flat_model(first.object_points, measured)), warp_free)


def _lengths(problem: RigProblem, state: RigState) -> list[np.ndarray]:
    """Weighted residual lengths (M_c,), px, of each camera; NaN where a sighting is not used."""
    return [
        np.where(view.observations.weights > 0, np.hypot(*error.T) * view.observations.weights, np.nan)
        for view, error in zip(problem.views, rig_residuals(problem, state), strict=True)
    ]


def _spread(problem: RigProblem, state: RigState) -> float:
    lengths = np.concatenate(_lengths(problem, state))
    return max(robust_spread(lengths[np.isfinite(lengths)]), _LEAST_SPREAD)


def _loss(problem: RigProblem, state: RigState, kind: str) -> Loss:
    return Loss(kind, (2.0 if kind == "cauchy" else _HUBER) * _spread(problem, state))


def _without_wrong_views(
    assembly: Assembly, problem: RigProblem, state: RigState, least: int
) -> tuple[Assembly, RigState, tuple[tuple[int, int], ...]]:
    """Leave out views whose points are all off: the target had moved, or it was not the target."""
    limit = _WRONG_VIEW * _spread(problem, state)
    moments, wrong = assembly.moments.copy(), []
    for camera, lengths in enumerate(_lengths(problem, state)):
        seen = np.flatnonzero(moments[:, camera] >= 0)
        rows_of = assembly.observations[camera].rows_of(moments[seen, camera])
        for row, rows in zip(seen.tolist(), rows_of, strict=True):
            of_view = lengths[rows]
            of_view = of_view[np.isfinite(of_view)]
            if len(of_view) == 0 or np.median(of_view) > limit:
                wrong.append((camera, int(moments[row, camera])))
                moments[row, camera] = -1
    kept = (moments >= 0).sum(axis=1) >= least
    assembly = replace(assembly, moments=moments[kept], reference_from_target=assembly.reference_from_target[kept])
    state = replace(state, reference_from_target=state.reference_from_target[kept])
    for camera in range(moments.shape[1]):
        if not (assembly.moments[:, camera] >= 0).any():
            raise ContradictoryViews("the common views contradict each other: were all cameras fixed to one another?")
    return assembly, state, tuple(wrong)


def _result(
    cameras: Sequence[RigCamera],
    assembly: Assembly,
    problem: RigProblem,
    minimum: Minimum[RigState],
    wrong: tuple[tuple[int, int], ...],
    covariances: Sequence[np.ndarray | None] | None,
    clock_offsets_ns: tuple[int, ...],
) -> RigCalibration:
    state = minimum.state
    lengths = [length[np.isfinite(length)] for length in _lengths(problem, state)]
    points = sum(len(length) for length in lengths)
    unknowns = problem.shared_size + 6 * problem.moment_count
    square = np.concatenate(lengths) ** 2
    variance, weight = noise_variance(problem.loss, square, 2 * points - unknowns)
    of_files = [None] * len(cameras) if covariances is None else covariances
    covariance = pose_covariance(problem, state, variance * weight, of_files)
    of_poses = np.zeros((len(cameras), 6, 6))
    for camera in range(1, len(cameras)):
        block = slice(6 * (camera - 1), 6 * camera)
        of_poses[camera] = of_inverse(state.camera_from_reference[camera], covariance[block, block])
    sees = assembly.moments >= 0
    pairs = tuple(
        RigPair(a, b, int((sees[:, a] & sees[:, b]).sum()), pair.disagreement)
        for (a, b), pair in sorted(assembly.pairs.items())
    )
    names = [rig_camera.observations.image_names for rig_camera in cameras]
    return RigCalibration(
        names=tuple(rig_camera.name for rig_camera in cameras),
        cameras=state.cameras,
        reference_from_camera=np.linalg.inv(state.camera_from_reference),
        covariance=of_poses,
        paths=tuple(assembly.chains.path(camera) for camera in range(len(cameras))),
        pairs=pairs,
        moments=len(assembly.moments),
        views=tuple(int(count) for count in sees.sum(axis=0)),
        rms_px=float(np.sqrt(square.mean())),
        camera_rms_px=tuple(float(np.sqrt((length**2).mean())) for length in lengths),
        left_out=tuple((camera, names[camera][image]) for camera, image in (*assembly.left_out, *wrong)),
        board_warp=state.board_warp,
        converged=minimum.converged,
        clock_offsets_ns=clock_offsets_ns,
    )
