"""Which poses of a target its detector could see: inside what light reaches of the image, and large enough."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.target.base import Target
from fisheye_ep_calib.target.expected_features import FARTHER, beyond_evidence

FEATURE_OVER_BLUR = 4.0  # with less than so many σ of the blur across, detectors lose points of a blurred image
_LEAST_SLOPE = 0.6  # of r at the rim, of its mean: fisheyes squeeze the rim no more than that (orthographic apart)
_EDGE_SAMPLES = 10  # a side of the board's outline


@dataclass(frozen=True)
class Sight:
    """What a camera's frames have shown of its images.

    lit (rows, columns) bool: a coarse map of the image, where it has been more than dark. blur: σ of edges, pixels.
    """

    lit: np.ndarray
    blur: float = 1.0

    def shows(self, pixels: np.ndarray, image_size: tuple[int, int]) -> np.ndarray:
        """Whether pixels (..., 2) are inside the image and lit, as are the map's cells beside theirs; NaN is not."""
        cells = np.array(self.lit.shape[::-1])
        place = (np.nan_to_num(pixels, nan=-1e9) + 0.5) / np.array(image_size) * cells
        inside = ((place >= 0) & (place < cells)).all(axis=-1)
        column, row = np.clip(place.astype(int), 0, cells - 1)[..., 0], np.clip(place.astype(int), 0, cells - 1)[..., 1]
        result: np.ndarray = inside & _surrounded(self.lit)[row, column]
        return result


EVERYWHERE = Sight(np.ones((1, 1), dtype=bool))


@dataclass(frozen=True)
class Board:
    """What of a target decides whether it can be seen.

    points (n, 3): metres. outline (k, 3): the white board's edge, for people. needed (k, 3): the edge of what a
    detector must see to find all points. feature: metres across; least_px: pixels that it needs in a sharp image.
    """

    points: np.ndarray
    outline: np.ndarray
    needed: np.ndarray
    feature: float
    least_px: float

    @staticmethod
    def of(target: Target) -> Board:
        """Needed is half a pitch about the points, or a whole disc: with half a pitch, detectors find all of them
        (benchmarks/detectability.py).
        """
        artwork, points = target.artwork(), target.object_points
        low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
        margin = max(0.5 * float(np.sqrt(np.prod(high - low) / len(points))), 1.2 * (target.disc_radius or 0.0))
        depth = float(points[:, 2].mean())
        outline = _edge(artwork.low, artwork.high, depth)
        needed = _edge(low - margin, high + margin, depth)
        return Board(points, outline, needed, target.smallest_feature, target.least_feature_px)

    def least_feature(self, sight: Sight) -> float:
        """Pixels across that the smallest feature needs."""
        return max(self.least_px, FEATURE_OVER_BLUR * sight.blur)

    @property
    def ends(self) -> np.ndarray:
        """Of the points those (8, 3) that lie farthest out in a plane board's eight directions."""
        angles = np.arange(8) * np.pi / 4
        towards = self.points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
        return np.asarray(self.points[towards.argmax(axis=0)])

    @property
    def radius(self) -> float:
        """Half of the outline's diagonal, metres."""
        return 0.5 * float(np.linalg.norm(np.ptp(self.outline, axis=0)))


def _edge(low: np.ndarray, high: np.ndarray, depth: float) -> np.ndarray:
    """Points (k, 3) around a rectangle, at a depth."""
    (left, top), (right, bottom) = low, high
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]])
    part = np.linspace(0, 1, _EDGE_SAMPLES, endpoint=False)[:, None]
    edge = np.concatenate([a + part * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    return np.hstack([edge, np.full((len(edge), 1), depth)])


def detectable(camera: FisheyeCamera, board: Board, poses: np.ndarray, sight: Sight) -> np.ndarray:
    """bool (F,): whether the detector could find the board at poses (F, 4, 4) of it before the camera.

    All that is needed of it must be seen, and its smallest feature be large enough wherever it lies on the board: its
    length times the smaller singular value of d pixel / d (x, y) on the board. Little beyond its evidence a camera is
    no longer believed: what it says there of where a point appears may be anything. Where all points lie nearly within
    the evidence, what is needed about them may reach farther out: the evidence would never grow else.
    """
    known = beyond_evidence(camera)
    at_ends = board.ends @ np.swapaxes(poses[:, :3, :3], -1, -2) + poses[:, None, :3, 3]
    in_camera = board.needed @ np.swapaxes(poses[:, :3, :3], -1, -2) + poses[:, None, :3, 3]
    nearly = replace(camera, theta_max=min(camera.theta_max + 0.5 * FARTHER, np.pi))
    believed = nearly.project(at_ends)[1].all(axis=-1) | known.project(in_camera)[1].all(axis=-1)
    camera = beyond_evidence(known)
    pixels, valid, d_point, _ = camera.project_with_jacobian(in_camera)
    visible = (valid & sight.shows(pixels, camera.image_size)).all(axis=-1)
    plane = np.nan_to_num(d_point @ poses[:, None, :3, :2])
    smallest = np.linalg.svd(plane, compute_uv=False)[..., 1].min(axis=-1)
    result: np.ndarray = believed & visible & (board.feature * smallest >= board.least_feature(sight))
    return result


def light_ends(camera: FisheyeCamera, azimuths: np.ndarray, sight: Sight) -> np.ndarray:
    """The incidence angle (n,), rad, at which light or the image ends in directions of azimuth (n,).

    Within the camera's evidence by its r(θ), beyond it along r's tangent there.
    """
    radius = np.arange(1.0, np.hypot(*camera.image_size))
    along = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=-1)
    pixels = np.array([camera.cx, camera.cy]) + radius[:, None, None] * along
    shown = np.cumprod(sight.shows(pixels, camera.image_size), axis=0)
    end = shown.sum(axis=0) / camera.fx
    theta = np.linspace(0, min(camera.theta_max, camera.theta_limit), 400)
    r = camera.radius(theta)
    slope = max(float((r[-1] - r[-20]) / (theta[-1] - theta[-20])), _LEAST_SLOPE * float(r[-1] / theta[-1]))
    inside = np.interp(end, r, theta)
    result: np.ndarray = np.where(end <= r[-1], inside, np.minimum(theta[-1] + (end - r[-1]) / slope, np.pi))
    return result


def _surrounded(lit: np.ndarray) -> np.ndarray:
    """Cells whose neighbours are lit too: a cell at the edge of the light is half dark. The image's border counts."""
    wide = np.pad(lit, 1, mode="edge")
    result: np.ndarray = lit & wide[:-2, 1:-1] & wide[2:, 1:-1] & wide[1:-1, :-2] & wide[1:-1, 2:]
    return result
