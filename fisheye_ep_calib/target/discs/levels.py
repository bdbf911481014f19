"""How bright the board and the print are around and in each disc."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fisheye_ep_calib.target.discs.ellipse import EllipsePosition, half_box, major_axis, minor_axis
from fisheye_ep_calib.target.pixel_patches import PixelPatches, fit_planes

RING_REACH = 2.2  # radii: the light around a disc is measured out to here at most
RING_WIDTH = 7.0  # pixels of that ring beyond the blurred edge
SMALL_DISC = 10.0  # pixels of minor axis, below which slopes of the light are taken from all discs
FEWEST_NEIGHBOURS = 6  # discs that tell how the light varies over the board
FEWEST_PIXELS = 12  # of a ring away from other discs


@dataclass(frozen=True)
class Levels:
    """Brightness of the board, plane, and of the discs, dark_plane, as planes (d, 3) about the discs'
    centres.

    noise (d,): of the board. sound (d,): enough of board and disc is seen.
    """

    plane: np.ndarray
    dark_plane: np.ndarray
    noise: np.ndarray
    sound: np.ndarray

    @property
    def contrast(self) -> np.ndarray:
        result: np.ndarray = self.plane[:, 0] - self.dark_plane[:, 0]
        return result


def measure_levels(
    image: np.ndarray,
    center: np.ndarray,
    shape: np.ndarray,
    blur: np.ndarray,
    hole: np.ndarray,
    ratio: float,
) -> Levels:
    """The board's brightness as a plane through a ring around each disc, other discs and occluders cut off."""
    band = 2.0 * blur + 0.7
    # Near the edge, where the ground counts, but wide enough for a small disc.
    reach = 1 + np.maximum(0.15, (band + RING_WIDTH) / np.maximum(minor_axis(shape), 1))
    reach = np.minimum(reach, min(RING_REACH, max(ratio - 0.8, 1.3)))
    stride = np.maximum(1, (major_axis(shape) / 7).astype(int))
    box = PixelPatches.cut(image, center, reach[:, None] * half_box(shape) + 2.0, stride)
    ellipse = EllipsePosition.of(box, shape)
    core = (ellipse.distance < -box.spread(band)) | (ellipse.radius < 0.5)
    if (hole > 0).any():
        core = (ellipse.radius < 0.8) & (ellipse.radius > box.spread(np.where(hole > 0, hole + 0.15, -1)))
    dark = box.mean(box.value, core)
    outside = (ellipse.distance > box.spread(band)) & (ellipse.radius < box.spread(reach))
    outside = _clear_of_discs(box, outside, _near_discs(image.shape, center, shape, band))
    trust = _trust(shape) * (1.0 if len(center) >= FEWEST_NEIGHBOURS else 0.02)
    plane, noise, share_kept = _board_planes(*box.select(outside), center, shape, dark, trust)
    # Light falls on disc and board alike: a small disc's slope, which its edge's blur would spoil, is taken as the
    # board's in proportion.
    share = np.clip(dark / np.maximum(plane[:, 0], 1e-6), 0, 0.95)
    inside, meant = box.select(core)
    squares = inside.sum(meant * (inside.x**2 + inside.y**2)) / 2
    strength = (0.2 + 10 * trust) * squares
    information, moment = strength[:, None, None] * np.eye(2), (strength * share)[:, None] * plane[:, 1:]
    dark_plane = fit_planes(inside, meant.astype(np.float32), information, moment)
    return Levels(plane, dark_plane, noise, (share_kept > 0.2) & (inside.sum(meant) > 0))


def _near_discs(size: tuple[int, ...], center: np.ndarray, shape: np.ndarray, band: np.ndarray) -> np.ndarray:
    """Image (h, w) uint8, 1 where a pixel is in a disc or within ``band`` (d,) of one."""
    near = np.zeros(size, np.uint8)
    axes = np.stack([major_axis(shape), minor_axis(shape)], axis=-1) + band[:, None]
    turn = 0.5 * np.degrees(np.arctan2(2 * shape[:, 0, 1], shape[:, 0, 0] - shape[:, 1, 1]))
    middles, axes = np.rint(16 * center).astype(int), np.rint(16 * axes).astype(int)
    for middle, half, angle in zip(middles.tolist(), axes.tolist(), turn.tolist(), strict=True):
        cv2.ellipse(near, middle, half, angle, 0, 360, 1, cv2.FILLED, shift=4)
    return near


def _clear_of_discs(patches: PixelPatches, ring: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The rings (p,) bool without what is near another disc (h, w), as far as enough is left of them."""
    clear = ring.copy()
    clear[ring] = near.ravel()[patches.place[ring]] == 0
    enough = patches.sum(clear) >= FEWEST_PIXELS
    result: np.ndarray = clear | (ring & ~np.repeat(enough, patches.size))
    return result


def _board_planes(
    patches: PixelPatches,
    ring: np.ndarray,
    center: np.ndarray,
    shape: np.ndarray,
    dark: np.ndarray,
    trust: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Planes (d, 3) through the rings (p,) bool, their noise (d,), and the share of each ring that was used (d,)."""
    # The darker half of what is not dark: other things in the ring may be brighter than the board.
    light = patches.quantile(patches.value, ring, 0.5)
    light = patches.quantile(patches.value, ring & (patches.value >= patches.spread(0.5 * (light + dark))), 0.4)
    _, near = cKDTree(center).query(center, k=np.arange(1, min(9, len(center)) + 1))
    light = _without_glare(near, light, dark)
    plane = np.stack([light, *np.zeros((2, len(patches)))], axis=-1)
    noise = np.zeros(len(patches))
    kept = ring
    squares = patches.sum(ring * (patches.x**2 + patches.y**2)) / 2
    # Other discs, occluders and the ground behind the board are cut off, more closely each time.
    for share in (0.5, 0.25, 0.12, None):
        rest = patches.value - height(plane, patches)
        if share is None:
            kept = kept & (np.abs(rest) < patches.spread(np.maximum(2.5 * noise, 2)))
        else:
            kept = ring & (np.abs(rest) < patches.spread(np.maximum(share * (plane[:, 0] - dark), 2)))
        level = patches.mean(patches.value, kept)
        information, moment = _shading(center, near, level, plane[:, 0] - dark, shape)
        strength = trust * squares
        information, moment = strength[:, None, None] * information, strength[:, None] * moment
        plane = fit_planes(patches, kept.astype(np.float32), information, moment)
        noise = np.sqrt(patches.mean(rest**2, kept))
    used = patches.sum(kept)
    return plane, noise, np.where(used > 5, used / np.maximum(patches.sum(ring), 1), 0.0)


def _trust(shape: np.ndarray) -> np.ndarray:
    """What slopes from elsewhere are worth (d,) against those of a disc's own pixels.

    A small disc's ring is narrow and other discs' blurred edges reach into it, so its own slope would be
    poor.
    """
    result: np.ndarray = np.minimum(1, (SMALL_DISC / np.maximum(minor_axis(shape), 1)) ** 4)
    return result


def _without_glare(near: np.ndarray, light: np.ndarray, dark: np.ndarray) -> np.ndarray:
    """The board's brightness (d,) around each disc, that of its neighbours near (d, n) where its ring is brighter."""
    usual = np.median(light[near], axis=1)
    return np.where(light - usual > 0.25 * (usual - dark), usual, light)


def _shading(
    center: np.ndarray, near: np.ndarray, level: np.ndarray, contrast: np.ndarray, shape: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What the levels around the neighbours near (d, n) of each disc tell of the slopes g of the board's brightness
    along x and y: a normal matrix N (d, 2, 2) and the moment N g (d, 2).

    N is Σ o o' / |o|⁴ over the neighbours' offsets o, as light that bends makes their rise differ from g' o by what
    grows with |o|². It is scaled to a trace of 2: the unit matrix where they lie all around, and next to nothing across
    a row where they lie in one. Levels that differ from the disc's own by much of its contrast are of something else.
    Where none is left the board counts as evenly lit, N g = 0 with the unit matrix.
    """
    if len(center) < FEWEST_NEIGHBOURS:
        return np.tile(np.eye(2), (len(center), 1, 1)), np.zeros((len(center), 2))
    offset = center[near] - center[:, None]
    rise = level[near] - level[:, None]
    alike = np.abs(rise) < 0.3 * np.maximum(contrast, 1)[:, None]
    weight = alike / np.maximum((offset**2).sum(axis=-1), 1.0) ** 2
    normal = np.einsum("dk,dki,dkj->dij", weight, offset, offset)
    moment = np.einsum("dk,dki,dk->di", weight, offset, rise)
    half = np.maximum(np.trace(normal, axis1=1, axis2=2) / 2, 1e-12)
    normal, moment = normal / half[:, None, None], moment / half[:, None]
    # More than a quarter of the level across a disc is no shading but an occluder's shadow in one of the rings.
    slope = np.linalg.solve(normal + 2e-3 * np.eye(2), moment[..., None])[..., 0]
    steep = np.hypot(*slope.T) * major_axis(shape) > 0.25 * np.maximum(level, 1)
    unknown = steep | ~alike.any(axis=1)
    return np.where(unknown[:, None, None], np.eye(2), normal), np.where(unknown[:, None], 0, moment)


def height(plane: np.ndarray, patches: PixelPatches) -> np.ndarray:
    """Values (p,) at the pixels of planes (d, 3)."""
    level, slope_x, slope_y = (patches.spread(column) for column in plane.T)
    result: np.ndarray = level + slope_x * patches.x + slope_y * patches.y
    return result
