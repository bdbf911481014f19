"""Rectifies images: maps made once for each distance, then cv2.remap."""

from __future__ import annotations

import threading
from collections import OrderedDict

import cv2
import numpy as np

from fisheye_ep_calib.arguments import positive_length
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.rectification.maps import DepthMaps, Maps, surface_maps
from fisheye_ep_calib.rectification.projections import PROJECTIONS
from fisheye_ep_calib.rectification.view import View, make_view

NEAREST_DEPTH = 0.05  # metres
_DISTANCES_KEPT = 4
INTERPOLATIONS = {"nearest": cv2.INTER_NEAREST, "linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}


class Rectifier:
    """One camera and one view. May be used from several threads."""

    def __init__(
        self,
        camera: FisheyeCamera,
        view: View,
        surface: str | None = None,
        interpolation: str = "linear",
        nearest_depth: float = NEAREST_DEPTH,
    ) -> None:
        """surface: "plane" or "sphere", by default what suits the projection. nearest_depth: metres."""
        if interpolation not in INTERPOLATIONS:
            raise InputError(f"unknown interpolation {interpolation!r}; known: {', '.join(INTERPOLATIONS)}")
        self.camera = camera
        self.view = view
        self.surface = surface or PROJECTIONS[view.projection].surface
        self._interpolation = INTERPOLATIONS[interpolation]
        self._nearest_depth = nearest_depth
        self._maps: OrderedDict[float, Maps] = OrderedDict()
        self._depth_maps: DepthMaps | None = None
        self._lock = threading.Lock()

    def rectify(self, image: np.ndarray, distance: float = np.inf, depth: np.ndarray | None = None) -> np.ndarray:
        """The view of a fisheye image (h, w) or (h, w, channels); black where nothing is seen.

        distance: metres, of the surface. depth: a depth image in the view's geometry, metres, of its size or
        scaled to it; where it has no depth, the distance holds. Raises InputError.
        """
        width, height = self.camera.image_size
        if image.ndim not in (2, 3):
            raise InputError(f"an image is (h, w) or (h, w, channels), not of the shape {image.shape}")
        if image.shape[:2] != (height, width):
            raise InputError(f"the image is {image.shape[1]}×{image.shape[0]}, the camera {width}×{height}")
        maps = self.maps(distance) if depth is None else self.maps_of_depth(depth, distance)
        return cv2.remap(image, maps.x, maps.y, self._interpolation, borderMode=cv2.BORDER_CONSTANT, borderValue=0)

    def maps(self, distance: float) -> Maps:
        """The maps for a distance, metres; those of the last few are kept."""
        distance = float(distance)
        with self._lock:
            if distance not in self._maps:
                self._maps[distance] = surface_maps(self.camera, self.view, distance, self.surface)
                while len(self._maps) > _DISTANCES_KEPT:
                    self._maps.popitem(last=False)
            self._maps.move_to_end(distance)
            return self._maps[distance]

    def maps_of_depth(self, depth: np.ndarray, distance: float = np.inf) -> Maps:
        """The maps for a depth image (any h, w), metres; those of ``distance`` where it has no depth."""
        if depth.ndim != 2 or depth.size == 0:
            raise InputError(f"a depth image has rows and columns, not the shape {depth.shape}")
        with self._lock:
            if self._depth_maps is None:
                self._depth_maps = DepthMaps(self.camera, self.view, self._nearest_depth)
        if depth.shape != self.view.size[::-1]:
            depth = cv2.resize(depth.astype(np.float32, copy=False), self.view.size, interpolation=cv2.INTER_NEAREST)
        maps, elsewhere = self._depth_maps.at(depth), self.maps(distance)
        measured = depth > 0
        return Maps(np.where(measured, maps.x, elsewhere.x), np.where(measured, maps.y, elsewhere.y))


def rectify(
    camera: FisheyeCamera,
    image: np.ndarray,
    distance: float = np.inf,
    *,
    projection: str = "perspective",
    fov: float | None = None,
    size: tuple[int, int] | None = None,
    yaw: float = 0.0,
    pitch: float = 0.0,
    surface: str | None = None,
    interpolation: str = "cubic",
) -> np.ndarray:
    """One fisheye image as a camera with a single viewpoint sees it, right at a distance.

    For many images make one ``Rectifier``.

    Args:
        camera: That took the image.
        image: (h, w) or (h, w, channels).
        distance: Metres, of the surface that is right.
        projection: "perspective", "cylindrical" or "equirectangular".
        fov: Horizontal field of view, rad; None for the camera's.
        size: (width, height), pixels; None keeps the resolution.
        yaw: Look to the right, rad.
        pitch: Look up, rad.
        surface: What is there, "plane" across the view's axis or "sphere"; None for what suits the projection.
        interpolation: "nearest", "linear" or "cubic".

    Returns:
        The image.

    Raises:
        InputError: An argument cannot be used.
    """
    if not isinstance(camera, FisheyeCamera):
        raise InputError(f"`camera` must be a camera, as `load_camera` gives one, not {shown(camera)}")
    distance = positive_length(distance, "distance")
    view = make_view(camera, projection, fov, size, yaw, pitch)
    return Rectifier(camera, view, surface, interpolation).rectify(np.asarray(image), distance)
