"""Patches of a square lattice in an image: neighbours, smoothness, and where the patch would go on.

A patch is cells (k, 2) int, its lattice coordinates, and pixels (k, 2).
"""

from __future__ import annotations

import numpy as np

# +x, −x, +y, −y: a direction's opposite is its neighbour in this list.
DIRECTIONS = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
MOST_BEND = 0.06  # median step off a straight row, in pitches


def neighbours(cells: np.ndarray) -> np.ndarray:
    """Index (k, 4) of each cell's neighbour in each direction, −1 where there is none."""
    low = cells.min(axis=0) - 1
    table = np.full(cells.max(axis=0) - low + 2, -1)
    table[tuple((cells - low).T)] = np.arange(len(cells))
    return np.stack([table[tuple((cells - low + step).T)] for step in DIRECTIONS], axis=1)


def local_pitch(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Distance (k,) to the nearest lattice neighbour, pixels; inf for a lone cell."""
    beside = neighbours(cells)
    distance = np.hypot(*np.moveaxis(pixels[beside] - pixels[:, None], -1, 0))
    result: np.ndarray = np.where(beside < 0, np.inf, distance).min(axis=1)
    return result


def local_axes(cells: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels per lattice step (k, 2, 2), columns x and y, and whether both are known (k,)."""
    beside = neighbours(cells)
    axes = np.zeros((len(cells), 2, 2))
    defined = np.ones(len(cells), dtype=bool)
    for axis, (ahead, behind) in enumerate(((0, 1), (2, 3))):
        after = np.where(beside[:, ahead, None] >= 0, pixels[beside[:, ahead]], pixels)
        before = np.where(beside[:, behind, None] >= 0, pixels[beside[:, behind]], pixels)
        steps = (beside[:, ahead] >= 0).astype(int) + (beside[:, behind] >= 0)
        axes[:, :, axis] = (after - before) / np.maximum(steps, 1)[:, None]
        defined &= steps > 0
    return axes, defined


def local_bend(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Second derivatives (k, 2, 3) of the pixel by lattice step, for xx, xy and yy; 0 where neighbours lack."""
    beside = neighbours(cells)

    def step(index: np.ndarray, direction: int) -> np.ndarray:
        return np.where(index >= 0, beside[index, direction], -1)

    bend = np.zeros((len(cells), 2, 3))
    for column, (ahead, behind) in ((0, (0, 1)), (2, (2, 3))):
        # At an end of a line the nearest point that has both neighbours stands in.
        for middle in (beside[:, behind], beside[:, ahead], np.arange(len(cells))):
            after, before = step(middle, ahead), step(middle, behind)
            complete = (middle >= 0) & (after >= 0) & (before >= 0)
            second = pixels[after] + pixels[before] - 2 * pixels[middle]
            bend[complete, :, column] = second[complete]
    corners = [step(beside[:, across], along) for across in (0, 1) for along in (2, 3)]
    complete = np.all([corner >= 0 for corner in corners], axis=0)
    mixed = (pixels[corners[0]] - pixels[corners[1]] - pixels[corners[2]] + pixels[corners[3]]) / 4
    bend[complete, :, 1] = mixed[complete]
    return bend


def line_residuals(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """How far each point (k,) lies from where the smoothest of the lattice lines through it would have it,
    pixels.

    Along a line a point is predicted from two neighbours on both sides, (−a + 4b + 4c − d)/6, or from three
    on one side, 3b − 3c + d, which errs √19 times as much and is discounted for that. NaN where neither can
    be.
    """
    beside = neighbours(cells)

    def step(index: np.ndarray, direction: int) -> np.ndarray:
        return np.where(index >= 0, beside[index, direction], -1)

    best = np.full(len(cells), np.nan)
    for direction in range(4):
        opposite = direction ^ 1
        first = beside[:, direction]
        second = step(first, direction)
        third = step(second, direction)
        other = beside[:, opposite]
        far = step(other, opposite)
        around = (first >= 0) & (second >= 0) & (other >= 0) & (far >= 0)
        middle = (4 * pixels[first] + 4 * pixels[other] - pixels[second] - pixels[far]) / 6 - pixels
        beyond = (3 * pixels[first] - 3 * pixels[second] + pixels[third] - pixels) / np.sqrt(19)
        for complete, rest in ((around, middle), ((first >= 0) & (second >= 0) & (third >= 0), beyond)):
            best = np.where(complete, np.fmin(best, np.linalg.norm(rest, axis=1)), best)
    return best


def smooth(cells: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Whether each point (k,) fits the lattice lines through it.

    Allowed are 0.3 pixels and 4 % of the pitch, which a strong lens bends a line from one point to the next,
    or six times what is usual in the patch.
    """
    rest = line_residuals(cells, pixels)
    finite = np.isfinite(rest)
    if not finite.any():
        return np.ones(len(cells), dtype=bool)
    allowed = 0.3 + 0.04 * np.minimum(local_pitch(cells, pixels), 1000)
    result: np.ndarray = ~finite | (rest < np.maximum(allowed, 6 * float(np.median(rest[finite]))))
    return result


def is_regular(cells: np.ndarray, pixels: np.ndarray) -> bool:
    """Whether a patch is a grid seen through a lens and not a chance chain of things that lie apart alike.

    It needs whole lattice squares, about one to two points where nothing is missing, and lines that bend by a
    small share of the pitch only.
    """
    beside = neighbours(cells)
    right, down = beside[:, 0], beside[:, 2]
    squares = int(((right >= 0) & (down >= 0) & (beside[right, 2] >= 0)).sum())
    rest = line_residuals(cells, pixels) / local_pitch(cells, pixels)
    finite = np.isfinite(rest)
    bent = float(np.median(rest[finite])) if finite.sum() >= 4 else 0.0
    return squares >= max(2, 0.2 * len(cells)) and bent < MOST_BEND


def extrapolate(cells: np.ndarray, pixels: np.ndarray, ahead: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Free sites ``ahead`` steps from a patch: (m, 2) int, where they should lie (m, 2), and the pitch there
    (m,).

    Each is predicted along the lattice lines that lead to it, n steps beyond the last point a of a, b, c:
    a + n (a − b) from two points, and n (n + 1)/2 (a − 2b + c) more from three.
    """
    at = {tuple(cell): pixel for cell, pixel in zip(cells.tolist(), pixels, strict=True)}
    estimates: dict[tuple[int, int], list[tuple[np.ndarray, float]]] = {}
    for (x, y), near in at.items():
        for step_x, step_y in DIRECTIONS.tolist():
            site = (x + ahead * step_x, y + ahead * step_y)
            second = at.get((x - step_x, y - step_y))
            if site in at or second is None:
                continue
            third = at.get((x - 2 * step_x, y - 2 * step_y))
            step = near - second
            bend = 0.0 if third is None else near - 2 * second + third
            guess = near + ahead * step + ahead * (ahead + 1) / 2 * bend
            estimates.setdefault(site, []).append((guess, float(np.hypot(*step))))
    sites = np.array(list(estimates), dtype=int).reshape(-1, 2)
    guesses = list(estimates.values())
    where = np.array([np.mean([g for g, _ in guess], axis=0) for guess in guesses]).reshape(-1, 2)
    scale = np.array([min(s for _, s in guess) for guess in guesses])
    return sites, where, scale
