"""For each pixel of a view, the pixel of the fisheye image that shows the same point.

The point is known once its depth is: that of a surface, or a depth image's. It goes through the fisheye's full model,
pupil and all. The moving pupil makes the answer depend on depth, and the less so the further away it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arguments import positive_length
from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.rectification.projections import PROJECTIONS
from fisheye_ep_calib.rectification.view import View

SURFACES = ("plane", "sphere")
UNSEEN = np.float32(-1e4)  # a coordinate outside every image
_PIXELS_AT_ONCE = 16384
_BEYOND_THE_FIELD = 0.4  # rad
_NODES = 5  # of the polynomial in inverse depth: right to 0.02 px with a pupil that moves 10 mm


@dataclass(frozen=True)
class Maps:
    """What cv2.remap takes: x, y (h, w) float32, fisheye pixels; UNSEEN where the fisheye shows nothing."""

    x: np.ndarray
    y: np.ndarray


def surface_maps(camera: FisheyeCamera, view: View, distance: float = np.inf, surface: str | None = None) -> Maps:
    """Maps for points on a surface: the plane z = distance of the view's frame, or the sphere of that radius.

    distance: metres from the camera frame's origin, may be infinite. surface: by default the projection's.
    """
    surface = surface or PROJECTIONS[view.projection].surface
    if surface not in SURFACES:
        raise InputError(f"unknown surface {surface!r}; known: {', '.join(SURFACES)}")
    distance = positive_length(distance, "distance")
    far = np.isinf(distance)
    seen_by = _central(camera) if far else camera

    maps = Maps(np.empty(view.size[::-1], np.float32), np.empty(view.size[::-1], np.float32))
    for rows in _bands(view):
        points = view.points(rows)
        length = points[..., 2] if surface == "plane" else np.linalg.norm(points, axis=-1)
        scale = (1.0 if far else distance) / np.where(length > 0, length, np.nan)
        pixels = _project(seen_by, (scale[..., None] * points) @ view.camera_from_view.T)
        visible = np.isfinite(pixels).all(axis=-1) & (np.abs(pixels) < -UNSEEN).all(axis=-1)
        maps.x[rows], maps.y[rows] = (np.where(visible, pixels[..., axis], UNSEEN) for axis in range(2))
    return maps


class DepthMaps:
    """Maps for a depth image in the view's own geometry, quick enough for a live image.

    Along the ray of a view's pixel, the fisheye's pixel is a smooth function of inverse depth: a polynomial through
    its values at Chebyshev nodes from infinity to the nearest depth, found once for every pixel.
    """

    def __init__(self, camera: FisheyeCamera, view: View, nearest: float) -> None:
        """nearest: metres; nearer points are taken to be there."""
        if not 0 < nearest < np.inf:
            raise InputError(f"`nearest_depth` must be positive, not {nearest:g} m")
        self.nearest = nearest
        node = 0.5 * (1 - np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES))
        to_coefficients = np.linalg.inv(np.vander(node, increasing=True))
        # What is at the edge of the field far away lies beyond it when near: the curve goes on, and ``at`` cuts it.
        self._camera = camera
        camera = replace(camera, theta_max=min(np.pi, camera.theta_max + _BEYOND_THE_FIELD))
        self._coefficients = np.empty((_NODES, 2, *view.size[::-1]), np.float32)
        for rows in _bands(view):
            points = view.points(rows) @ view.camera_from_view.T
            values = np.stack([_project(camera, points * (nearest / part)) for part in node])
            self._coefficients[:, :, rows] = np.moveaxis(np.tensordot(to_coefficients, values, axes=1), -1, 1)

    def at(self, depth: np.ndarray) -> Maps:
        """Maps for depths (h, w), metres: z for a perspective view, the distance from its viewpoint for the others.

        Depths that are not positive, NaN for one, leave their pixels UNSEEN; infinity is a depth.
        """
        depth = np.asarray(depth, dtype=np.float32)
        height, width = self._coefficients.shape[2:]
        if depth.shape != (height, width):
            raise InputError(f"the depth image has the shape {depth.shape}, the view {height} rows of {width}")
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.minimum(np.float32(self.nearest) / np.where(depth > 0, depth, np.nan), np.float32(1))
        x, y = (self._coefficients[-1, axis] for axis in range(2))
        for number in range(_NODES - 2, -1, -1):
            x = x * part + self._coefficients[number, 0]
            y = y * part + self._coefficients[number, 1]
        inside = np.isfinite(x) & self._in_field(x, y)
        return Maps(np.where(inside, x, UNSEEN), np.where(inside, y, UNSEEN))

    def _in_field(self, x: np.ndarray, y: np.ndarray) -> BoolArray:
        """Whether pixels lie within the image of theta_limit; its edge is taken to be an ellipse."""
        camera = self._camera
        edge = float(camera.radius(camera.theta_limit))
        across, down = (np.float32(edge * focal) for focal in (camera.fx, camera.fy))
        result: BoolArray = ((x - np.float32(camera.cx)) / across) ** 2 + ((y - np.float32(camera.cy)) / down) ** 2 <= 1
        return result


def _central(camera: FisheyeCamera) -> FisheyeCamera:
    """The camera for points at infinity, where a pupil shift has no effect."""
    return replace(camera, model=CENTRAL_MODEL, coefficients=())


def _project(camera: FisheyeCamera, points: np.ndarray) -> np.ndarray:
    """Fisheye pixels (..., 2) of points (..., 3) in the camera frame; NaN where there are none."""
    finite = np.isfinite(points).all(axis=-1)
    pixels, valid = camera.project(np.where(finite[..., None], points, (0.0, 0.0, 1.0)))
    return np.where((finite & valid)[..., None], pixels, np.nan)


def _bands(view: View) -> Iterator[slice]:
    """Rows of a view, few enough at once to stay in the processor's cache."""
    width, height = view.size
    step = max(1, _PIXELS_AT_ONCE // width)
    for first in range(0, height, step):
        yield slice(first, min(first + step, height))
