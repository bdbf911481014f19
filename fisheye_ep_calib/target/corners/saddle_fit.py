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
RESTS = 1e-3  # pixels: a corner whose last step was shorter is found
SQRT_2, SQRT_2_BY_PI = np.float32(np.sqrt(2)), np.float32(np.sqrt(2 / np.pi))


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
    """Corners with a window of the same size: ±half pixels along the edges' normals. Each rests once it is found."""
    zone = _Zone.of(axes, bend, reach, depth, end, half)
    state = _State.first(pixels)
    for _ in range(ROUNDS):
        live = np.flatnonzero(state.step > RESTS)
        if len(live) == 0:
            break
        if len(live) < len(state.step):
            part = _improved(image, zone[live], state[live], half, float(np.median(state.sigma)))
            state.put(live, part)
        else:
            state = _improved(image, zone, state, half, float(np.median(state.sigma)))
    moved = np.hypot(*(state.center - pixels).T)
    return SaddleFit(state.center, state.contrast, state.residual, (state.step < 0.05) & (moved < 0.5 * half + 1))


@dataclass(frozen=True)
class _Zone:
    """What the fit of k corners does not change, n samples each.

    x, y (k, n): pixels from the edges s = 0 and t = 0. plane (k, 2, n): s and t. offset (k, 2, n): pixels from the
    corner. away (k, 4, n): pixels from what the picture lacks, |s| = end and |t| = end, then a marker's two sides;
    room (k, 4, n): how many there are. axes (k, 2, 2), reach (k, 2), cosine (k,): between the edges' normals.
    """

    x: np.ndarray
    y: np.ndarray
    plane: np.ndarray
    offset: np.ndarray
    away: np.ndarray
    room: np.ndarray
    axes: np.ndarray
    reach: np.ndarray
    cosine: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> _Zone:
        return _Zone(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @staticmethod
    def of(
        axes: np.ndarray, bend: np.ndarray, reach: np.ndarray, depth: np.ndarray, end: np.ndarray, half: int
    ) -> _Zone:
        """As ``_fit`` takes them."""
        s, t = _samples(reach, half)
        x, y = s * reach[:, :1], t * reach[:, 1:]
        plane = np.stack([s, t], axis=1)
        offset = axes @ plane + 0.5 * bend @ np.stack([s * s, 2 * s * t, t * t], axis=1)
        away, room = _room(x, y, reach, depth, end)
        lengths = np.linalg.norm(axes, axis=1)
        cosine = -(axes[:, :, 0] * axes[:, :, 1]).sum(axis=1) / np.maximum(lengths[:, 0] * lengths[:, 1], 1e-9)
        x, y, plane, offset, away, room = (part.astype(np.float32) for part in (x, y, plane, offset, away, room))
        return _Zone(x, y, plane, offset, away, room, axes, reach, cosine)


@dataclass
class _State:
    """Where the fit of k corners stands. center (k, 2), sigma (k,): pixels. tilt (k, 2): of both edges. step (k,),
    before (k, 2), pace (k,): of the last step, pixels. contrast, residual (k,): grey values. ratio (k,), slope (k, 2):
    κ, and α and β.
    """

    center: np.ndarray
    sigma: np.ndarray
    tilt: np.ndarray
    step: np.ndarray
    before: np.ndarray
    pace: np.ndarray
    contrast: np.ndarray
    residual: np.ndarray
    ratio: np.ndarray
    slope: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> _State:
        return _State(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def put(self, chosen: np.ndarray, part: _State) -> None:
        """Replace the corners ``chosen``."""
        for name in self.__dataclass_fields__:
            getattr(self, name)[chosen] = getattr(part, name)

    @staticmethod
    def first(pixels: np.ndarray) -> _State:
        count = len(pixels)
        sigma, step, pace, contrast, residual, ratio = (
            np.full(count, value) for value in (FIRST_BLUR, np.inf, 1.0, 50.0, 5.0, 0.0)
        )
        tilt, before, slope = np.zeros((3, count, 2))
        return _State(pixels.copy(), sigma, tilt, step, before, pace, contrast, residual, ratio, slope)


def _improved(image: np.ndarray, zone: _Zone, state: _State, half: int, usual_sigma: float) -> _State:
    """One step of Gauss–Newton. usual_sigma: pixels, of all corners."""
    sigma, ratio = state.sigma, state.ratio.astype(np.float32)[:, None, None]
    weight = _weights(zone, sigma)
    places = state.center.astype(np.float32)[:, :, None] + zone.offset
    values = cv2.remap(image, places[:, 0], places[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    values = values.astype(np.float32)
    tilt = state.tilt.astype(np.float32)
    picture, moved = _picture(
        zone.x + tilt[:, :1] * zone.y, zone.y + tilt[:, 1:] * zone.x, zone.x, zone.y, sigma.astype(np.float32)
    )
    # σ² ∇s·∇P and σ² ∇t·∇P, of the unit normals over the reach
    across = np.stack([moved[:, 0], moved[:, 1]], axis=1)
    across += zone.cosine.astype(np.float32)[:, None, None] * across[:, ::-1]
    spread = -(sigma[:, None] ** 2 / zone.reach).astype(np.float32)[..., None] * across
    lit = zone.plane + ratio * (zone.plane * picture[:, None] + spread)
    light = 1 + (state.slope.astype(np.float32)[:, None] @ zone.plane)
    design = np.concatenate([np.ones_like(lit[:, :1]), lit, picture[:, None], light * moved], axis=1)
    weighted = design * weight[:, None]
    normal = (weighted @ np.swapaxes(design, 1, 2)).astype(float)
    right = (weighted @ values[..., None])[..., 0].astype(float)
    strength, drawn = _prior(state.contrast, state.residual, state.tilt, sigma, usual_sigma)
    normal[:, range(9), range(9)] += strength
    solved = np.linalg.solve(normal, (right + strength * drawn)[..., None])[..., 0]
    rest = values - (solved.astype(np.float32)[:, None] @ design)[:, 0]
    residual = np.sqrt((weight * rest**2).sum(axis=1) / weight.sum(axis=1)).astype(float)
    return _moved(zone, state, solved, residual, half)


def _moved(zone: _Zone, state: _State, solved: np.ndarray, residual: np.ndarray, half: int) -> _State:
    """The state after a step by what was solved for (k, 9), bounded."""
    contrast = solved[:, 3]
    # No print is blacker than black.
    level = np.maximum(solved[:, 0], np.abs(contrast) + 1e-3)
    safe = np.where(np.abs(contrast) > 1e-3, contrast, 1e-3)
    change = solved[:, 4:] / safe[:, None]
    move = np.clip(change[:, :2], -1.0, 1.0) / zone.reach
    shift = (zone.axes @ move[..., None])[..., 0]
    # Edges that the camera sharpened are steeper than any blur makes them: full steps go to and fro.
    pace = np.where((shift * state.before).sum(axis=1) < 0, SLOWER * state.pace, state.pace)
    shift = pace[:, None] * shift
    return _State(
        state.center + shift,
        np.clip(state.sigma + np.clip(change[:, 4], -0.4, 0.4), 0.4, 0.5 * half + 0.5),
        np.clip(state.tilt + np.clip(pace[:, None] * change[:, 2:4], -0.1, 0.1), -0.3, 0.3),
        np.hypot(*shift.T),
        shift,
        pace,
        contrast,
        residual,
        contrast / level,
        np.clip(solved[:, 1:3] / level[:, None], -MOST_SLOPE, MOST_SLOPE),
    )


def _samples(reach: np.ndarray, half: int) -> tuple[np.ndarray, np.ndarray]:
    """Plane coordinates s, t (k, n) of a window's samples, about a pixel apart."""
    steps = np.arange(-half, half + 1) / half
    first, second = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = first**2 + second**2 <= 1.3
    return (
        np.minimum(half / reach[:, :1], 0.95) * first[inside],
        np.minimum(half / reach[:, 1:], 0.95) * second[inside],
    )


def _room(
    x: np.ndarray, y: np.ndarray, reach: np.ndarray, depth: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How far (k, 4, n), pixels, samples are from what the picture lacks, and how far that is from the edges (k, 4, n).

    The corner's own edges end at the lines |s| = end and |t| = end. A marker fills a s > d, b t > d of the quadrant
    (a, b), d its depth; of the two of like signs, and of the other two, only the one that a sample lies in is near.
    """
    across, along = np.abs(x), np.abs(y)
    own = np.where(x * y > 0, depth[:, :1], depth[:, 1:])
    lacks = np.where(own < 1, own, np.inf)
    with np.errstate(invalid="ignore"):
        room = np.stack(
            [
                np.broadcast_to(end[:, None] * reach[:, :1], x.shape),
                np.broadcast_to(end[:, None] * reach[:, 1:], x.shape),
                np.minimum(lacks * reach[:, :1], 1e6),
                np.minimum(lacks * reach[:, 1:], 1e6),
            ],
            axis=1,
        )
    return room - np.stack([across, along, across, along], axis=1), room


def _weights(zone: _Zone, sigma: np.ndarray) -> np.ndarray:
    """Weights (k, n), 0 to 1, of the samples: those that a blurred edge may reach which the picture lacks are left out.

    A sample is outside of a marker by the larger of the two distances from its sides.
    """
    margin = (MARGIN * sigma).astype(np.float32)[:, None, None]
    away = zone.away / np.minimum(margin + PLAY * zone.room, MOST_MARGIN * zone.room)
    clear = np.minimum(np.minimum(away[:, 0], away[:, 1]), np.maximum(away[:, 2], away[:, 3]))
    result: np.ndarray = np.clip((clear - 1 + SOFT) / SOFT, 0.0, 1.0)
    return result


def _prior(
    contrast: np.ndarray, residual: np.ndarray, tilt: np.ndarray, sigma: np.ndarray, usual_sigma: float
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
    drawn[:, 8] = (usual_sigma - sigma) * contrast
    return strength, drawn


def _picture(
    skewed_x: np.ndarray, skewed_y: np.ndarray, x: np.ndarray, y: np.ndarray, sigma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """P (k, n) at samples x, y (k, n), with tilted edges skewed_x, skewed_y (k, n) pixels away.

    Also its derivatives (k, 5, n) by the corner's place along x and y, the tilts of both edges, and σ.
    """
    across, d_across = _edge(skewed_x, sigma)
    along, d_along = _edge(skewed_y, sigma)
    by_x, by_y = d_across * along, across * d_along
    by_sigma = -(by_x * skewed_x + by_y * skewed_y) / sigma[:, None]
    return across * along, np.stack([-by_x, -by_y, by_x * y, by_y * x, by_sigma], axis=1)


def _edge(distance: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F (k, n) at distances (k, n) from an edge blurred by sigma (k,), and dF/d distance."""
    scaled = distance / (SQRT_2 * sigma[:, None])
    return erf(scaled), SQRT_2_BY_PI / sigma[:, None] * np.exp(-(scaled**2))
