"""Finding a grid of discs in a strong fisheye's image: blobs, lattice, labels, sub-pixel centres."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.another_board import MOSTLY_SEEN, chosen_of
from fisheye_ep_calib.target.cells import smooth
from fisheye_ep_calib.target.detection import Detection, check_image
from fisheye_ep_calib.target.discs.blobs import WINDOWS, Blobs, discs_are_light, find_blobs, reduced, usual_factor
from fisheye_ep_calib.target.discs.ellipse import minor_axis
from fisheye_ep_calib.target.discs.growth import complete_discs
from fisheye_ep_calib.target.discs.hole_evidence import LEAST_HOLES, HoleEvidence, hole_evidence
from fisheye_ep_calib.target.discs.lattice import FEWEST, Lattice, grow_lattices
from fisheye_ep_calib.target.discs.lattice_evidence import (
    fits_neighbours,
    is_disc_lattice,
    is_every_second,
)
from fisheye_ep_calib.target.discs.measurement import Measurement, measure_discs
from fisheye_ep_calib.target.discs.other_radius import other_radius
from fisheye_ep_calib.target.expected_features import expect_discs, pose_columns, stays_smooth
from fisheye_ep_calib.target.labelling import Placement, label_patch
from fisheye_ep_calib.target.second_look import SLACK, contradictions, places_of
from fisheye_ep_calib.target.sharpness import why_not

FEWEST_DISCS = 9  # of a view
NOT_FOUND = "board not found"
MOST_LATTICES = 4  # of an image that are measured
TOO_MANY = 1.5  # times the discs of the target: something else
MOST_OF_A_ROW = 0.6  # share of the root of the number of discs, from which on a larger grid is told
MOSTLY_FOUND = 0.8  # share of the discs that ends the search
UNKNOWN_RATIO = 2.4  # pitch over radius where the target file tells no radius
USUAL_ERROR = 0.08  # pixels, of a measured centre
# Of an offset from the prediction, the share that may vary from feature to feature.
MODEL_ERROR = 0.08
# Of what a disc's radius exceeds this many pixels, the share that its centre may be off.
SIZE_ERROR, LARGE = 0.005, 20.0


@dataclass(frozen=True)
class _Found:
    """A detection and how much speaks for it."""

    score: float = 0.0
    detection: Detection = Detection()


class Discs(Protocol):
    """What is looked for (boards/circle_grid.py): lengths in metres, lattice (n, 2) int, points that have a hole."""

    @property
    def object_points(self) -> np.ndarray: ...
    @property
    def lattice(self) -> np.ndarray: ...
    @property
    def turns(self) -> list[Placement]: ...
    @property
    def pitch(self) -> float: ...
    @property
    def disc_radius(self) -> float | None: ...
    @property
    def hole_radius(self) -> float: ...
    @property
    def holed(self) -> tuple[int, ...]: ...


class CircleGridDetector:
    """Searches at about 700 pixels a side, measures at full resolution. Light discs are dark ones of the negative."""

    def __init__(self, target: Discs) -> None:
        self.target = target
        self.ratio = target.pitch / target.disc_radius if target.disc_radius else None
        self.gap_ratio = self.ratio or UNKNOWN_RATIO
        self.longest = int(np.ptp(target.lattice, axis=0).max()) + 1
        self.total = len(target.object_points)
        self.fewest = min(FEWEST_DISCS, self.total)
        self.hole_ratio = target.hole_radius / target.disc_radius if target.holed and target.disc_radius else 0.0

    def detect(self, image: np.ndarray) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        dark = self._detect(image)
        if len(dark):
            return dark
        light = self._detect(cv2.bitwise_not(image))
        if len(light):
            return light
        best = max(dark, light, key=lambda detection: detection.reason != NOT_FOUND)
        return replace(best, reason=why_not(image, other_radius(image, self.target) or best.reason))

    def _detect(self, image: np.ndarray) -> Detection:
        """Dark discs on light ground."""
        total = len(self.target.object_points)
        best = _Found(-math.inf)
        for factor in _search_factors(image.shape):
            candidate_at = self._detect_at(image, factor)
            best = max(best, candidate_at, key=lambda candidate: candidate.score)
            if len(best.detection) >= 0.5 * total:
                break
        if len(best.detection) >= self.fewest:
            return best.detection
        count = len(best.detection)
        reason = f"{count} of {total} discs" if count > 3 else best.detection.reason or NOT_FOUND
        return Detection(reason=reason, rejected=best.detection.rejected)

    def detect_guided(
        self,
        image: np.ndarray,
        camera: FisheyeCamera,
        camera_from_target: np.ndarray,
        first: Detection | None = None,
    ) -> Detection:
        reason = check_image(image)
        if reason:
            return Detection(reason=reason)
        points = self.target.object_points
        radius = self.target.disc_radius or self.target.pitch / self.gap_ratio
        expected, shape, visible = expect_discs(camera, camera_from_target, points, radius, image.shape)
        index = np.flatnonzero(visible)
        if len(index) == 0:
            return Detection(reason="board out of view")
        expected, shape = expected[index], shape[index]
        start, measured_before = places_of(first, index, expected)
        if discs_are_light(image, start, shape):
            image = cv2.bitwise_not(image)
        hole = np.where(np.isin(index, self.target.holed), self.hole_ratio, 0.0)
        discs = measure_discs(image, start, shape, self.gap_ratio, hole, keep_shape=True)
        whole, good = discs.good.copy(), discs.good.copy()
        if good.any():
            offset = discs.center[good] - expected[good]
            large = np.maximum(minor_axis(shape[good]) - LARGE, 0)
            usual = USUAL_ERROR + MODEL_ERROR * _typical(offset) + SIZE_ERROR * large
            columns = pose_columns(camera, camera_from_target, points[index[good]])
            slack = np.where(measured_before[good], SLACK, 1.0)
            common = stays_smooth(points[index[good]], offset, usual, columns, slack)
            common &= np.hypot(*(offset - np.median(offset, axis=0)).T) < 0.5 * minor_axis(shape[good])
            allowed = np.where(hole[good] > 0, np.inf, discs[good].size_error)
            whole[good] = stays_smooth(points[index[good]], discs[good].log_radius_ratio, allowed)
            good[good] = common
        good &= whole
        if not good.any():
            return Detection(reason="board not found where the camera expects it", rejected=expected)
        moved = np.hypot(*(discs.center - start).T)
        given_up = contradictions(index, measured_before, whole, moved, good, "blurred or partly covered")
        good &= ~np.isin(index, list(given_up))
        return Detection(index[good], discs.center[good], rejected=discs.center[~good], given_up=given_up)

    def _detect_at(self, image: np.ndarray, factor: int) -> _Found:
        """The best of the largest lattices, looked for in the image reduced by ``factor``."""
        blobs = find_blobs(reduced(image, factor), WINDOWS, holes=bool(self.target.holed)).scaled(factor)
        best = _Found(detection=Detection(rejected=blobs.center))
        total = len(self.target.object_points)
        lattices = grow_lattices(blobs.center, blobs.shape, self.ratio, int(MOSTLY_FOUND * total))
        # A lattice much larger than the target is something else: a grille, a woven cloth.
        largest = TOO_MANY * total
        taken = np.empty(0, dtype=int)
        for lattice in [lattice for lattice in lattices if len(lattice) <= largest][:MOST_LATTICES]:
            apart = len(taken) > 0 and len(lattice) >= MOSTLY_SEEN * total and not np.isin(lattice.blob, taken).any()
            if best.score > len(lattice) and not apart:
                break
            labelled = self._measure_and_label(image, blobs, lattice)
            if apart and len(labelled.detection) >= self.fewest:
                detection = chosen_of(best.detection, labelled.detection, total)
                best = _Found(max(best.score, labelled.score), detection)
                continue
            if labelled.score > best.score and len(labelled.detection):
                taken = lattice.blob
            best = max(best, labelled, key=lambda candidate: (candidate.score, candidate.detection.reason))
        return best

    def _measure_and_label(self, image: np.ndarray, blobs: Blobs, lattice: Lattice) -> _Found:
        chosen = blobs[lattice.blob]
        hole = np.full(len(chosen), self.hole_ratio)
        discs = measure_discs(image, chosen.center, chosen.shape, self.gap_ratio, hole)
        cells, discs = complete_discs(image, lattice.cell, discs, self.gap_ratio, self.hole_ratio, self.longest)
        good = discs.good.copy()
        if good.any():
            good[good] = fits_neighbours(cells[good], discs.center[good], discs.shape[good])
        if not self._is_board(cells[good], discs[good], blobs):
            return _Found(detection=Detection(rejected=blobs.center))
        marks = None
        if self.target.holed:
            marks = hole_evidence(image, cells, discs, self.hole_ratio, self.target.lattice[list(self.target.holed)])
        labels = label_patch(
            cells,
            discs.center,
            self.target.lattice,
            allowed=marks,
            is_plain=lambda sites, scale: _is_plain(image, sites, discs),
            least=LEAST_HOLES if marks else None,
            turns=self.target.turns,
        )
        if not labels.named.any():
            reason = f"{int(good.sum())} discs, but not which: too few of the holed ones are seen"
            if marks is not None and self._is_mirrored(cells, discs, marks):
                reason = f"{int(good.sum())} discs, and the image is mirrored: the holed ones lie as in a mirror"
            return _Found(detection=Detection(reason=reason, rejected=blobs.center))
        # A lattice that goes on beyond the target is something else.
        beyond = int((good & ~labels.named).sum())
        good &= labels.named
        good[good] = smooth(cells[good], discs.center[good])
        loose = np.ones(len(blobs), dtype=bool)
        loose[lattice.blob[good[: len(lattice)]]] = False
        remark = self._larger(beyond)
        detection = Detection(labels.point_index[good], discs.center[good], rejected=blobs.center[loose], remark=remark)
        return _Found(len(detection) - 2 * beyond, detection)

    def _larger(self, beyond: int) -> str:
        """What is to be told where discs go on beyond the target's by most of a row; one or two may be anything."""
        if beyond < MOST_OF_A_ROW * math.sqrt(self.total):
            return ""
        return (
            f"the grid goes on: {beyond} discs are seen beyond the target file's {self.total}, so that points are "
            "named differently from view to view; count columns and rows"
        )

    def _is_mirrored(self, cells: np.ndarray, discs: Measurement, marks: HoleEvidence) -> bool:
        """Whether the holed discs lie as the target's do in a mirror."""
        across = cells * [1, -1]
        turns = self.target.turns
        evidence = replace(marks, cells=across)
        labels = label_patch(across, discs.center, self.target.lattice, evidence, least=LEAST_HOLES, turns=turns)
        return bool(labels.named.any())

    def _is_board(self, cells: np.ndarray, discs: Measurement, blobs: Blobs) -> bool:
        """Whether discs at cells (k, 2) are a grid like the target's, no chance chain nor part of a finer grid."""
        if len(cells) < FEWEST:
            return False
        if is_every_second(cells, discs.center, blobs.center):
            return False
        return is_disc_lattice(cells, discs.center, discs.shape, self.ratio)


def _typical(offset: np.ndarray) -> float:
    """Median length of offsets (k, 2)."""
    return float(np.median(np.hypot(*offset.T)))


def _search_factors(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Reductions to try: the usual one, a finer one for small discs, a coarser one for very large ones, none at all."""
    factor = usual_factor(shape)
    coarser = 2 * factor if min(shape) >= 200 * factor else factor
    return tuple(dict.fromkeys((factor, max(1, factor // 2), coarser, 1)))


def _is_plain(image: np.ndarray, sites: np.ndarray, discs: Measurement) -> np.ndarray:
    """Whether the image shows plain board where a disc should lie (m, 2)."""
    distance = np.hypot(*np.moveaxis(sites[:, None] - discs.center, -1, 0))
    beside = discs.shape[distance.argmin(axis=1)]
    angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    offset = np.concatenate([np.zeros((len(sites), 2, 1)), 0.8 * np.linalg.cholesky(beside) @ circle], axis=2)
    places = np.rint(sites[:, None] + np.swapaxes(offset, 1, 2)).astype(int)
    limit = np.array(image.shape[::-1]) - 1
    inside = ((places >= 0) & (places <= limit)).all(axis=(1, 2))
    places = np.clip(places, 0, limit)
    values = image[places[..., 1], places[..., 0]].astype(float)
    even = np.ptp(values, axis=1) < 0.25 * values.max(axis=1)
    result: np.ndarray = inside & even & (values.min(axis=1) > 0.4 * np.percentile(image[::8, ::8], 95))
    return result
