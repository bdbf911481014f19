"""Finding a chessboard, whole or in part."""

from __future__ import annotations

import functools
import logging

import cv2
import numpy as np

from fisheye_ep_calib.target.corner_guidance import find_guided
from fisheye_ep_calib.target.corner_refinement import refine_corners
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.labelling import label_patch

logger = logging.getLogger(__name__)

FEWEST_CORNERS = 8


@functools.cache
def _calib_targets():
    """The library that finds partial boards, or None, said once."""
    try:
        import calib_targets
    except ImportError:
        logger.warning(
            "calib-targets is not installed: only chessboards wholly in view can be found"
            " (pip install calib-targets)"
        )
        return None
    return calib_targets


class ChessboardDetector:
    """Corners by calib-targets (partial boards) or OpenCV (whole boards), refined to sub-pixels, then
    labelled.
    """

    def __init__(self, target) -> None:
        self.target = target
        self.lattice = np.rint(target.object_points[:, :2] / [target.spacing, target.row_spacing]).astype(int)

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        cells, pixels = self._find(image)
        if len(cells) == 0:
            return Detection(reason="board not found")
        reach = 0.3 * _local_pitch(cells, pixels)
        refined, good = refine_corners(image, pixels, reach)
        good &= _regular(cells, refined)
        rejected = pixels[~good]
        cells, refined = cells[good], refined[good]
        total = len(self.lattice)
        if len(cells) < min(FEWEST_CORNERS, total):
            return Detection(
                reason=f"{len(cells)} of {total} corners", rejected=np.vstack([rejected, refined])
            )
        black = _black_cell(image, cells, refined)
        labels = label_patch(
            cells,
            refined,
            self.lattice,
            allowed=lambda placement: _colour_fits(placement, black),
            is_plain=lambda sites, scale: _is_plain(image, sites, scale),
        )
        known = labels.known
        if known.sum() < min(FEWEST_CORNERS, total):
            return Detection(reason="board not found", rejected=refined)
        return Detection(
            labels.point_index[known], refined[known], rejected=np.vstack([rejected, refined[~known]])
        )

    def detect_guided(self, image: np.ndarray, camera, camera_from_target: np.ndarray) -> Detection:
        target = self.target
        clear = np.full(len(target.object_points), 0.5 * min(target.spacing, target.row_spacing))
        # The square down and right of corner (column, row) is black where column + row is even.
        bright = np.where(self.lattice.sum(axis=1) % 2 == 0, -1.0, 1.0)
        return find_guided(image, camera, camera_from_target, target.object_points, clear, bright)

    def _find(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lattice coordinates (k, 2) int with the handedness of (u, v), and rough pixels (k, 2)."""
        library = _calib_targets()
        if library is None:
            return self._find_whole(image)
        found = library.detect_chessboard(image)
        if found is None or len(found.corners) < 4:
            return np.empty((0, 2), dtype=int), np.empty((0, 2))
        cells = np.array([(corner.grid.u, corner.grid.v) for corner in found.corners])
        pixels = np.array([corner.position for corner in found.corners], dtype=float)
        return _right_handed(cells, pixels), pixels

    def _find_whole(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        size = (self.target.columns, self.target.rows)
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE + cv2.CALIB_CB_FAST_CHECK
        if min(size) < 3 or min(image.shape) < 20:
            return np.empty((0, 2), dtype=int), np.empty((0, 2))
        found, corners = cv2.findChessboardCorners(image, size, flags=flags)
        if not found:
            return np.empty((0, 2), dtype=int), np.empty((0, 2))
        pixels = corners.reshape(-1, 2).astype(float)
        return _right_handed(self.lattice, pixels), pixels


def _right_handed(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The cells, mirrored where their axes turn the other way than u and v do."""
    design = np.column_stack([cells, np.ones(len(cells))])
    axes = np.linalg.lstsq(design, pixels, rcond=None)[0][:2]
    return cells if np.linalg.det(axes) > 0 else cells * [1, -1]


def _neighbours(cells: np.ndarray) -> np.ndarray:
    """Index (k, 4) of each cell's neighbours at +x, −x, +y, −y; −1 where there is none."""
    low = cells.min(axis=0) - 1
    table = np.full(cells.max(axis=0) - low + 2, -1)
    table[tuple((cells - low).T)] = np.arange(len(cells))
    steps = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    return np.stack([table[tuple((cells - low + step).T)] for step in steps], axis=1)


def _local_pitch(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Smallest distance (k,) to a lattice neighbour, pixels."""
    beside = _neighbours(cells)
    distance = np.hypot(*np.moveaxis(pixels[beside] - pixels[:, None], -1, 0))
    distance[beside < 0] = np.inf
    nearest = distance.min(axis=1)
    return np.where(np.isfinite(nearest), nearest, 10.0)


def _regular(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Whether each corner lies midway between its two neighbours on some line, as a smooth lens leaves it."""
    beside = _neighbours(cells)
    bad_votes = np.zeros(len(cells))
    for first, second in ((0, 1), (2, 3)):
        both = np.flatnonzero((beside[:, first] >= 0) & (beside[:, second] >= 0))
        ahead, behind = pixels[beside[both, first]], pixels[beside[both, second]]
        bend = np.hypot(*(ahead + behind - 2 * pixels[both]).T)
        span = np.hypot(*(ahead - behind).T)
        bad_votes[both[bend > 0.3 * span]] += 1
    return (bad_votes == 0) & (beside >= 0).any(axis=1)


def _black_cell(image: np.ndarray, cells: np.ndarray, pixels: np.ndarray) -> np.ndarray | None:
    """Twice the lattice coordinates (2,) of a black square's centre; None when no square is whole."""
    beside = _neighbours(cells)
    right, down = beside[:, 0], beside[:, 2]
    corner = np.where((right >= 0) & (down >= 0), beside[right, 2], -1)
    whole = np.flatnonzero(corner >= 0)
    if len(whole) == 0:
        return None
    centre = (pixels[whole] + pixels[right[whole]] + pixels[down[whole]] + pixels[corner[whole]]) / 4
    column, row = np.rint(centre).astype(int).T
    smooth = cv2.blur(image, (3, 3))
    value = smooth[np.clip(row, 0, image.shape[0] - 1), np.clip(column, 0, image.shape[1] - 1)].astype(float)
    parity = cells[whole].sum(axis=1) % 2
    if len(np.unique(parity)) < 2:
        return None
    even_is_black = np.median(value[parity == 0]) < np.median(value[parity == 1])
    chosen = whole[parity == (0 if even_is_black else 1)][0]
    return 2 * cells[chosen] + 1


def _colour_fits(placement, black: np.ndarray | None) -> float:
    """0 where the placement puts the black square on a black one of the target (top-left square black), else
    −inf.
    """
    if black is None:
        return 0.0
    corner = (black @ placement.rotation.T + 2 * placement.shift - 1) // 2
    return 0.0 if corner.sum() % 2 == 0 else -np.inf


def _is_plain(image: np.ndarray, sites: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Whether the image shows no black at each site (m, 2) within 0.3 of the pitch (m,): white board, not an
    occluder.
    """
    height, width = image.shape
    reach = 0.3 * scale[:, None, None] * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]])
    places = np.rint(sites[:, None] + reach).astype(int)
    inside = ((places >= 0) & (places < [width, height])).all(axis=(1, 2))
    values = image[np.clip(places[..., 1], 0, height - 1), np.clip(places[..., 0], 0, width - 1)].astype(
        float
    )
    bright = values.min(axis=1) > 0.5 * np.percentile(image, 90)
    return inside & bright & (np.ptp(values, axis=1) < 0.25 * values.max(axis=1))
