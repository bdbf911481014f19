"""Views that try a detector: every way in which a board meets a fisheye, with the truth beside each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.simulation.poses import look_pose
from fisheye_ep_calib.simulation.rendering import Imaging, render, visible_mask
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.simulation.truth import feature_pixels, points_in_camera
from fisheye_ep_calib.target import Target

Range = tuple[float, float]

_CORNER_REACH = 5.0  # pixels around a corner that must be in sight for it to count as visible
_DISC_REACH = 1.25  # radii around a disc's centre that must be
_REFERENCE_DIAGONAL = 0.140  # metres, of the paper's target: distances are for a board of this size


@dataclass(frozen=True)
class ViewKind:
    """A kind of view: how many, and the ranges they are drawn from (angles in degrees, distance in metres)."""

    name: str
    count: int
    theta: Range
    tilt: Range
    distance: Range
    occluded: bool = False


VIEW_KINDS = (
    ViewKind("frontal", 6, (0, 20), (0, 10), (0.10, 0.15)),
    ViewKind("tilted", 6, (0, 40), (25, 50), (0.11, 0.16)),
    ViewKind("steep", 6, (0, 40), (55, 70), (0.14, 0.19)),
    ViewKind("edge", 12, (55, 78), (0, 35), (0.11, 0.16)),
    ViewKind("far", 6, (0, 60), (0, 35), (0.22, 0.40)),
    ViewKind("occluded", 6, (0, 50), (0, 35), (0.11, 0.16), occluded=True),
)


@dataclass(frozen=True)
class EvaluationView:
    """One view and what is true of it.

    kind: a name of VIEW_KINDS. pose (4, 4): camera_from_target. pixels (n, 2): where each feature of the target is.
    visible (n,) bool: whether it is wholly in sight, with the surroundings that it takes to measure it.
    """

    kind: str
    pose: np.ndarray
    imaging: Imaging
    pixels: np.ndarray
    visible: np.ndarray

    def image(self, camera: SceneCamera, target: Target) -> np.ndarray:
        """The rendered view (h, w) uint8."""
        return render(camera, target, self.pose, self.imaging)


def evaluation_set(camera: SceneCamera, target: Target, seed: int = 0) -> tuple[EvaluationView, ...]:
    """The views of a target (42 of them), reproducible by seed; images are rendered when asked for.

    Blur, noise, vignetting, shading and a textured background vary from view to view. Distances grow with the board,
    so that boards of any size fill the same part of the image.
    """
    rng = np.random.default_rng([seed, 42])
    extent = np.ptp(target.object_points[:, :2], axis=0)
    scale = float(np.hypot(*extent)) / _REFERENCE_DIAGONAL
    views = []
    for kind in VIEW_KINDS:
        for number in range(kind.count):
            pose = look_pose(
                target,
                theta=np.radians(rng.uniform(*kind.theta)),
                azimuth=2 * np.pi * (number + rng.uniform()) / kind.count,
                distance=scale * rng.uniform(*kind.distance),
                tilt=np.radians(rng.uniform(*kind.tilt)),
                tilt_azimuth=rng.uniform(-np.pi, np.pi),
                roll=rng.uniform(-np.pi, np.pi),
            )
            imaging = Imaging(
                blur=rng.uniform(0.5, 1.2),
                noise=rng.uniform(0.5, 4.0),
                vignetting=rng.uniform(0, 0.4),
                shading=rng.uniform(0, 0.25),
                shading_angle=rng.uniform(-np.pi, np.pi),
                texture=rng.uniform(10, 50),
                seed=int(rng.integers(1 << 30)),
            )
            views.append(_view(camera, target, kind, pose, imaging, rng))
    return tuple(views)


def _view(
    camera: SceneCamera, target: Target, kind: ViewKind, pose: np.ndarray, imaging: Imaging, rng: np.random.Generator
) -> EvaluationView:
    pixels, valid = feature_pixels(camera, target, pose)
    if kind.occluded:
        imaging = replace(imaging, occluders=(_occluder(pixels[valid], rng),))
    surroundings, in_view = _surroundings(camera, target, pose, pixels)
    mask = visible_mask(imaging, camera.image_size)
    height, width = mask.shape
    column, row = np.moveaxis(np.round(surroundings).astype(int), -1, 0)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    clear = mask[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    visible = valid & (in_view & inside & clear).all(axis=-1)
    return EvaluationView(kind.name, pose, imaging, pixels, visible)


def _surroundings(
    camera: SceneCamera, target: Target, pose: np.ndarray, pixels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, k, 2) around each feature that must be in sight, and whether the camera sees them (n, k)."""
    angle = 2 * np.pi * np.arange(24) / 24
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if target.disc_radius is None:
        around = pixels[:, None] + _CORNER_REACH * circle
        return around, camera.unproject(around)[2]
    rings = np.concatenate([circle * target.disc_radius * reach for reach in (0.5, 1.0, _DISC_REACH)])
    points = target.object_points[:, None, :] + np.pad(rings, ((0, 0), (0, 1)))
    return camera.project(points_in_camera(pose, points.reshape(-1, 3)).reshape(points.shape))


def _occluder(pixels: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A convex polygon (6, 2) over about a quarter of the board's image, somewhere on it."""
    middle = pixels[rng.integers(len(pixels))]
    radius = 0.3 * np.sqrt(np.prod(np.ptp(pixels, axis=0)))
    angle = np.sort(2 * np.pi * (np.arange(6) + rng.uniform(-0.3, 0.3, 6)) / 6)
    result: FloatArray = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return result
