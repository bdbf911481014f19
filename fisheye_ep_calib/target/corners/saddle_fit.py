"""Saddle corners by fitting their picture: two blurred edges that cross, bent as the lens bends them.

About a corner at pixel c the target's plane coordinates (s, t) map to c + axes (s, t) + ½ Σ bend (s², 2st,
t²). With x and y the distances in pixels from the edges s = 0 and t = 0, the image is

    I = L (m + b P) + b σ² ∇L·∇P,   L = 1 + α s + β t,   P = F(x) F(y),   F(x) = erf(x / (√2 σ))

The light L multiplies: where it falls off, so does the contrast, and α b |x| F(y) looks much like a moved edge. It
falls on sharp edges, and G * (s P₀) = s P + σ² ∇s·∇P for a blur G and P = G * P₀.

Gauss–Newton on the corner's place, σ and the directions of both edges; what enters linearly is solved for in each
step. Written as

    I = m + α m (s (1 + κ P) + κ σ² ∇s·∇P) + β m (t (1 + κ P) + κ σ² ∇t·∇P) + b P,   κ = b / m

these are m, α m, β m and b; κ, and L in ∂I = b L ∂P, are those of the step before.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import erf

HALF_SIDES = (2, 3, 4, 5, 6, 8, 10, 12)  # of the windows, pixels
ROUNDS = 6  # of Gauss–Newton
SLOWER = 0.5  # of a step, once it turns back
FIRST_BLUR = 1.0  # pixels
MARGIN = 3.0  # σ kept away from an edge that the picture lacks, as a marker's: 0.1 % of it is left there
MOST_MARGIN = 0.9  # of the room up to that edge, so that enough of it is seen
PLAY = 0.15  # of that room: markers are drawn, and boards printed, a little off
SOFT = 0.3  # of the margin, over which the weight falls
MOST_RESIDUAL = 0.35  # of the contrast
MOST_SLOPE = 0.5  # of the light, from the zone's middle to its side
LEAST_CONTRAST = 4.0  # grey values, half of white minus black


@dataclass(frozen=True)
class SaddleFit:
    """k corners. pixels (k, 2). contrast (k,): half of white minus black, positive where (+, +) is white.
    residual (k,): RMS of what the fit leaves, grey values. converged (k,)."""

    pixels: np.ndarray
    contrast: np.ndarray
    residual: np.ndarray
    converged: np.ndarray

    def good(self, bright: np.ndarray) -> np.ndarray:
        """Whether each is a corner of the right colours, bright (k,) ±1, that the fit explains (k,)."""
        contrast = self.contrast * bright
        usual = np.median(self.residual[self.converged]) if self.converged.any() else 0.0
        clean = self.residual < np.maximum(MOST_RESIDUAL * contrast, np.minimum(2 * usual, 0.5 * contrast))
        result: np.ndarray = self.converged & (contrast > LEAST_CONTRAST) & clean
        return result


def fit_saddles(
    image: np.ndarray,
    pixels: np.ndarray,
    axes: np.ndarray,
    bend: np.ndarray | None = None,
    depth: np.ndarray | None = None,
    end: np.ndarray | None = None,
) -> SaddleFit:
    """Fit corners that are near pixels (k, 2).

    axes (k, 2, 2): half sides of each corner's clear zone as columns, pixels. bend (k, 2, 3): second
    derivatives of the pixel with respect to (s, t) = ±1 at the zone's border, for ss, st and tt. depth (k,
    2): shares of the zone; pixels farther than that from both edges are left out, in the quadrants (+, +) and
    (−, −), and in the other two. end (k,): how far the corner's edges go, half sides of the zone; twice without.
    """
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    bend = np.zeros((len(pixels), 2, 3)) if bend is None else bend
    depth = np.ones((len(pixels), 2)) if depth is None else depth
    end = np.full(len(pixels), 2.0) if end is None else end
    area = np.abs(np.linalg.det(axes))
    # Distance of the clear zone's sides from its middle: how far the window may reach.
    reach = np.maximum(area[:, None] / np.maximum(np.linalg.norm(axes, axis=1)[:, ::-1], 1e-9), 0.5)
    wanted = 0.85 * reach.min(axis=1)
    choice = np.clip(np.searchsorted(HALF_SIDES, wanted, side="right") - 1, 0, len(HALF_SIDES) - 1)
    out = SaddleFit(
        pixels.copy(), np.zeros(len(pixels)), np.full(len(pixels), np.inf), np.zeros(len(pixels), dtype=bool)
    )
    for number in np.unique(choice):
        chosen = np.flatnonzero(choice == number)
        part = _fit(
            image,
            pixels[chosen],
            axes[chosen],
            bend[chosen],
            reach[chosen],
            depth[chosen],
            end[chosen],
            HALF_SIDES[number],
        )
        for name in SaddleFit.__dataclass_fields__:
            getattr(out, name)[chosen] = getattr(part, name)
    return out


def _fit(
    image: np.ndarray,
    pixels: np.ndarray,
    axes: np.ndarray,
    bend: np.ndarray,
    reach: np.ndarray,
    depth: np.ndarray,
    end: np.ndarray,
    half: int,
) -> SaddleFit:
    """Corners with a window of the same size: ±half pixels along the edges' normals."""
    s, t = _samples(reach, half)
    x, y = s * reach[:, :1], t * reach[:, 1:]
    bent = 0.5 * np.einsum("kij,kjn->kin", bend, np.stack([s * s, 2 * s * t, t * t], axis=1))
    plane = np.stack([s, t], axis=1)
    offset = np.einsum("kij,kjn->kin", axes, plane) + bent
    normals = _between_normals(axes)
    center, sigma = pixels.copy(), np.full(len(pixels), FIRST_BLUR)
    tilt = np.zeros((len(pixels), 2))
    step, before, pace = np.full(len(pixels), np.inf), np.zeros((len(pixels), 2)), np.ones(len(pixels))
    contrast, residual = np.full(len(pixels), 50.0), np.full(len(pixels), 5.0)
    ratio, slope = np.zeros(len(pixels)), np.zeros((len(pixels), 2))  # κ, and α, β
    for _ in range(ROUNDS):
        weight = _weights(s, t, reach, depth, end, sigma)
        places = (center[:, :, None] + offset).astype(np.float32)
        values = cv2.remap(image, places[:, 0], places[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        skewed_x, skewed_y = x + tilt[:, :1] * y, y + tilt[:, 1:] * x
        picture, moved = _picture(skewed_x, skewed_y, x, y, sigma)
        spread = sigma[:, None, None] ** 2 / reach[..., None] * -np.einsum("kij,jkn->kin", normals, moved[:2])
        lit = plane + ratio[:, None, None] * (plane * picture[:, None] + spread)
        light = 1 + np.einsum("ki,kin->kn", slope, plane)
        design = np.stack([np.ones_like(s), *np.moveaxis(lit, 1, 0), picture, *(light * moved)], axis=-1)
        values = values.astype(float)
        weighted = design * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ design
        right = np.einsum("kni,kn->ki", weighted, values)
        strength, drawn = _prior(contrast, residual, tilt, sigma)
        normal[:, range(9), range(9)] += strength
        solved = np.linalg.solve(normal, (right + strength * drawn)[..., None])[..., 0]
        rest = values - np.einsum("kni,ki->kn", design, solved)
        residual = np.sqrt((weight * rest**2).sum(axis=1) / weight.sum(axis=1))
        contrast = solved[:, 3]
        # No print is blacker than black.
        level = np.maximum(solved[:, 0], np.abs(contrast) + 1e-3)
        ratio, slope = contrast / level, np.clip(solved[:, 1:3] / level[:, None], -MOST_SLOPE, MOST_SLOPE)
        safe = np.where(np.abs(contrast) > 1e-3, contrast, 1e-3)
        change = solved[:, 4:] / safe[:, None]
        move = np.clip(change[:, :2], -1.0, 1.0) / reach
        shift = np.einsum("kij,kj->ki", axes, move)
        # Edges that the camera sharpened are steeper than any blur makes them: full steps go to and fro.
        pace = np.where((shift * before).sum(axis=1) < 0, SLOWER * pace, pace)
        shift = before = pace[:, None] * shift
        center = center + shift
        step = np.hypot(*shift.T)
        tilt = np.clip(tilt + np.clip(pace[:, None] * change[:, 2:4], -0.1, 0.1), -0.3, 0.3)
        sigma = np.clip(sigma + np.clip(change[:, 4], -0.4, 0.4), 0.4, 0.5 * half + 0.5)
    return SaddleFit(center, contrast, residual, (step < 0.05) & (np.hypot(*(center - pixels).T) < 0.5 * half + 1))


def _samples(reach: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """Plane coordinates s, t (k, n) of a window's samples, about a pixel apart."""
    steps = np.arange(-half, half + 1) / half
    first, second = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = first**2 + second**2 <= 1.3
    return (
        np.minimum(half / reach[:, :1], 0.95) * first[inside],
        np.minimum(half / reach[:, 1:], 0.95) * second[inside],
    )


def _between_normals(axes: np.ndarray) -> np.ndarray:
    """Scalar products (k, 2, 2) of the unit normals of the edges s = 0 and t = 0: ∇s, ∇t times the reach."""
    lengths = np.linalg.norm(axes, axis=1)
    cosine = -(axes[:, :, 0] * axes[:, :, 1]).sum(axis=1) / np.maximum(lengths[:, 0] * lengths[:, 1], 1e-9)
    result: np.ndarray = np.eye(2) + cosine[:, None, None] * np.array([[0.0, 1.0], [1.0, 0.0]])
    return result


def _weights(
    s: np.ndarray, t: np.ndarray, reach: np.ndarray, depth: np.ndarray, end: np.ndarray, sigma: np.ndarray
) -> np.ndarray:
    """Weights (k, n), 0 to 1, of the samples: those that a blurred edge may reach which the picture lacks are left out.

    A marker fills a s > d, b t > d of the quadrant (a, b), d its depth; a sample is outside by the larger of the two
    distances. The corner's own edges end at the lines |s| = end and |t| = end.
    """
    margin = MARGIN * sigma[:, None]

    def away(limit: np.ndarray, where: np.ndarray, axis: int) -> np.ndarray:
        """Distance (k, n) from the line at limit (k, 1), in margins."""
        room = limit * reach[:, axis : axis + 1]
        result: np.ndarray = (room - where * reach[:, axis : axis + 1]) / np.minimum(
            margin + PLAY * room, MOST_MARGIN * room
        )
        return result

    clear = np.minimum(away(end[:, None], np.abs(s), 0), away(end[:, None], np.abs(t), 1))
    for column, signs in enumerate((((1, 1), (-1, -1)), ((1, -1), (-1, 1)))):
        marked = depth[:, column] < 1
        for a, b in signs if marked.any() else ():
            beside = np.maximum(away(depth[:, column, None], a * s, 0), away(depth[:, column, None], b * t, 1))
            clear = np.where(marked[:, None], np.minimum(clear, beside), clear)
    result: np.ndarray = np.clip((clear - 1 + SOFT) / SOFT, 0.0, 1.0)
    return result


def _prior(
    contrast: np.ndarray, residual: np.ndarray, tilt: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What is expected of the nine unknowns, in units of the normal equations: strengths and values, each (k,
    9).

    A small window cannot tell everything: the light's slopes α m, β m are expected within a tenth of
    the contrast, the edges' directions within 0.05, the blur within 0.3 of its usual value; the place is left
    free, and so are m and b but where no sample tells them.
    """
    variance = np.maximum(residual, 1.0) ** 2
    scale = np.maximum(np.abs(contrast), 4.0)
    strength = np.zeros((len(contrast), 9))
    for columns, allowed in (((0, 3), 100.0), ((1, 2), 0.1), ((4, 5), 1.0), ((6, 7), 0.05), ((8,), 0.3)):
        for column in columns:
            strength[:, column] = variance / (allowed * scale) ** 2
    drawn = np.zeros_like(strength)
    drawn[:, 6:8] = -tilt * contrast[:, None]
    drawn[:, 8] = (np.median(sigma) - sigma) * contrast
    return strength, drawn


def _picture(
    skewed_x: np.ndarray, skewed_y: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """P (k, n) at samples x, y (k, n), with tilted edges skewed_x, skewed_y (k, n) pixels away.

    Also its derivatives (5, k, n) by the corner's place along x and y, the tilts of both edges, and σ.
    """
    across, d_across = _edge(skewed_x, sigma)
    along, d_along = _edge(skewed_y, sigma)
    by_x, by_y = d_across * along, across * d_along
    by_sigma = -(by_x * skewed_x + by_y * skewed_y) / sigma[:, None]
    return across * along, np.stack([-by_x, -by_y, by_x * y, by_y * x, by_sigma])


def _edge(distance: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F (k, n) at distances (k, n) from an edge blurred by sigma (k,), and dF/d distance."""
    scaled = distance / (np.sqrt(2) * sigma[:, None])
    return erf(scaled), np.sqrt(2 / np.pi) / sigma[:, None] * np.exp(-(scaled**2))
