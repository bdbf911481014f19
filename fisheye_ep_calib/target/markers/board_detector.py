"""Finding a board of markers: which markers, how they lie, then every corner that they name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.corners.contrast import detect_stretched
from fisheye_ep_calib.target.corners.guidance import find_guided
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.markers.arrangement import Reading, arrange
from fisheye_ep_calib.target.markers.codebook import Codebook
from fisheye_ep_calib.target.markers.marker_board import MANY_MARKERS, complete_corners, corners_by_markers
from fisheye_ep_calib.target.markers.mismatch import MIRRORED, read_in_a_mirror, why_no_board
from fisheye_ep_calib.target.markers.search import Markers, find_markers
from fisheye_ep_calib.target.sharpness import why_not

FEWEST_CORNERS = 6  # of a view
FEW_MARKERS = 6  # that may be those of another board in a mirror
MORE_CORNERS = 2  # than the file as it is, for another reading that as many markers agree with
MOSTLY_FOUND = 0.97  # of the points of the first look, or of all: the reading is the right one


class MarkerBoardDetector:
    """Markers by their cells, corners by fitting their picture.

    points (n, 3): metres. readings: ways to read the target's file, as it is first. numbers (k,): of its markers in the
    dictionary, rising. touching: whether black squares touch the markers' corners. step: the largest distance of
    neighbouring features. reach: how far a marker's own homography is believed, for many markers and for few, metres.
    """

    def __init__(
        self,
        points: np.ndarray,
        readings: Sequence[Reading],
        book: Codebook,
        numbers: np.ndarray,
        touching: bool,
        step: float,
        reach: tuple[float, float],
    ) -> None:
        self.points, self.readings, self.book, self.numbers = points, readings, book, numbers
        self.touching, self.step, self.reach = touching, step, reach

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        detection = detect_stretched(self._detect, image)
        return detection if len(detection) else replace(detection, reason=why_not(image, detection.reason))

    def _detect(self, image: np.ndarray) -> Detection:
        markers = find_markers(image, self.book, self.numbers, self.touching)
        board = markers[np.isin(markers.number, self.numbers)]
        place = np.searchsorted(self.numbers, board.number)
        arrangement = arrange(place, board.corners, self.readings)
        reading = arrangement.reading
        reason = reading.fault if reading else why_no_board(image, markers, self.numbers, self.book, self.touching)
        # Some markers of a small dictionary are others in a mirror, and some of these may happen to lie as they should.
        if 0 < len(board) < FEW_MARKERS and read_in_a_mirror(image, markers.candidates, self.book) > 2 * len(board):
            reason = MIRRORED
        if reading is None or reason:
            return Detection(reason=reason, rejected=np.vstack([markers.rejected, markers.corners.mean(axis=1)]))
        chosen = arrangement.chosen
        detection = self._measure(image, board[chosen], place[chosen], reading)
        for other, also in arrangement.alike:
            measured = self._measure(image, board[also], place[also], other)
            if len(measured) >= len(detection) + MORE_CORNERS:
                detection, reading = measured, other
        remarks = [reading.remark] if reading.remark else []
        if arrangement.others:
            remarks.append("another board with the same markers is in view; the more complete one was taken")
        return replace(detection, remark="; ".join(remarks)) if len(detection) else detection

    def detect_guided(
        self,
        image: np.ndarray,
        camera: FisheyeCamera,
        camera_from_target: np.ndarray,
        first: Detection | None = None,
    ) -> Detection:
        """Which reading the first look used is not known here: the next one is tried where one finds little."""
        enough = MOSTLY_FOUND * (len(self.points) if first is None else len(first))
        best: Detection | None = None
        for around in {id(reading.around): reading.around for reading in self.readings if not reading.fault}.values():
            found = find_guided(image, camera, camera_from_target, self.points, around, first)
            best = found if best is None or len(found) >= len(best) + MORE_CORNERS else best
            if len(best) >= enough:
                break
        assert best is not None  # the file as it is has no fault
        return best

    def _measure(self, image: np.ndarray, board: Markers, place: np.ndarray, reading: Reading) -> Detection:
        points, around = self.points[:, :2], reading.around
        if board.negative:
            around = replace(around, bright=-around.bright)
        # Of few markers each has to tell more.
        reach = self.reach[0] if len(board) >= MANY_MARKERS else self.reach[1]
        start, jacobian, defined = corners_by_markers(reading.marker_points[place], board.corners, points, reach)
        pixels, confirmed = complete_corners(image, points, start, jacobian, defined, around, self.step)
        missed = start[defined & ~confirmed]
        if confirmed.sum() < min(FEWEST_CORNERS, len(points)):
            reason = f"{int(confirmed.sum())} of {len(points)} corners" if confirmed.any() else "board not found"
            return Detection(reason=reason, rejected=np.vstack([missed, pixels[confirmed]]))
        return Detection(np.flatnonzero(confirmed), pixels[confirmed], rejected=missed)
