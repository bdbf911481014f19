"""What an image shows instead of the target: a board of another kind is named before the recording is blamed."""

from __future__ import annotations

import cv2
import numpy as np

from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.corners.chessboard_detector import any_chessboard
from fisheye_ep_calib.target.detection import check_image
from fisheye_ep_calib.target.discs.blobs import WINDOWS, find_blobs, reduced, usual_factor
from fisheye_ep_calib.target.discs.lattice import grow_lattices
from fisheye_ep_calib.target.discs.lattice_evidence import is_disc_lattice
from fisheye_ep_calib.target.markers.codebook import codebook
from fisheye_ep_calib.target.markers.mismatch import known_markers
from fisheye_ep_calib.target.markers.search import candidate_quads

FEWEST = 12  # corners or discs that are a board
MARKED = ("charuco", "aprilgrid")


def what_else(image: np.ndarray, target: Target) -> str:
    """A board of another kind than the target's in a grey image (h, w) uint8, in words; empty where none is seen."""
    if check_image(image):
        return ""
    if target.kind not in MARKED and (markers := _markers(image)):
        return f"a board with markers of {markers}"
    if target.kind != "chessboard" and len(cells := any_chessboard(image)) >= FEWEST:
        wide, high = sorted((np.ptp(cells, axis=0) + 1).tolist(), reverse=True)
        return f"a chessboard of {wide} × {high} inner corners"
    if target.kind != "circle_grid" and (discs := _discs(image)):
        return f"a grid of {discs} discs"
    return ""


def _markers(image: np.ndarray) -> str:
    if not hasattr(cv2, "aruco"):
        return ""
    smallest = codebook("DICT_4X4_50", 1, "a marker")
    for touching in (False, True):
        if markers := known_markers(image, candidate_quads(image, smallest, touching), (1, 2)):
            return markers
    return ""


def _discs(image: np.ndarray) -> int:
    """How many discs of a grid, dark or light, of any pitch and radius; 0 where there are none."""
    factor = usual_factor(image.shape)
    for picture in (image, cv2.bitwise_not(image)):
        blobs = find_blobs(reduced(picture, factor), WINDOWS, holes=True)
        for lattice in grow_lattices(blobs.center, blobs.shape, None)[:2]:
            chosen = blobs[lattice.blob]
            if len(lattice) >= FEWEST and is_disc_lattice(lattice.cell, chosen.center, chosen.shape, None):
                return len(lattice)
    return 0
