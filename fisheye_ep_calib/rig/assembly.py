"""From each camera's own poses of the target to a first state of the whole rig, every point called by one name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.rig.graph import Chains, components, join
from fisheye_ep_calib.rig.pairs import PairPose, best_symmetry, pair_pose
from fisheye_ep_calib.rig.symmetry import Symmetry

MIN_COMMON_VIEWS = 3
_DISAGREES = 0.2  # of the distance: a camera that sees the target elsewhere by more saw another moment


class ContradictoryViews(CalibrationError):
    """The common views of two cameras say different things of where they are to each other, or there are too few."""


@dataclass(frozen=True)
class CameraPoses:
    """The target as one camera sees it. camera_from_target: by image number, (4, 4). points: sightings, by image."""

    observations: Observations
    camera_from_target: dict[int, np.ndarray]
    points: np.ndarray


@dataclass(frozen=True)
class Assembly:
    """moments (M, C): image numbers, −1 for none, of the moments that remain. reference_from_target (M, 4, 4).

    observations: of each camera, its points called as the others call them. left_out: (camera, image) that disagree.
    """

    chains: Chains
    pairs: dict[tuple[int, int], PairPose]
    moments: np.ndarray
    reference_from_target: np.ndarray
    observations: tuple[Observations, ...]
    left_out: tuple[tuple[int, int], ...]


def assemble(
    cameras: Sequence[CameraPoses],
    names: Sequence[str],
    moments: np.ndarray,
    symmetries: Sequence[Symmetry],
    keep_single: bool = False,
) -> Assembly:
    """The first state of a rig. moments (m, C): image numbers, −1 for none.

    keep_single: keep moments that one camera alone sees, which say something of that camera's parameters.
    Raises CalibrationError where the views do not join all cameras.
    """
    moments = np.where(_has_pose(cameras, moments), moments, -1)
    relative = relative_poses(cameras, moments, symmetries)
    pairs = {pair: pose for pair, pose in relative.items() if enough_agree(pose.views, pose.common)}
    chains = join(pairs, len(cameras))
    if chains is None:
        raise ContradictoryViews(_not_joined(names, relative, pairs, moments))
    for camera, before in enumerate(chains.before):
        if before >= 0 and pairs[min(camera, before), max(camera, before)].ambiguous:
            raise CalibrationError(
                f"{names[before]} and {names[camera]}: the target looks the same turned, and their common views do not "
                "tell which way it is: move and turn it between views, or take one whose points cannot be mistaken"
            )
    return _with_one_name_a_point(cameras, moments, symmetries, pairs, chains, 1 if keep_single else 2)


def relative_poses(
    cameras: Sequence[CameraPoses], moments: np.ndarray, symmetries: Sequence[Symmetry]
) -> dict[tuple[int, int], PairPose]:
    """The relative pose of every pair (a, b), a < b, with enough common views, whether these agree or not."""
    points = cameras[0].observations.object_points
    pairs = {}
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            common = moments[(moments[:, [a, b]] >= 0).all(axis=1)]
            if len(common) < MIN_COMMON_VIEWS:
                continue
            of_a, of_b = (np.stack([cameras[c].camera_from_target[image] for image in common[:, c]]) for c in (a, b))
            pairs[a, b] = pair_pose(of_a, of_b, symmetries, points)
    return pairs


def enough_agree(agreeing: int, common: int) -> bool:
    """Whether two cameras' common views say where they are to each other: three do, and most of them."""
    return agreeing >= MIN_COMMON_VIEWS and 2 * agreeing > common


def contradiction(a: str, b: str, agreeing: int, common: int) -> str:
    """What is said of two cameras whose views do not agree enough."""
    return (
        f"{common - agreeing} of {common} common views of {a} and {b} contradict each other: are the clocks the same, "
        "and the cameras fixed to one another?"
    )


def refuse_contradictions(assembly: Assembly, names: Sequence[str]) -> None:
    """Raise ContradictoryViews where too few of the views that were to join two cameras are left."""
    for camera, before in enumerate(assembly.chains.before):
        if before >= 0:
            a, b = sorted((camera, before))
            left = int((assembly.moments[:, [a, b]] >= 0).all(axis=1).sum())
            common = assembly.pairs[a, b].common
            if not enough_agree(left, common):
                raise ContradictoryViews(contradiction(names[a], names[b], left, common))


def _has_pose(cameras: Sequence[CameraPoses], moments: np.ndarray) -> np.ndarray:
    return np.array(
        [[image in cameras[c].camera_from_target for c, image in enumerate(row)] for row in moments.tolist()]
    ).reshape(moments.shape)


def _not_joined(
    names: Sequence[str],
    relative: dict[tuple[int, int], PairPose],
    pairs: dict[tuple[int, int], PairPose],
    moments: np.ndarray,
) -> str:
    sentences = [
        contradiction(names[a], names[b], pose.views, pose.common)
        for (a, b), pose in relative.items()
        if (a, b) not in pairs
    ]
    if sentences:
        return "; ".join(sentences[:3])
    groups = [", ".join(names[camera] for camera in group) for group in components(list(pairs), len(names))]
    counts = [
        f"{names[a]} and {names[b]}: {int((moments[:, [a, b]] >= 0).all(axis=1).sum())}"
        for a in range(len(names))
        for b in range(a + 1, len(names))
        if (a, b) not in pairs
    ]
    return (
        f"no chain of common views joins {' | '.join(groups)}; views of the target at the same time that agree are "
        f"needed, {MIN_COMMON_VIEWS} at least ({'; '.join(counts[:8])}): hold the target where both see it"
    )


def _with_one_name_a_point(
    cameras: Sequence[CameraPoses],
    moments: np.ndarray,
    symmetries: Sequence[Symmetry],
    pairs: dict[tuple[int, int], PairPose],
    chains: Chains,
    least: int,
) -> Assembly:
    """Choose each view's symmetry such that all cameras of a moment mean the same point by the same name."""
    points = cameras[0].observations.object_points
    reference_from_camera = np.linalg.inv(chains.camera_from_reference)
    point_index = [camera.observations.point_index.copy() for camera in cameras]
    kept, poses, left_out = [], [], []
    rows_of = [camera.observations.rows_of(np.arange(len(camera.observations.image_names))) for camera in cameras]
    for moment in moments:
        seeing = np.flatnonzero(moment >= 0).tolist()
        if len(seeing) < least:
            continue
        base = max(seeing, key=lambda c: cameras[c].points[moment[c]])
        pose = reference_from_camera[base] @ cameras[base].camera_from_target[int(moment[base])]
        row = moment.copy()
        for c in seeing:
            image = int(moment[c])
            expected = chains.camera_from_reference[c] @ pose
            which, off = best_symmetry(expected, cameras[c].camera_from_target[image], symmetries, points)
            if off > _DISAGREES:
                row[c] = -1
                left_out.append((c, image))
                continue
            rows = rows_of[c][image]
            point_index[c][rows] = symmetries[which].relabelled(point_index[c][rows])
        if (row >= 0).sum() >= least:
            kept.append(row)
            poses.append(pose)
    observations = tuple(
        replace(camera.observations, point_index=index) for camera, index in zip(cameras, point_index, strict=True)
    )
    return Assembly(
        chains,
        pairs,
        np.array(kept, dtype=int).reshape(-1, len(cameras)),
        np.array(poses).reshape(-1, 4, 4),
        observations,
        tuple(left_out),
    )
