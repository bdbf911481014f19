"""The rectified image: a virtual camera with one viewpoint, at the origin of the fisheye's frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral

import numpy as np

from fisheye_ep_calib.arguments import real_argument
from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.camera_info import PlainCameraInfo, pinhole_camera_info, uncalibrated_camera_info
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.rectification.projections import PROJECTIONS, Projection

LONGEST_SIDE = 16384  # pixels; cv2.remap ends at 32767


@dataclass(frozen=True)
class View:
    """projection: a key of PROJECTIONS. size: (width, height). focal: pixels per unit of the image plane.

    yaw, pitch: rad, where its axis points in the fisheye's frame: yaw to the right, then pitch upwards.
    The principal point is the middle of the image; (0, 0) is the centre of the top-left pixel.
    """

    projection: str
    size: tuple[int, int]
    focal: float
    yaw: float = 0.0
    pitch: float = 0.0

    def __post_init__(self) -> None:
        if self.projection not in PROJECTIONS:
            raise InputError(f"unknown projection {self.projection!r}; known: {', '.join(PROJECTIONS)}")
        if not all(1 <= side <= LONGEST_SIDE for side in self.size):
            raise InputError(
                f"`size` {self.size[0]}×{self.size[1]}: each side of the image must lie in 1..{LONGEST_SIDE} pixels"
            )
        if not (0 < self.focal < np.inf and np.isfinite([self.yaw, self.pitch]).all()):
            raise InputError("a view needs a positive focal length and finite angles")

    @property
    def centre(self) -> tuple[float, float]:
        return (self.size[0] - 1) / 2, (self.size[1] - 1) / 2

    @property
    def camera_from_view(self) -> FloatArray:
        """Rotation (3, 3): R_y(yaw) R_x(pitch)."""
        sine, cosine = np.sin(self.yaw), np.cos(self.yaw)
        turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        sine, cosine = np.sin(self.pitch), np.cos(self.pitch)
        result: FloatArray = turn @ np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
        return result

    def points(self, rows: slice = slice(None)) -> np.ndarray:
        """The points (rows, width, 3) in the view's frame at depth 1, one a pixel; NaN where nothing is seen."""
        column = (np.arange(self.size[0]) - self.centre[0]) / self.focal
        row = (np.arange(self.size[1])[rows] - self.centre[1]) / self.focal
        return PROJECTIONS[self.projection].points(column, row[:, None])

    def project(self, points_in_camera: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3) in the fisheye's frame; NaN where they have none."""
        x, y = PROJECTIONS[self.projection].plane(np.asarray(points_in_camera, dtype=float) @ self.camera_from_view)
        return np.stack([self.centre[0] + self.focal * x, self.centre[1] + self.focal * y], axis=-1)


def rectified_camera_info(view: View) -> PlainCameraInfo:
    """CameraInfo of a rectified image: a pinhole's for a perspective view; for others the projection's name alone."""
    if not PROJECTIONS[view.projection].pinhole:
        return uncalibrated_camera_info(view.size, view.projection)
    return pinhole_camera_info(view.size, view.focal, view.centre)


def make_view(
    camera: FisheyeCamera,
    projection: str = "perspective",
    fov: float | None = None,
    size: tuple[int, int] | None = None,
    yaw: float = 0.0,
    pitch: float = 0.0,
) -> View:
    """A view of a camera. fov: horizontal, rad; by default what the camera sees, of a perspective view at most 100°.

    size: by default such that the middle of the image keeps the fisheye's resolution, with the fisheye's
    proportions for a perspective view and ±45° (cylindrical) or ±60° (equirectangular) in height for the others.
    Raises InputError.
    """
    if projection not in PROJECTIONS:
        raise InputError(f"unknown projection {projection!r}; known: {', '.join(PROJECTIONS)}")
    kind = PROJECTIONS[projection]
    fov = min(field_of_view(camera), kind.usual_fov) if fov is None else real_argument(fov, "fov")
    if not 0 < fov <= kind.largest_fov + 1e-9:
        raise InputError(
            f"`fov` of a {projection} view must lie above 0° and up to {np.degrees(kind.largest_fov):.0f}°, "
            f"not at {np.degrees(fov):g}°"
        )
    half = kind.half_extent(fov / 2)
    if size is None:
        size = _usual_size(camera, kind, half)
    size = _checked_size(size)
    yaw, pitch = real_argument(yaw, "yaw"), real_argument(pitch, "pitch")
    return View(projection, size, size[0] / (2 * half), yaw, pitch)


def _checked_size(size: object) -> tuple[int, int]:
    """Width and height. Raises InputError."""
    if not isinstance(size, Sequence | np.ndarray) or len(size) != 2 or not all(isinstance(n, Integral) for n in size):
        raise InputError(f"`size` must be width and height in pixels, not {shown(size)}")
    return int(size[0]), int(size[1])


def field_of_view(camera: FisheyeCamera) -> float:
    """The horizontal field of view, rad, symmetric about the axis: twice what the nearer edge of the image shows."""
    width, _ = camera.image_size
    edges = np.array([[0.0, camera.cy], [width - 1.0, camera.cy]])
    _, directions, valid = camera.unproject(edges)
    angles = np.arccos(np.clip(directions[:, 2], -1, 1))
    return 2 * float(np.where(valid, angles, camera.theta_limit).min())


def _usual_size(camera: FisheyeCamera, kind: Projection, half: float) -> tuple[int, int]:
    """Width and height, even, no side longer than the longest allowed."""
    focal = camera.fx * _axis_slope(camera)
    half_height = kind.half_height(half, camera.image_size[1] / camera.image_size[0])
    focal = min(focal, LONGEST_SIDE / (2 * max(half, half_height)))
    width, height = (max(2, 2 * round(focal * extent)) for extent in (half, half_height))
    return min(width, LONGEST_SIDE), min(height, LONGEST_SIDE)


def _axis_slope(camera: FisheyeCamera) -> float:
    """r′(0): 1 for Kannala–Brandt."""
    return float(camera.lens_model.radius_derivative(np.array(0.0), camera.radial_array))
