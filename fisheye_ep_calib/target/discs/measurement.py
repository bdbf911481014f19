"""The centre of gravity of a disc's image, to a hundredth of a pixel, and whether the disc is seen whole."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from fisheye_ep_calib.target.discs.ellipse import EllipsePosition, half_box, major_axis, minor_axis
from fisheye_ep_calib.target.discs.levels import Levels, height, measure_levels
from fisheye_ep_calib.target.pixel_patches import PixelPatches

ROUNDS = 2
SECTORS = 12  # around a disc in which its edge must be seen
FIRST_BLUR = 1.0  # pixels
LEAST_CONTRAST = 8.0  # grey values between board and disc
BEYOND, BEYOND_NOISE = 0.1, 3.0  # of the contrast, and times the noise: what a pixel may differ
# What a lens makes of a disc larger than this, pixels, is no ellipse: of the excess, it may be an egg by this share,
# and differ otherwise by this.
EGG, NO_EGG, LARGE = 0.01, 0.002, 25.0
UNEXPLAINED = 0.25  # of what opposite sectors differ by, RMS, that an egg may leave


@dataclass(frozen=True)
class Measurement:
    """k discs. center (k, 2): centre of gravity, pixels. shape (k, 2, 2): the ellipse x' shape⁻¹ x = 1,
    pixels².

    good (k,): measured, and seen whole. blur (k,): σ of the edge, pixels. contrast (k,): board minus disc,
    grey values. area_ratio (k,): dark area as a share of the ellipse's.
    """

    center: np.ndarray
    shape: np.ndarray
    good: np.ndarray
    blur: np.ndarray
    contrast: np.ndarray
    area_ratio: np.ndarray

    @property
    def log_radius_ratio(self) -> np.ndarray:
        """Logarithm (k, 1) of the disc's size over the looked-for ellipse's, as a radius."""
        result: np.ndarray = 0.5 * np.log(np.maximum(self.area_ratio, 1e-9))[:, None]
        return result

    @property
    def size_error(self) -> np.ndarray:
        """What ``log_radius_ratio`` may err (k,): something that hides more moves the centre by over a tenth
        of a pixel.
        """
        result: np.ndarray = 0.003 + 0.1 / np.maximum(minor_axis(self.shape), 1)
        return result

    def __getitem__(self, chosen: np.ndarray) -> Measurement:
        return Measurement(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def joined(self, other: Measurement) -> Measurement:
        """These discs, then the other ones."""
        names = self.__dataclass_fields__
        return Measurement(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))

    def with_rows(self, chosen: np.ndarray, rows: Measurement) -> Measurement:
        """This, with the rows ``chosen`` replaced."""
        columns = {name: getattr(self, name).copy() for name in self.__dataclass_fields__}
        for name, column in columns.items():
            column[chosen] = getattr(rows, name)
        return Measurement(**columns)


def measure_discs(
    image: np.ndarray,
    center: np.ndarray,
    shape: np.ndarray,
    ratio: float,
    hole: np.ndarray | None = None,
    keep_shape: bool = False,
) -> Measurement:
    """Measure discs near center (k, 2) that look like the ellipses shape (k, 2, 2).

    ratio: pitch/radius, which says how near the next disc is. hole (k,): radius of a white hole as a share of
    the disc's. keep_shape: the shape is known (from a camera and a pose) and only the centre is sought.
    """
    count = len(center)
    hole = np.zeros(count) if hole is None else np.asarray(hole, dtype=float)
    state = Measurement(
        np.array(center, dtype=float),
        np.array(shape, dtype=float),
        np.ones(count, dtype=bool),
        np.full(count, FIRST_BLUR),
        np.zeros(count),
        np.zeros(count),
    )
    for number in range(ROUNDS):
        state = replace(state, good=state.good & _plausible(image, state))
        chosen = np.flatnonzero(state.good)
        if len(chosen) == 0:
            break
        last = number == ROUNDS - 1
        rows = _measure_once(image, state[chosen], hole[chosen], ratio, adapt=not (keep_shape or last), final=last)
        state = state.with_rows(chosen, rows)
    return state


def _plausible(image: np.ndarray, state: Measurement) -> np.ndarray:
    """Whether each ellipse is one and lies inside the image, its edge included."""
    center, shape = state.center, state.shape
    finite = np.isfinite(center).all(axis=1) & np.isfinite(shape).all(axis=(1, 2))
    reach = half_box(shape) + 1.0
    height, width = image.shape
    inside = (center - reach >= -0.5).all(axis=1) & (center + reach <= [width - 0.5, height - 0.5]).all(axis=1)
    sized = (minor_axis(shape) > 1.0) & (reach.max(axis=1) < 0.5 * max(height, width))
    result: np.ndarray = finite & inside & sized
    return result


def _measure_once(
    image: np.ndarray, state: Measurement, hole: np.ndarray, ratio: float, adapt: bool, final: bool
) -> Measurement:
    """One round for discs that are all plausible: levels, then the centre of gravity of the dark share of
    each pixel.
    """
    shape = state.shape
    levels = measure_levels(image, state.center, shape, state.blur, hole, ratio)
    band = 1.6 * state.blur + 0.7 + 0.01 * major_axis(shape)
    patches = PixelPatches.cut(image, state.center, half_box(shape) + band[:, None] + 1.5)
    ellipse = EllipsePosition.of(patches, shape)
    weight = _dark_share(patches, levels)

    inner = ellipse.distance < -band[patches.owner]
    if (hole > 0).any():
        inner |= ellipse.radius < np.where(hole > 0, (1 + hole) / 2, 0)[patches.owner]
    # Beyond half the way to the next disc, that one's blurred edge would count.
    own = ellipse.radius < 0.47 * ratio
    edge = ~inner & own & (ellipse.distance < band[patches.owner])
    mass = np.where(inner, np.float32(1), np.where(edge, weight, np.float32(0)))
    area = patches.sum(mass)
    move = np.stack([patches.sum(mass * patches.x), patches.sum(mass * patches.y)], -1)
    move /= np.maximum(area, 1e-6)[:, None]

    relative_noise = levels.noise / np.maximum(levels.contrast, 1)
    area_ratio = area / (np.pi * np.sqrt(np.maximum(np.linalg.det(shape), 1e-9)))
    good = levels.sound & (levels.contrast > np.maximum(LEAST_CONTRAST, 2 * levels.noise))
    good &= (area_ratio > 0.6) & (area_ratio < 1.6) & (np.hypot(*move.T) < np.maximum(minor_axis(shape), 1.0))
    if final:
        good &= (area_ratio > 0.8) & (area_ratio < 1.25)
        good &= _seen_whole(patches, ellipse, shape, weight, inner, own, state.blur, relative_noise, hole, band)
    new_shape = _ellipse_of_mass(patches, mass, move, area, shape) if adapt else shape
    blur = _edge_blur(patches, weight, edge, relative_noise, shape)
    center = state.center + np.where(good[:, None], move, 0)
    return Measurement(center, new_shape, good, blur, levels.contrast, area_ratio)


def _dark_share(patches: PixelPatches, levels: Levels) -> np.ndarray:
    """How much of each pixel (p,) is disc: (ground − I) / (ground − disc), cut off where it is none and no noise."""
    light, dark = height(levels.plane, patches), height(levels.dark_plane, patches)
    share = (light - patches.value) / np.maximum(light - dark, 1)
    beyond = patches.spread(np.maximum(BEYOND, BEYOND_NOISE * levels.noise / np.maximum(levels.contrast, 1)))
    result: np.ndarray = np.clip(share, -beyond, 1 + beyond)
    return result


def _ellipse_of_mass(
    patches: PixelPatches, mass: np.ndarray, move: np.ndarray, area: np.ndarray, shape: np.ndarray
) -> np.ndarray:
    """The ellipse matrices (d, 2, 2) with the second moments of the dark mass, scaled to its area."""
    dx = patches.x - move[:, 0].astype(np.float32)[patches.owner]
    dy = patches.y - move[:, 1].astype(np.float32)[patches.owner]
    positive = np.maximum(mass, 0)
    safe = np.maximum(area, 1e-6)
    xx = patches.sum(positive * dx * dx) / safe
    xy = patches.sum(positive * dx * dy) / safe
    yy = patches.sum(positive * dy * dy) / safe
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    determinant = np.linalg.det(moments)
    sound = (determinant > 0.05) & (area > 3)
    scale = safe / np.pi / np.sqrt(np.where(sound, determinant, 1))
    result: np.ndarray = np.where(sound[:, None, None], moments * scale[:, None, None], shape)
    return result


def _edge_blur(
    patches: PixelPatches, weight: np.ndarray, edge: np.ndarray, relative_noise: np.ndarray, shape: np.ndarray
) -> np.ndarray:
    """σ of the blur (d,), pixels, from ∫ w(1 − w) across the edge, which is σ/√π for a Gaussian one."""
    between = patches.sum(weight * (1 - weight) * edge) + patches.sum(edge) * relative_noise**2
    # Mean-square approximation of an ellipse's perimeter.
    perimeter = 2 * np.pi * np.sqrt(np.trace(shape, axis1=1, axis2=2) / 2)
    sigma = np.sqrt(np.pi) * between / np.maximum(perimeter, 1e-6)
    # The pixel's own area, σ² = 1/12 each way, is in it.
    result: np.ndarray = np.clip(sigma, 0.3, np.maximum(0.3, 0.6 * minor_axis(shape)))
    return result


def _seen_whole(
    patches: PixelPatches,
    ellipse: EllipsePosition,
    shape: np.ndarray,
    weight: np.ndarray,
    inner: np.ndarray,
    own: np.ndarray,
    blur: np.ndarray,
    relative_noise: np.ndarray,
    hole: np.ndarray,
    band: np.ndarray,
) -> np.ndarray:
    """Whether every sector of each disc (d,) looks as it should, dark inside and light outside.

    Compared with the blurred ellipse, or egg where the disc is large; something that covers part of a disc shows in a
    sector, and not in the opposite one, whereas a wrong blur or size shows in all.
    """
    owner = patches.owner
    expected = np.where(inner, np.float32(1), np.float32(0))
    near = ~inner & (ellipse.distance < band[owner])
    expected[near] = ndtr(-ellipse.distance[near] / np.maximum(blur, 0.3).astype(np.float32)[owner[near]])
    rest = weight - expected
    turn = np.arctan2(ellipse.gradient_y, ellipse.gradient_x) * np.float32(SECTORS / (2 * np.pi)) + SECTORS / 2
    key = owner * SECTORS + np.minimum(turn.astype(np.int32), SECTORS - 1)
    dim = np.where(hole > 0, hole + 0.15, 0.3)[owner]
    excess = np.maximum(major_axis(shape) - LARGE, 0)
    zones = (
        # A glossy print is not evenly dark; an edge that something covers is missed by more.
        ((ellipse.distance < 0) & (ellipse.radius > dim), 0.15, 0 * excess),
        ((ellipse.distance >= 0) & own & (ellipse.distance < (band + 0.5)[owner]), 0.08, EGG * excess),
    )
    whole = np.ones(len(patches), dtype=bool)
    for zone, allowed, egg in zones:
        count = np.bincount(key[zone], minlength=len(patches) * SECTORS).reshape(-1, SECTORS)
        total = np.bincount(key[zone], rest[zone], len(patches) * SECTORS).reshape(-1, SECTORS)
        mean = total / np.maximum(count, 1)
        mean -= _egg(mean, shape, band + 0.5, egg)
        opposite = np.roll(mean, SECTORS // 2, axis=1)
        fewest = np.minimum(count, np.roll(count, SECTORS // 2, axis=1))
        tolerance = (
            allowed
            + 5.0 * relative_noise[:, None] / np.sqrt(np.maximum(fewest, 1))
            + 0.25 / np.maximum(fewest, 1)
            + (NO_EGG * excess / (band + 0.5))[:, None]
        )
        uneven = (np.abs(mean - opposite) > tolerance) & (fewest >= 2)
        wrong = (np.abs(mean) > 0.3 + tolerance) & (count >= 2)
        whole &= ~(uneven | wrong).any(axis=1)
    return whole


def _egg(mean: np.ndarray, shape: np.ndarray, width: np.ndarray, most: np.ndarray) -> np.ndarray:
    """What an egg-shaped outline adds to the means (d, s) over s sectors of a zone outside each disc's edge, ``width``
    (d,) pixels wide, if it leaves the ellipse by ``most`` (d,) pixels at most.

    In the frame u = R⁻¹ x, R² = shape, a smooth lens makes of the unit circle s(ψ) = 1 + α cos 3ψ + β sin 3ψ: the first
    harmonic is a shift, the second an ellipse. With n normal to the edge u ∝ R n, and the edge moves by
    (s − 1) / |∇s| = (s − 1) √(n' shape n) outwards, of which each mean is the share of the width.
    """
    angle = (np.arange(SECTORS) + 0.5) * (2 * np.pi / SECTORS) - np.pi
    normal = np.stack([np.cos(angle), np.sin(angle)])
    # R = (A + √|A| 1) / √(tr A + 2 √|A|); its scale does not matter here.
    root = shape + np.sqrt(np.maximum(np.linalg.det(shape), 0))[:, None, None] * np.eye(2)
    turned = root @ normal
    psi = np.arctan2(turned[:, 1], turned[:, 0])
    reach = np.sqrt(np.einsum("is,dij,js->ds", normal, shape, normal))
    design = np.stack([np.cos(3 * psi), np.sin(3 * psi)], axis=-1) * (reach / width[:, None])[..., None]
    odd = (mean - np.roll(mean, SECTORS // 2, axis=1)) / 2
    square = np.einsum("dsi,dsj->dij", design, design)
    coefficients = np.linalg.solve(square, np.einsum("dsi,ds->di", design, odd)[..., None])[..., 0]
    size = np.hypot(*coefficients.T) * major_axis(shape)
    coefficients *= np.minimum(1, most / np.maximum(size, 1e-9))[:, None]
    egg = np.einsum("dsi,di->ds", design, coefficients)
    # Something that covers a piece of the edge is no third harmonic: of one sector an egg would explain a third.
    explained = np.square(odd - egg).sum(axis=1) < UNEXPLAINED**2 * np.square(odd).sum(axis=1)
    return np.where(explained[:, None], egg, 0)
