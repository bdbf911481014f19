"""Which images would tell most about the camera, judged before they are read.

From the views so far a rough camera and their poses; between two of them the target is taken to have moved smoothly.
Where it then stands tells, through the camera's Jacobians, how much an image there would narrow down E(θ) and the
rest of the camera: the images that narrow it most are looked at next (a greedy, sequential optimal design).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.planning.view_information import variance_reduction, view_information
from fisheye_ep_calib.rotation import rotation_from_vector, vector_from_rotation
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.detection import Detection

MIN_VIEWS = 8
MAX_CANDIDATES = 800
POINTS_A_VIEW = 40  # enough to tell views apart
# Fractions of the image height: a target that moved less repeats the same errors; its image adds nothing new.
LEAST_MOTION = 0.006
MOST_OVERSHOOT = 1.3  # of the nearest and the farthest distance seen
ENOUGH = 1e-4  # of the cost: what follows is rougher
ROUGH_FIT = 0.02  # median residual above which the rough camera is not to be trusted


@dataclass(frozen=True)
class _Views:
    """Predicted views. images (F,). pixels (F, n, 2), NaN where out of sight. information (F, P, P)."""

    images: np.ndarray
    pixels: np.ndarray
    information: np.ndarray


def most_informative(
    detections: Mapping[int, Detection],
    looked_at: Sequence[int],
    target: Target,
    image_size: tuple[int, int],
    room: int,
) -> list[int]:
    """Up to ``room`` images between those seen, the most informative first; none where too little is known.

    detections: image → detection, of those in which the target was found; looked_at: all that were looked at.
    """
    if room < 1 or len(detections) < MIN_VIEWS:
        return []
    start = _rough_camera(detections, target, image_size)
    if start is None:
        return []
    camera, images, poses = start
    between, poses_between = _poses_between(images, poses, sorted(looked_at), _middle(target))
    if len(between) == 0:
        return []
    points = target.object_points[_some(len(target.object_points))]
    of_looked_at = _views(camera, points, images, poses)
    candidates = _views(camera, points, between, poses_between)
    return _greedy(camera, of_looked_at, candidates, room, LEAST_MOTION * image_size[1])


def _rough_camera(
    detections: Mapping[int, Detection], target: Target, image_size: tuple[int, int]
) -> tuple[FisheyeCamera, np.ndarray, np.ndarray] | None:
    """A camera with an entrance pupil, the images (V,) that have a pose, and the poses (V, 4, 4)."""
    images = np.array(sorted(detections))
    parts = [(detections[image], _some(len(detections[image]))) for image in images.tolist()]
    try:
        observations = Observations.create(
            target.object_points,
            np.repeat(np.arange(len(images)), [len(some) for _, some in parts]),
            np.concatenate([detection.point_index[some] for detection, some in parts]),
            np.concatenate([detection.pixels[some] for detection, some in parts]),
            image_size,
        )
        plain = first_fit(prepare(observations), robust=True)
        fit = refine(plain, Structure("ep_even", skew=False), loss=plain.problem.loss, tolerance=ENOUGH)
    except (CalibrationError, np.linalg.LinAlgError):
        return None
    error = np.linalg.norm(fit.residuals[0], axis=-1)
    if not np.nanmedian(error) < ROUGH_FIT * image_size[1]:
        return None
    return fit.state.camera, images[fit.sightings.images], fit.state.camera_from_target


def _some(count: int) -> np.ndarray:
    """Indices of enough of so many points, spread over the target whatever the length of its rows."""
    return np.sort(np.random.default_rng(0).permutation(count)[:POINTS_A_VIEW])


def _middle(target: Target) -> np.ndarray:
    result: np.ndarray = 0.5 * (target.object_points.min(axis=0) + target.object_points.max(axis=0))
    return result


def _poses_between(
    images: np.ndarray, poses: np.ndarray, looked_at: Sequence[int], middle: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Images not seen between two neighbours in ``looked_at`` that both have a pose, and their supposed poses.

    The board turns about one axis, evenly; its middle moves along a smooth curve.
    """
    number = {image: view for view, image in enumerate(images.tolist())}
    gaps = [(a, b) for a, b in zip(looked_at, looked_at[1:], strict=False) if b - a > 1 and a in number and b in number]
    between = np.array([image for a, b in gaps for image in range(a + 1, b)], dtype=int)
    stride = -(-len(between) // MAX_CANDIDATES) or 1
    between = between[stride // 2 :: stride]
    if len(between) == 0:
        return between, np.empty((0, 4, 4))
    starts, ends = (np.array([gap[side] for gap in gaps]) for side in (0, 1))
    gap = np.searchsorted(starts, between, side="right") - 1
    share = (between - starts[gap]) / (ends[gap] - starts[gap])
    first = poses[[number[a] for a in starts[gap].tolist()]]
    last = poses[[number[b] for b in ends[gap].tolist()]]
    turned = np.swapaxes(first[:, :3, :3], -1, -2) @ last[:, :3, :3]
    result = np.tile(np.eye(4), (len(between), 1, 1))
    result[:, :3, :3] = first[:, :3, :3] @ rotation_from_vector(share[:, None] * vector_from_rotation(turned))
    result[:, :3, 3] = _middle_between(images, poses, between, middle) - result[:, :3, :3] @ middle
    return between, result


def _middle_between(images: np.ndarray, poses: np.ndarray, between: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Where the board's middle supposedly is (F, 3) m: direction, log distance on Akima's curve through those known.

    A hand moves smoothly: the curve foresees how near and how far out the board comes between two images.
    """
    from scipy.interpolate import Akima1DInterpolator

    center = poses[:, :3, :3] @ middle + poses[:, :3, 3]
    distance = np.linalg.norm(center, axis=-1) + 1e-12
    positions = np.column_stack([center / distance[:, None], np.log(distance)])
    course = Akima1DInterpolator(images, positions)(between)
    direction = course[:, :3] / (np.linalg.norm(course[:, :3], axis=-1, keepdims=True) + 1e-12)
    overshoot = np.log(MOST_OVERSHOOT)
    result: np.ndarray = direction * np.exp(
        np.clip(course[:, 3:], positions[:, 3].min() - overshoot, positions[:, 3].max() + overshoot)
    )
    return result


def _views(camera: FisheyeCamera, points: np.ndarray, images: np.ndarray, poses: np.ndarray) -> _Views:
    """What images with the target at poses (F, 4, 4) would show of points (n, 3), and tell of the camera."""
    told = view_information(camera, points, poses)
    return _Views(images, told.pixels, told.information)


def _greedy(camera: FisheyeCamera, so_far: _Views, candidates: _Views, room: int, least_motion: float) -> list[int]:
    """Take, one after the other, the candidate that most lowers the variances that are still largest.

    They are, each relative to its present value, those of E(θ) over the field and of every parameter.
    """
    total = so_far.information.sum(axis=0)
    sought = _sought(camera)
    after = np.clip(np.searchsorted(so_far.images, candidates.images), 1, len(so_far.images) - 1)
    fresh = np.ones(len(candidates.images), dtype=bool)
    for neighbour in (after - 1, after):
        fresh &= _moved(candidates.pixels, so_far.pixels[neighbour], least_motion)
    taken: list[int] = []
    while len(taken) < room and fresh.any():
        gain = np.where(fresh, variance_reduction(candidates.information, total, sought), -1)
        best = int(np.argmax(gain))
        if gain[best] <= 0:
            break
        taken.append(best)
        total = total + candidates.information[best]
        fresh &= _moved(candidates.pixels, candidates.pixels[best], least_motion)
    return [int(candidates.images[row]) for row in taken]


def _sought(camera: FisheyeCamera) -> np.ndarray:
    """Rows (Q, P): the derivatives of what is sought by the camera's parameters; E(θ) weighs as much as the rest."""
    names = camera.parameter_names
    theta = np.linspace(0.3, 1.0, 2 * len(names)) * min(camera.theta_limit, np.pi / 2)
    curve = np.zeros((len(theta), len(names)))
    curve[:, camera.parameter_slice("coefficients")] = camera.pupil_family.basis(theta, len(camera.coefficients)).T
    return np.concatenate([curve, np.eye(len(names))])


def _moved(pixels: np.ndarray, others: np.ndarray, least: float) -> np.ndarray:
    """Which views (F, n, 2) differ from others (F, n, 2) or (n, 2) by at least so many pixels in the mean (F,)."""
    distance = np.linalg.norm(pixels - others, axis=-1)
    common = np.isfinite(distance)
    count = common.sum(axis=-1)
    result: np.ndarray = (count == 0) | (np.where(common, distance, 0).sum(axis=-1) >= least * count)
    return result
