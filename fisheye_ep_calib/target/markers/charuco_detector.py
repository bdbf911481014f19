"""Finding a ChArUco board: markers say where its corners are."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.corners.contrast import detect_stretched
from fisheye_ep_calib.target.corners.guidance import find_guided
from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.markers.aruco import aruco_dictionary
from fisheye_ep_calib.target.markers.detection import find_markers
from fisheye_ep_calib.target.markers.marker_board import MANY_MARKERS, complete_corners, corners_by_markers
from fisheye_ep_calib.target.sharpness import why_not

FEWEST_CORNERS = 6
UNIT = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


class CharucoDetector:
    """Markers by cv2.aruco, corners by fitting their picture beside the markers."""

    def __init__(self, target) -> None:
        self.target = target
        self.dictionary = aruco_dictionary(target.dictionary, "a ChArUco board")
        self.points = target.object_points[:, :2]
        self.marker_points = target.tag_corners[:, None] + target.marker_size * UNIT
        parity = np.rint(self.points / target.spacing).astype(int).sum(axis=1) % 2
        # The square down and right of corner (column, row) is black where column + row is even, unless white is first.
        bright = np.where((parity == 0) != target.white_first, -1.0, 1.0)
        half = np.full(len(bright), 0.5 * target.spacing)
        depth = np.repeat(half[:, None], 2, axis=1)
        depth[np.arange(len(bright)), np.where(bright > 0, 0, 1)] = (target.spacing - target.marker_size) / 2
        self.around = Surroundings(half, bright, depth, 2 * half)

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        return detect_stretched(self._detect, image)

    def _detect(self, image: np.ndarray) -> Detection:
        markers = find_markers(image, self.dictionary, 1, np.arange(len(self.marker_points)), "a ChArUco board")
        if len(markers.place) == 0:
            return Detection(reason=why_not(image, "board not found"), rejected=markers.rejected)
        # Of few markers each has to tell more.
        reach = 0.8 if len(markers.place) >= MANY_MARKERS else 1.7
        start, jacobian, known = corners_by_markers(
            self.marker_points[markers.place], markers.corners, self.points, reach * self.target.spacing
        )
        pixels, found = complete_corners(image, self.points, start, jacobian, known, self.around, self.target.spacing)
        return finish(image, self.points, pixels, found, start[known & ~found], "corners")

    def detect_guided(self, image: np.ndarray, camera, camera_from_target: np.ndarray) -> Detection:
        return find_guided(image, camera, camera_from_target, self.target.object_points, self.around)


def finish(
    image: np.ndarray, points: np.ndarray, pixels: np.ndarray, found: np.ndarray, missed: np.ndarray, what: str
) -> Detection:
    """The detection of a board of markers from its measured corners, or why there is none."""
    if found.sum() < min(FEWEST_CORNERS, len(points)):
        reason = f"{int(found.sum())} of {len(points)} {what}" if found.any() else "board not found"
        return Detection(reason=why_not(image, reason), rejected=np.vstack([missed, pixels[found]]))
    return Detection(np.flatnonzero(found), pixels[found], rejected=missed)
