"""The centre of gravity of a disc's image, to a hundredth of a pixel, and whether the disc is seen whole.

All discs of an image are measured together: the pixels around each lie one disc after another in flat arrays,
and sums over a disc are sums over a segment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SECTORS = 12
RING_REACH = 1.9
# Blur assumed before it has been measured; half the width of the band about a disc's edge follows from it.
FIRST_BLUR = 1.0


@dataclass(frozen=True)
class Measurement:
    """k discs. center (k, 2): centre of gravity, pixels. shape (k, 2, 2): the ellipse's matrix, pixels².

    good (k,): measured, and seen whole. blur (k,): σ of the edge, pixels. contrast (k,): board minus disc,
    grey values. area_ratio (k,): dark area as a share of the ellipse that was looked for.
    """

    center: np.ndarray
    shape: np.ndarray
    good: np.ndarray
    blur: np.ndarray
    contrast: np.ndarray
    area_ratio: np.ndarray


def measure_discs(
    image: np.ndarray,
    center: np.ndarray,
    shape: np.ndarray,
    ratio: float,
    hole: np.ndarray | None = None,
    keep_shape: bool = False,
    rounds: int = 3,
) -> Measurement:
    """Measure discs near center (k, 2) that look like the ellipses shape (k, 2, 2).

    ratio: pitch/radius, which says how near the next disc is. hole (k,): radius of a white hole as a share of
    the disc's. keep_shape: the shape is known (from a camera and a pose) and only the centre is sought.
    """
    count = len(center)
    hole = np.zeros(count) if hole is None else np.asarray(hole, dtype=float)
    center, shape = np.array(center, dtype=float), np.array(shape, dtype=float)
    blur = np.full(count, FIRST_BLUR)
    good = _plausible(image, center, shape)
    measurement = None
    for number in range(rounds):
        last = number == rounds - 1
        good &= _plausible(image, center, shape)
        patches = _Patches.cut(image, center, shape, good, min(RING_REACH, max(ratio - 1.0, 1.15)))
        measurement = _measure(patches, center, shape, hole, blur, ratio, last)
        step = np.hypot(*(measurement.center - center).T)
        good &= measurement.good & (step < np.sqrt(np.maximum(_minor_squared(shape), 1.0)))
        center = np.where(good[:, None], measurement.center, center)
        blur = measurement.blur
        if not keep_shape and not last:
            shape = np.where(good[:, None, None], measurement.shape, shape)
    return Measurement(center, shape, good, blur, measurement.contrast, measurement.area_ratio)


def _minor_squared(shape: np.ndarray) -> np.ndarray:
    """Square of the minor semi-axis (k,)."""
    xx, xy, yy = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    return (xx + yy) / 2 - np.sqrt((xx - yy) ** 2 / 4 + xy**2)


def _plausible(image: np.ndarray, center: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Whether each ellipse is one and lies inside the image, its edge included."""
    finite = np.isfinite(center).all(axis=1) & np.isfinite(shape).all(axis=(1, 2))
    reach = np.sqrt(np.abs(np.diagonal(shape, axis1=1, axis2=2))) + 1.0
    height, width = image.shape
    inside = (center - reach >= 0).all(axis=1) & (center + reach <= [width - 1, height - 1]).all(axis=1)
    sized = (_minor_squared(np.where(finite[:, None, None], shape, 0)) > 1.0) & (
        reach.max(axis=1) < 0.5 * max(height, width)
    )
    return finite & inside & sized


@dataclass(frozen=True)
class _Patches:
    """The pixels around each disc, disc after disc.

    disc (p,): index among ``chosen``. x, y (p,): from the disc's centre, pixels. value (p,). start (d,):
    where each begins. chosen (d,): the discs that were cut. count: of all discs.
    """

    disc: np.ndarray
    x: np.ndarray
    y: np.ndarray
    value: np.ndarray
    start: np.ndarray
    chosen: np.ndarray
    count: int

    @staticmethod
    def cut(
        image: np.ndarray, center: np.ndarray, shape: np.ndarray, good: np.ndarray, reach: float
    ) -> _Patches:
        chosen = np.flatnonzero(good)
        height, width = image.shape
        half = reach * np.sqrt(np.diagonal(shape[chosen], axis1=1, axis2=2)) + 3.0
        low = np.maximum(np.ceil(center[chosen] - half), 0).astype(np.int64)
        high = np.minimum(np.floor(center[chosen] + half), [width - 1, height - 1]).astype(np.int64)
        columns, rows = (high - low + 1).T
        size = columns * rows
        start = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
        disc = np.repeat(np.arange(len(chosen)), size)
        index = np.arange(int(size.sum())) - start[disc]
        row, column = index // columns[disc], index % columns[disc]
        column += low[disc, 0]
        row += low[disc, 1]
        value = image[row, column].astype(np.float32)
        x = (column - center[chosen, 0][disc]).astype(np.float32)
        y = (row - center[chosen, 1][disc]).astype(np.float32)
        return _Patches(disc, x, y, value, start, chosen, len(center))

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Sums over each disc's pixels, (d,)."""
        if len(self.chosen) == 0:
            return np.zeros(0)
        return np.add.reduceat(values, self.start, dtype=float)


def _measure(patches: _Patches, center, shape, hole, blur, ratio: float, final: bool) -> Measurement:
    """One round: ground and disc brightness, then the centre of gravity of the dark share of each pixel."""
    chosen, disc = patches.chosen, patches.disc
    inverse = np.linalg.inv(shape[chosen]).astype(np.float32)
    gx = inverse[disc, 0, 0] * patches.x + inverse[disc, 0, 1] * patches.y
    gy = inverse[disc, 1, 0] * patches.x + inverse[disc, 1, 1] * patches.y
    squared = patches.x * gx + patches.y * gy
    radius = np.sqrt(squared)
    # First-order distance from the edge, outwards, pixels: (s² − 1) / |∇s²|.
    distance = (squared - 1) / np.maximum(2 * np.hypot(gx, gy), 1e-6)
    major = np.sqrt(np.maximum(np.trace(shape[chosen], axis1=1, axis2=2) - _minor_squared(shape[chosen]), 1))
    band = (2.5 * blur[chosen] + 1.0 + 0.03 * major).astype(np.float32)
    gap = 0.5 * (ratio - 2.0)

    core = (radius < 0.7) & (radius > np.where(hole > 0, hole + 0.1, -1)[chosen][disc]) & (distance < -0.5)
    dark = patches.sum(np.where(core, patches.value, 0)) / np.maximum(patches.sum(core), 1)
    ring = (distance > np.minimum(band, 1.2 * np.sqrt(_minor_squared(shape[chosen])))[disc]) & (radius > 1.15)
    ring &= radius < min(RING_REACH, ratio - 1.05)
    ground, noise, enough = _ground(patches, ring, dark)
    level = patches.sum(np.where(core, ground, 0)) / np.maximum(patches.sum(core), 1)
    share = np.clip(dark / np.maximum(level, 1e-6), 0, 0.95)
    weight = (ground - patches.value) / np.maximum(ground * (1 - share[disc]), 1e-6)
    contrast = level - dark

    limit = np.minimum(band, gap * np.sqrt(_minor_squared(shape[chosen])) + 0.5).astype(np.float32)
    inner = distance < -band[disc]
    if (hole > 0).any():
        inner |= radius < np.where(hole > 0, (1 + hole) / 2, 0)[chosen][disc]
    edge = ~inner & (distance < limit[disc])
    mass = np.where(inner, 1, np.where(edge, weight, 0)).astype(np.float32)
    area = patches.sum(mass)
    safe = np.maximum(area, 1e-6)
    move = np.stack([patches.sum(mass * patches.x), patches.sum(mass * patches.y)], -1) / safe[:, None]

    ellipse_area = np.pi * np.sqrt(np.maximum(np.linalg.det(shape[chosen]), 1e-9))
    area_ratio = area / ellipse_area
    good = enough & (contrast > np.maximum(8, 2.5 * noise)) & (area_ratio > 0.6) & (area_ratio < 1.6)
    if final:
        good &= _seen_whole(
            patches,
            gx,
            gy,
            radius,
            distance,
            weight,
            edge | inner,
            noise / np.maximum(contrast, 1),
            hole,
            band,
        )
        good &= (area_ratio > 0.8) & (area_ratio < 1.25)
    result = _Scatter(patches)
    return Measurement(
        center + result(move),
        shape if final else _ellipse(patches, mass, move, area, shape),
        result(good),
        np.where(
            result(good),
            result(_edge_blur(patches, weight, edge, noise / np.maximum(contrast, 1), shape[chosen])),
            blur,
        ),
        result(contrast),
        result(area_ratio),
    )


class _Scatter:
    """Values of the discs that were cut, put back among all discs; zero (False) elsewhere."""

    def __init__(self, patches: _Patches) -> None:
        self.patches = patches

    def __call__(self, values: np.ndarray) -> np.ndarray:
        out = np.zeros((self.patches.count, *values.shape[1:]), dtype=values.dtype)
        out[self.patches.chosen] = values
        return out


def _ground(
    patches: _Patches, ring: np.ndarray, dark: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The board's brightness as a plane through each ring: at every pixel (p,), the noise (d,), and whether
    it is sound.

    Other discs and occluders in the ring are cut off: first all that is nearer to the disc's brightness than
    to the ring's mean, then what lies far from the plane.
    """
    value, disc = patches.value, patches.disc
    kept = ring
    total = np.maximum(patches.sum(ring), 1)
    for _ in range(3):
        mean = patches.sum(np.where(kept, value, 0)) / np.maximum(patches.sum(kept), 1)
        kept = ring & (value > (0.35 * dark + 0.65 * mean)[disc])
    plane = None
    noise = np.zeros(len(patches.chosen))
    ground = np.zeros_like(value)
    for _ in range(2):
        plane = _plane(patches, kept)
        ground = (plane[disc, 0] + plane[disc, 1] * patches.x + plane[disc, 2] * patches.y).astype(np.float32)
        rest = value - ground
        noise = np.sqrt(patches.sum(np.where(kept, rest * rest, 0)) / np.maximum(patches.sum(kept) - 3, 1))
        kept = kept & (np.abs(rest) < np.maximum(2.5 * noise, 2)[disc])
    return ground, noise, (patches.sum(kept) > np.maximum(6, 0.35 * total))


def _plane(patches: _Patches, kept: np.ndarray) -> np.ndarray:
    """Least-squares plane (d, 3): value, and slopes along x and y, over the kept pixels."""
    weight = kept.astype(np.float32)
    wx, wy, wv = weight * patches.x, weight * patches.y, weight * patches.value
    total = patches.sum(weight)
    sx, sy = patches.sum(wx), patches.sum(wy)
    xx, xy, yy = patches.sum(wx * patches.x), patches.sum(wx * patches.y), patches.sum(wy * patches.y)
    right = np.stack([patches.sum(wv), patches.sum(wv * patches.x), patches.sum(wv * patches.y)], -1)
    left = np.stack(
        [np.stack([total, sx, sy], -1), np.stack([sx, xx, xy], -1), np.stack([sy, xy, yy], -1)], -2
    )
    left = left + np.diag([1e-3, 1e-2, 1e-2])
    return np.linalg.solve(left, right[..., None])[..., 0]


def _ellipse(patches: _Patches, mass, move, area, shape) -> np.ndarray:
    """The ellipse matrices (k, 2, 2) from the second moments of the dark mass, scaled to its area."""
    disc = patches.disc
    dx, dy = patches.x - move[disc, 0], patches.y - move[disc, 1]
    safe = np.maximum(area, 1e-6)
    positive = np.maximum(mass, 0)
    xx = patches.sum(positive * dx * dx) / safe
    xy = patches.sum(positive * dx * dy) / safe
    yy = patches.sum(positive * dy * dy) / safe
    moments = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    determinant = np.linalg.det(moments)
    sound = (determinant > 0.05) & (area > 3)
    scale = safe / np.pi / np.sqrt(np.where(sound, determinant, 1))
    out = shape.copy()
    out[patches.chosen] = np.where(
        sound[:, None, None], moments * scale[:, None, None], shape[patches.chosen]
    )
    return out


def _edge_blur(patches: _Patches, weight, edge, relative_noise, shape) -> np.ndarray:
    """σ of the blur (d,), pixels, from ∫ w(1 − w) across the edge, which is σ/√π for a Gaussian one."""
    between = patches.sum(np.where(edge, weight * (1 - weight), 0)) + patches.sum(edge) * relative_noise**2
    xx, xy, yy = shape[:, 0, 0], shape[:, 0, 1], shape[:, 1, 1]
    root = np.sqrt(np.maximum(xx * yy - xy * xy, 1e-9))
    # Mean-square approximation of an ellipse's perimeter.
    perimeter = 2 * np.pi * np.sqrt((xx + yy) / 2)
    sigma = np.sqrt(np.pi) * between / perimeter
    return np.clip(sigma, 0.4, np.maximum(0.4, 0.5 * np.sqrt(root)))


def _seen_whole(
    patches: _Patches, gx, gy, radius, distance, weight, inside, relative_noise, hole, band
) -> np.ndarray:
    """Whether no sector of a disc differs from the opposite one, as it does where something covers part of
    the disc (d,).
    """
    disc = patches.disc
    number = len(patches.chosen)
    sector = np.floor(np.arctan2(gy, gx) * (SECTORS / (2 * np.pi)) + SECTORS / 2).astype(np.int64) % SECTORS
    zone_in = inside & (radius > np.where(hole > 0, hole + 0.15, 0.4)[patches.chosen][disc])
    zone_out = ~inside & (distance < (band + 1.5)[disc])
    good = np.ones(number, dtype=bool)
    for zone, expected in ((zone_in, None), (zone_out, 0.0)):
        place = np.flatnonzero(zone)
        key = disc[place] * SECTORS + sector[place]
        pixels = np.bincount(key, minlength=number * SECTORS).reshape(number, SECTORS)
        mean = np.bincount(key, weight[place], number * SECTORS).reshape(number, SECTORS) / np.maximum(
            pixels, 1
        )
        opposite = np.roll(mean, SECTORS // 2, axis=1)
        fewest = np.minimum(pixels, np.roll(pixels, SECTORS // 2, axis=1))
        tolerance = 0.12 + 4.5 * relative_noise[:, None] / np.sqrt(np.maximum(fewest, 1))
        good &= ~((np.abs(mean - opposite) > tolerance) & (fewest >= 2)).any(axis=1)
        if expected is not None:
            median = np.median(mean, axis=1)
            good &= np.abs(median - expected) < 0.3
    return good
