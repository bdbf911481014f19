"""The single-viewpoint stand-in: what a consumer of plain CameraInfo gets, and what it loses by distance.

It is the Kannala–Brandt camera without skew that comes nearest, over the image, to the full camera for points at
one distance; at infinity a pupil shift has no effect.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import SAME_PIXEL, points_on_rays
from fisheye_ep_calib.calibration.assessing.nearest_camera import nearest_camera
from fisheye_ep_calib.camera import FAR, LENS_EXTRAS, LENSES, FisheyeCamera
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.errors import CalibrationError

LOSS_DISTANCES = (0.1, 0.3, 1.0, 10.0)  # metres
_GRID = 25  # pixels a side at which the two cameras are compared
_LEAST_POINTS = 0.5  # of the grid's pixels that have a ray
_NOT_PINHOLE = 1e-12  # consumers read D = 0 as "no distortion at all", a pinhole


@dataclass(frozen=True)
class StandIn:
    """camera: central, no skew, no extras. distance: metres, for which it was fitted.

    loss_px: RMS pixel error of the stand-in over the image, by distance in metres.
    """

    camera: FisheyeCamera
    distance: float
    loss_px: dict[float, float]


def single_viewpoint(
    camera: FisheyeCamera, distance: float = np.inf, lens: str = "kannala_brandt", extras: Iterable[str] = ()
) -> StandIn:
    """Fit the stand-in for points at a distance (metres, may be infinite) from the camera frame's origin.

    lens, extras: what the consumer knows; CameraInfo's has a Kannala–Brandt lens and no extras.
    """
    pixels, points = points_over_image(camera, distance)
    if len(points) < _LEAST_POINTS * len(points_over_image(camera, np.inf)[0]):
        raise CalibrationError(
            f"the camera sees hardly a point at {distance:g} m, nearer than its entrance pupil moves: "
            "choose a larger `svp_distance`"
        )
    start = FisheyeCamera(
        camera.image_size,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        radial=camera.radial if camera.lens == lens else LENSES[lens].start_coefficients,
        lens=lens,
        extras={name: camera.extras.get(name, (0.0,) * len(LENS_EXTRAS[name].coefficient_names)) for name in extras},
    )
    best = nearest_camera(start, ("skew",), points, pixels)
    if not any(best.radial):
        best = best.with_parameters(np.where(np.array(best.parameter_names) == "k1", _NOT_PINHOLE, best.parameters))
    return StandIn(best, float(distance), loss_px(camera, best))


def loss_px(
    camera: FisheyeCamera, other: FisheyeCamera, distances: Iterable[float] = LOSS_DISTANCES
) -> dict[float, float]:
    """RMS over the image, px, of another camera in a camera's place, by distance in metres; NaN where none is seen."""
    losses = {}
    for distance in distances:
        pixels, points = points_over_image(camera, distance)
        placed = FAR * points if np.isinf(distance) else points
        square = ((_project(other, placed) - pixels) ** 2).sum(axis=-1)
        losses[distance] = float(np.sqrt(square.mean())) if len(square) else float("nan")
    return losses


def _project(camera: FisheyeCamera, points: np.ndarray) -> np.ndarray:
    return camera.project(points)[0]


def _field(camera: FisheyeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest pixel (2,) of the part of the image within theta_max, which may be small."""
    azimuth = np.radians(np.arange(0, 360, 5))
    pixels = _project(camera, FAR * direction(0.999 * camera.theta_limit, azimuth))
    last = np.array(camera.image_size) - 1.0
    return np.clip(pixels.min(axis=0), 0, last), np.clip(pixels.max(axis=0), 0, last)


def points_over_image(camera: FisheyeCamera, distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) over the image and the points (n, 3) seen there at a distance from the origin, metres.

    At infinity the points are unit directions, projected by a central camera alone.
    """
    low, high = _field(camera)
    u, v = np.meshgrid(np.linspace(low[0], high[0], _GRID), np.linspace(low[1], high[1], _GRID))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    origins, directions, valid = camera.unproject(pixels)
    if np.isinf(distance):
        return pixels[valid], directions[valid]
    points, reached = points_on_rays(origins, directions, np.asarray(distance))
    # Very near, several rays may pass through a point.
    back, projected = camera.project(points)
    with np.errstate(invalid="ignore"):
        valid &= reached & projected & (np.abs(back - pixels).max(axis=-1) < SAME_PIXEL)
    return pixels[valid], points[valid]
