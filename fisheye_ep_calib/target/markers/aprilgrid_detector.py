"""Finding Kalibr's AprilGrid: its tags, then every tag corner against the black square that touches it."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.target.corners.contrast import detect_stretched
from fisheye_ep_calib.target.corners.guidance import find_guided
from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.markers.aruco import APRILGRID_BORDER, APRILGRID_DICTIONARY, aruco_dictionary
from fisheye_ep_calib.target.markers.charuco_detector import finish
from fisheye_ep_calib.target.markers.detection import find_markers
from fisheye_ep_calib.target.markers.marker_board import MANY_MARKERS, complete_corners, corners_by_markers
from fisheye_ep_calib.target.sharpness import why_not

# OpenCV's first corner is the tag's bottom right as Kalibr prints it; from there clockwise.
KALIBR_ORDER = np.array([1, 0, 3, 2])
TAG_CELLS = 10


class AprilGridDetector:
    """Tags by cv2.aruco, corners by fitting their picture."""

    def __init__(self, target) -> None:
        self.target = target
        self.dictionary = aruco_dictionary(APRILGRID_DICTIONARY, "an AprilGrid")
        self.points = target.object_points[:, :2]
        self.marker_points = self.points[target.tag_points[:, KALIBR_ORDER]]
        # The quadrants (+, +) and (−, −) hold tag and square at a tag's bottom left and top right corners.
        corner_in_tag = np.zeros(len(self.points), dtype=int)
        corner_in_tag[target.tag_points] = np.arange(4)
        bright = np.where(corner_in_tag % 2 == 0, -1.0, 1.0)
        half = np.full(len(bright), 0.95 * target.tag_gap)
        depth = np.repeat(half[:, None], 2, axis=1)
        border = APRILGRID_BORDER / TAG_CELLS * target.tag_size
        if border < half[0]:
            depth[np.arange(len(bright)), np.where(bright < 0, 0, 1)] = border
        self.around = Surroundings(half, bright, depth, np.full(len(bright), target.tag_gap))

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        return detect_stretched(self._detect, image)

    def _detect(self, image: np.ndarray) -> Detection:
        numbers = self.target.first_tag + np.arange(len(self.marker_points))
        markers = find_markers(image, self.dictionary, APRILGRID_BORDER, numbers, "an AprilGrid")
        if len(markers.place) == 0:
            return Detection(reason=why_not(image, "board not found"), rejected=markers.rejected)
        size = self.target.tag_size
        # Of few tags each has to tell more.
        reach = 0.72 if len(markers.place) >= MANY_MARKERS else 1.6
        start, jacobian, known = corners_by_markers(
            self.marker_points[markers.place], markers.corners, self.points, reach * size
        )
        pixels, found = complete_corners(image, self.points, start, jacobian, known, self.around, size)
        return finish(image, self.points, pixels, found, start[known & ~found], "tag corners")

    def detect_guided(self, image: np.ndarray, camera, camera_from_target: np.ndarray) -> Detection:
        return find_guided(image, camera, camera_from_target, self.target.object_points, self.around)
