"""What others find of a target in an image: an adapter each, from the image (h, w) uint8 to ``Found``.

A finder is made for a target; making it raises ImportError where its library is not installed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.target import Target

Finder = Callable[[np.ndarray], "Found"]
REFINED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
WINDOW = (5, 5)  # half of cornerSubPix's, pixels


@dataclass(frozen=True)
class Found:
    """pixels (k, 2), and names (k,) of the target's points, or None where the lattice alone tells no name."""

    pixels: np.ndarray
    names: np.ndarray | None = None


NOTHING = Found(np.empty((0, 2)))


def this_package(target: Target) -> Finder:
    detector = target.detector()
    named = target.kind in ("charuco", "aprilgrid")

    def find(image: np.ndarray) -> Found:
        seen = detector.detect(image)
        return Found(seen.pixels, seen.point_index if named else None)

    return find


def circles_grid(clustering: bool, large: bool = False) -> Callable[[Target], Finder]:
    """cv2.findCirclesGrid, either way round as camera_calibration asks it.

    large: blobs of any size, where OpenCV's own are of 25 to 5,000 px².
    """

    def of(target: Target) -> Finder:
        flags = cv2.CALIB_CB_SYMMETRIC_GRID | (cv2.CALIB_CB_CLUSTERING if clustering else 0)
        parameters = cv2.SimpleBlobDetector_Params()
        if large:
            parameters.minArea, parameters.maxArea = 12.0, 1e5
        blobs = cv2.SimpleBlobDetector_create(parameters)

        def find(image: np.ndarray) -> Found:
            for size in ((target.columns, target.rows), (target.rows, target.columns)):
                whole, centres = cv2.findCirclesGrid(image, size, flags=flags, blobDetector=blobs)
                if whole:
                    return Found(centres.reshape(-1, 2))
            return NOTHING

        return find

    return of


def opencv_chessboard(target: Target) -> Finder:
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE

    def find(image: np.ndarray) -> Found:
        whole, corners = cv2.findChessboardCorners(image, (target.columns, target.rows), flags=flags)
        return Found(sub_pixel(image, corners)) if whole else NOTHING

    return find


def opencv_chessboard_sb(flags: int = 0, part: bool = False) -> Callable[[Target], Finder]:
    """cv2.findChessboardCornersSB; part: at least half as many corners each way, and what hangs together with them."""

    def of(target: Target) -> Finder:
        size = target.columns, target.rows
        if part:
            size = max(3, target.columns // 2), max(3, target.rows // 2)

        def find(image: np.ndarray) -> Found:
            found, corners, _ = cv2.findChessboardCornersSBWithMeta(
                image, size, flags | (cv2.CALIB_CB_LARGER if part else 0)
            )
            return Found(corners.reshape(-1, 2)) if found else NOTHING

        return find

    return of


def calib_targets_chessboard(refined: bool) -> Callable[[Target], Finder]:
    def of(target: Target) -> Finder:
        import calib_targets as library

        def find(image: np.ndarray) -> Found:
            board = library.detect_chessboard(np.ascontiguousarray(image))
            if board is None:
                return NOTHING
            corners = np.array([corner.position for corner in board.corners], dtype=np.float32)
            return Found(sub_pixel(image, corners) if refined else corners)

        return find

    return of


def calib_targets_charuco(target: Target) -> Finder:
    import calib_targets as library

    board = library.CharucoBoardSpec(
        target.rows + 1, target.columns + 1, target.spacing, target.marker_size / target.spacing, target.dictionary
    )
    parameters = library.CharucoParams(board)

    def find(image: np.ndarray) -> Found:
        try:
            corners = library.detect_charuco(np.ascontiguousarray(image), params=parameters).corners
        except RuntimeError:  # so it says that there is none
            return NOTHING
        pixels = np.array([corner.position for corner in corners]).reshape(-1, 2)
        return Found(pixels, np.array([corner.id for corner in corners], dtype=int))

    return find


def opencv_charuco(tuned: bool) -> Callable[[Target], Finder]:
    """cv2.aruco.CharucoDetector as it comes; tuned: larger threshold windows, one marker a corner, refined markers."""

    def of(target: Target) -> Finder:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
        size = (target.columns + 1, target.rows + 1)
        board = cv2.aruco.CharucoBoard(size, target.spacing, target.marker_size, dictionary)
        charuco, markers = cv2.aruco.CharucoParameters(), cv2.aruco.DetectorParameters()
        if tuned:
            charuco.minMarkers, charuco.checkMarkers = 1, False
            markers.adaptiveThreshWinSizeMax = 63
            markers.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        detector = cv2.aruco.CharucoDetector(board, charuco, markers)

        def find(image: np.ndarray) -> Found:
            corners, names, _, _ = detector.detectBoard(image)
            return NOTHING if names is None else Found(corners.reshape(-1, 2), names.ravel())

        return find

    return of


def pypi_aprilgrid(target: Target) -> Finder:
    from aprilgrid import Detector

    detector = Detector("t36h11")

    def find(image: np.ndarray) -> Found:
        tags = [tag for tag in detector.detect(image) if tag.tag_id < len(target.tag_points)]
        if not tags:
            return NOTHING
        pixels = np.concatenate([np.asarray(tag.corners).reshape(4, 2) for tag in tags])
        return Found(pixels, np.concatenate([target.tag_points[tag.tag_id] for tag in tags]))

    return find


def sub_pixel(image: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(k, 2) after cv2.cornerSubPix."""
    return cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), WINDOW, (-1, -1), REFINED).reshape(-1, 2)


FINDERS: dict[str, dict[str, Callable[[Target], Finder]]] = {
    "circle_grid": {
        "this": this_package,
        "findCirclesGrid": circles_grid(clustering=False),
        "findCirclesGrid, blobs of any size": circles_grid(clustering=False, large=True),
        "findCirclesGrid, clustering": circles_grid(clustering=True),
        "findCirclesGrid, clustering, blobs of any size": circles_grid(clustering=True, large=True),
    },
    "chessboard": {
        "this": this_package,
        "findChessboardCorners, cornerSubPix": opencv_chessboard,
        "findChessboardCornersSB": opencv_chessboard_sb(),
        "findChessboardCornersSB, exhaustive, accurate": opencv_chessboard_sb(
            cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
        ),
        "findChessboardCornersSB, a part": opencv_chessboard_sb(part=True),
        "calib-targets": calib_targets_chessboard(refined=False),
        "calib-targets, cornerSubPix": calib_targets_chessboard(refined=True),
    },
    "charuco": {
        "this": this_package,
        "CharucoDetector": opencv_charuco(tuned=False),
        "CharucoDetector, tuned": opencv_charuco(tuned=True),
        "calib-targets": calib_targets_charuco,
    },
    "aprilgrid": {"this": this_package, "aprilgrid": pypi_aprilgrid},
}
