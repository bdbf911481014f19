"""Finding a chessboard, whole or in part."""

from __future__ import annotations

import functools
import logging
from dataclasses import replace
from types import ModuleType
from typing import Protocol

import cv2
import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.another_board import chosen_of, outline
from fisheye_ep_calib.target.cells import is_regular, local_axes, local_bend, local_pitch, smooth
from fisheye_ep_calib.target.corners.contrast import detect_stretched
from fisheye_ep_calib.target.corners.growth import colour_parity, grow_corners
from fisheye_ep_calib.target.corners.guidance import find_guided
from fisheye_ep_calib.target.corners.measurement import Surroundings
from fisheye_ep_calib.target.corners.refinement import looks_like_corner, refine_corners
from fisheye_ep_calib.target.corners.saddle_fit import fit_saddles
from fisheye_ep_calib.target.corners.texture import has_corners_everywhere
from fisheye_ep_calib.target.detection import Detection, RowsOfPoints, check_image
from fisheye_ep_calib.target.labelling import Placement, label_patch
from fisheye_ep_calib.target.sharpness import why_not

logger = logging.getLogger(__name__)

FEWEST_CORNERS = 8  # of a view
SCALES = (1.0, 0.5, 0.25)  # at which the image is searched
SMALLEST_SIDE = 200  # pixels of a reduced image
SECOND_SIDE = 1100  # pixels: another board is looked for in an image reduced to less
LARGE = 6_000_000  # pixels of an image that is searched from small to large
MOSTLY_FOUND = 0.75  # share of the corners that ends the search
TOO_MANY = 1.5  # times the corners of the target: something else
NOTHING = np.empty((0, 2), dtype=int), np.empty((0, 2))


@functools.cache
def _calib_targets() -> ModuleType | None:
    """The library that finds partial boards, or None, said once."""
    try:
        import calib_targets
    except ImportError:
        logger.warning(
            "calib-targets is not installed: only chessboards wholly in view can be found (pip install calib-targets)"
        )
        return None
    return calib_targets


class InnerCorners(RowsOfPoints, Protocol):
    """What is looked for (boards/chessboard.py): points row by row, spacing and row_spacing in metres."""

    @property
    def spacing(self) -> float: ...
    @property
    def row_spacing(self) -> float: ...


class ChessboardDetector:
    """Corners by calib-targets (partial boards) or OpenCV (whole boards), refined, completed, then labelled."""

    def __init__(self, target: InnerCorners) -> None:
        self.target = target
        self.lattice = np.rint(target.object_points[:, :2] / [target.spacing, target.row_spacing]).astype(int)
        self.fewest = min(FEWEST_CORNERS, len(self.lattice))
        # Otherwise half a turn exchanges black and white, so that every print has its top-left square black.
        self.two_colourings = (target.columns + target.rows) % 2 == 0

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        return detect_stretched(self._detect, image)

    def _detect(self, image: np.ndarray) -> Detection:
        best = self._most_complete(image, self._patches(image))
        if len(best) == 0:
            return replace(best, reason=why_not(image, best.reason))
        smallest = max(scale for scale in SCALES if scale * min(image.shape) < SECOND_SIDE or scale == SCALES[-1])
        rest = _without_board(image, np.vstack([best.pixels, best.rejected]))
        other = self._most_complete(rest, [self._find(rest, smallest)])
        return chosen_of(best, other, len(self.lattice))

    def _most_complete(self, image: np.ndarray, patches: list[tuple[np.ndarray, np.ndarray]]) -> Detection:
        best = Detection(reason="board not found")
        for cells, pixels in patches:
            if len(cells) < 4 or len(cells) <= len(best):
                break
            completed = self._complete(image, cells, pixels)
            best = max(best, completed, key=lambda detection: (len(detection), len(detection.rejected)))
        return best

    def _patches(self, image: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Patches found in the image and in smaller copies of it, largest first.

        A large image is searched from small to large: what a reduced copy shows need not be found at full size, where
        a texture has corners without end.
        """
        patches: list[tuple[np.ndarray, np.ndarray]] = []
        for scale in SCALES if image.size <= LARGE else SCALES[::-1]:
            if scale < 1.0 and scale * min(image.shape) < SMALLEST_SIDE:
                break
            patches.append(self._find(image, scale))
            if len(patches[-1][0]) >= MOSTLY_FOUND * len(self.lattice):
                break
        return sorted(patches, key=lambda patch: len(patch[0]), reverse=True)

    def detect_guided(
        self,
        image: np.ndarray,
        camera: FisheyeCamera,
        camera_from_target: np.ndarray,
        first: Detection | None = None,
    ) -> Detection:
        target = self.target
        half = np.full(len(self.lattice), 0.5 * min(target.spacing, target.row_spacing))
        # The square down and right of corner (column, row) is black where column + row is even.
        bright = np.where(self.lattice.sum(axis=1) % 2 == 0, -1.0, 1.0)
        around = Surroundings.plain(half, bright)
        return find_guided(image, camera, camera_from_target, target.object_points, around, first)

    def _complete(self, image: np.ndarray, cells: np.ndarray, rough: np.ndarray) -> Detection:
        """Refine and check a patch, add what it lacks, say which corner is which."""
        if len(cells) > TOO_MANY * len(self.lattice):
            return Detection(reason="a larger pattern than the target", rejected=rough)
        pixels, good = refine_corners(image, rough, 0.5 * local_pitch(cells, rough))
        parity = colour_parity(image, cells, rough)
        if parity < 0:
            return Detection(reason="board not found", rejected=rough)
        axes, defined = local_axes(cells, rough)
        bright = np.where(cells.sum(axis=1) % 2 == parity, -1.0, 1.0)
        good &= defined & looks_like_corner(image, pixels, 0.5 * axes, bright)
        if good.sum() < 4:
            return Detection(reason="board not found", rejected=rough)
        # Labelled before the last, strict checks: the larger the patch, the fewer places it fits.
        cells, pixels = grow_corners(image, cells[good], pixels[good], parity, int(self.lattice.max()) + 1)
        colour = functools.partial(_colour_fits, parity=parity)
        labels = label_patch(
            cells,
            pixels,
            self.lattice,
            allowed=(lambda placement: 0.0) if self.two_colourings else colour,
            preferred=colour,
            is_plain=lambda sites, scale: _is_plain(image, sites, scale),
        )
        # The lattice is judged by all that is in it: of the corners that fit well, too few may be neighbours.
        regular = labels.named.any() and is_regular(cells[labels.named], pixels[labels.named])
        pixels, fits = _refine(image, cells, pixels, parity)
        remark = self._larger(cells[fits], labels.named[fits])
        fits &= labels.named
        if fits.any():
            fits[fits] = smooth(cells[fits], pixels[fits])
        if not regular:
            fits[:] = False
        rejected = np.vstack([rough[~good], pixels[~fits]])
        if fits.sum() < self.fewest:
            reason = f"{int(fits.sum())} of {len(self.lattice)} corners"
            return Detection(reason=reason, rejected=np.vstack([rejected, pixels[fits]]))
        return Detection(labels.point_index[fits], pixels[fits], rejected=rejected, remark=remark)

    def _larger(self, cells: np.ndarray, named: np.ndarray) -> str:
        """What is to be told where the board has more corners (k, 2) than its file, which names (k,) of them.

        More by most of a row or a column: one or two beyond the edge may be something else.
        """
        columns, rows = sorted((self.target.columns, self.target.rows), reverse=True)
        if not named.any() or (~named).sum() < MOSTLY_FOUND * rows:
            return ""
        wide, high = sorted((np.ptp(cells, axis=0) + 1).tolist(), reverse=True)
        if wide <= columns and high <= rows:
            return ""
        return (
            f"{wide} × {high} corners are seen, more than the target file's {columns} × {rows}: points are named "
            "differently from view to view; count the inner corners"
        )

    def _find(self, image: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray]:
        """Lattice coordinates (k, 2) int with the handedness of (u, v), and rough pixels (k, 2).

        scale: at which size to look; a smaller image has sharper corners where the full one is blurred.
        """
        small = image
        if scale != 1.0:
            size = int(image.shape[1] * scale), int(image.shape[0] * scale)
            small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        library = _calib_targets()
        if small.size > LARGE and has_corners_everywhere(small):
            return NOTHING
        cells, pixels = self._find_whole(small) if library is None else _find_part(library, small)
        factor = np.array([image.shape[1] / small.shape[1], image.shape[0] / small.shape[0]])
        return (_right_handed(cells, pixels), (pixels + 0.5) * factor - 0.5) if len(cells) else NOTHING

    def _find_whole(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        size = (self.target.columns, self.target.rows)
        if min(size) < 3 or min(image.shape) < 20:
            return NOTHING
        flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE + cv2.CALIB_CB_FAST_CHECK
        whole, corners = cv2.findChessboardCorners(image, size, flags=flags)
        return (self.lattice, corners.reshape(-1, 2).astype(float)) if whole else NOTHING


def any_chessboard(image: np.ndarray) -> np.ndarray:
    """Lattice coordinates (k, 2) int of the corners of any chessboard in an image (h, w), from a brief look."""
    factor = max(1, max(image.shape) // SECOND_SIDE)
    small = cv2.resize(image, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    library = _calib_targets()
    cells, pixels = NOTHING if library is None else _find_part(library, small)
    return cells if len(cells) and is_regular(cells, pixels) else NOTHING[0]


def _without_board(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The image with a plain grey over what is within pixels (k, 2)."""
    rest: np.ndarray = image.copy()
    cv2.fillConvexPoly(rest, np.rint(outline(pixels)).astype(np.int32), float(np.median(image[::8, ::8])))
    return rest


def _find_part(library: ModuleType, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    board = library.detect_chessboard(np.ascontiguousarray(image))
    if board is None:
        return NOTHING
    cells = np.array([(corner.grid.u, corner.grid.v) for corner in board.corners], dtype=int)
    return cells, np.array([corner.position for corner in board.corners], dtype=float)


def _refine(image: np.ndarray, cells: np.ndarray, pixels: np.ndarray, parity: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (k, 2) by fitting each corner's picture, and whether it is a corner and nothing else (k,)."""
    axes, defined = local_axes(cells, pixels)
    fit = fit_saddles(image, pixels, 0.5 * axes, 0.25 * local_bend(cells, pixels))
    bright = np.where(cells.sum(axis=1) % 2 == parity, -1.0, 1.0)
    good = fit.good(bright) & defined & looks_like_corner(image, fit.pixels, 0.5 * axes, bright)
    return fit.pixels, good


def _right_handed(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The cells, mirrored where their axes turn the other way than u and v do."""
    design = np.column_stack([cells, np.ones(len(cells))])
    axes = np.linalg.lstsq(design, pixels, rcond=None)[0][:2]
    return cells if np.linalg.det(axes) > 0 else cells * [1, -1]


def _colour_fits(placement: Placement, parity: int) -> float:
    """0 where the placement makes the top-left square a black one, else −inf."""
    # Twice the centre of a black square of the patch, so that it stays whole under a rotation.
    black = 2 * np.array([parity, 0]) + 1
    corner = (black @ placement.rotation.T + 2 * placement.shift - 1) // 2
    return 0.0 if corner.sum() % 2 == 0 else -np.inf


def _is_plain(image: np.ndarray, sites: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Whether the image shows no black at each site (m, 2) within 0.3 of the pitch (m,): board, no occluder."""
    height, width = image.shape
    offset = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]])
    places = np.rint(sites[:, None] + 0.3 * scale[:, None, None] * offset).astype(int)
    inside = ((places >= 0) & (places < [width, height])).all(axis=(1, 2))
    places = np.clip(places, 0, [width - 1, height - 1])
    values = image[places[..., 1], places[..., 0]].astype(float)
    bright = values.min(axis=1) > 0.5 * np.percentile(image[::8, ::8], 90)
    result: np.ndarray = inside & bright & (np.ptp(values, axis=1) < 0.25 * values.max(axis=1))
    return result
