"""Corners of a board of markers: rough places from the markers, measured, completed from what was measured."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.target.corners.measurement import Surroundings, measure_corners

MOST_ROUNDS = 12  # of growing
MANY_MARKERS = 4  # place what lies between them well enough for a short reach
MOST_TRIES = 3  # to find a feature
NEAR = 8  # features that predict one
SAME_PLACE = 0.05  # of the pitch: two features nearer than this are one
CLEARLY = 0.5  # of two on one place one stays, if it is off by less than this share of what the other is


def corners_by_markers(
    marker_points: np.ndarray, marker_pixels: np.ndarray, points: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the features points (n, 2), metres, should be, from markers near them.

    marker_points, marker_pixels (m, 4, 2): the markers' corners in metres and pixels. reach: how far from a
    marker's middle, metres, its homography is believed. Returns pixels (n, 2), pixels per metre (n, 2, 2),
    defined (n,).
    """
    pixels, jacobian = np.zeros((len(points), 2)), np.zeros((len(points), 2, 2))
    weight = np.zeros(len(points))
    tree = cKDTree(points)
    for metres, corners in zip(marker_points, marker_pixels, strict=True):
        middle = metres.mean(axis=0)
        near = np.array(tree.query_ball_point(middle, reach), dtype=int)
        if len(near) == 0:
            continue
        homography = cv2.getPerspectiveTransform(metres.astype(np.float32), corners.astype(np.float32))
        where, slope = _apply(homography, points[near])
        share = 1 / (np.hypot(*(points[near] - middle).T) + 1e-6) ** 2
        pixels[near] += share[:, None] * where
        jacobian[near] += share[:, None, None] * slope
        weight[near] += share
    defined = weight > 0
    pixels[defined] /= weight[defined, None]
    jacobian[defined] /= weight[defined, None, None]
    return pixels, jacobian, defined


def _apply(homography: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Homography of points (n, 2) and its Jacobian (n, 2, 2)."""
    top = points @ homography[:2, :2].T + homography[:2, 2]
    bottom = points @ homography[2, :2] + homography[2, 2]
    pixels = top / bottom[:, None]
    jacobian = (homography[:2, :2] - pixels[:, :, None] * homography[2, :2]) / bottom[:, None, None]
    return pixels, jacobian


def complete_corners(
    image: np.ndarray,
    points: np.ndarray,
    pixels: np.ndarray,
    jacobian: np.ndarray,
    defined: np.ndarray,
    around: Surroundings,
    step: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Measure the features with a rough place, then those near measured ones, until no more are found.

    points (n, 2): metres. pixels, jacobian, defined: as from ``corners_by_markers``. step: the largest distance
    of neighbouring features, metres. Returns pixels (n, 2) and whether each is confirmed (n,).
    """
    pixels, confirmed = pixels.copy(), np.zeros(len(points), dtype=bool)
    tries = np.zeros(len(points), dtype=int)
    fresh = np.flatnonzero(defined)
    for number in range(MOST_ROUNDS):
        if len(fresh) == 0:
            break
        bend = np.zeros((len(fresh), 2, 3))
        measured, good = measure_corners(image, pixels[fresh], jacobian[fresh], bend, around[fresh])
        pixels[fresh[good]] = measured[good]
        confirmed[fresh[good]] = True
        confirmed = _one_name_each(points, pixels, confirmed, jacobian, step)
        tries[fresh] += number > 0
        if confirmed.sum() < NEAR:
            break
        pixels, jacobian, fresh = _next_round(points, pixels, jacobian, confirmed, tries >= MOST_TRIES, step)
    if confirmed.sum() >= NEAR:
        confirmed = _consistent(points, pixels, confirmed)
        confirmed &= _measure_again(image, points, pixels, confirmed, around)
    return pixels, confirmed


def _next_round(
    points: np.ndarray, pixels: np.ndarray, jacobian: np.ndarray, confirmed: np.ndarray, tried: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of features that are not found yet, from a quadratic through the found ones around each."""
    missing = np.flatnonzero(~confirmed & ~tried)
    pixels, jacobian = pixels.copy(), jacobian.copy()
    tree = cKDTree(points[confirmed])
    distance, _ = tree.query(points[missing]) if len(missing) else (np.zeros(0), None)
    fresh = missing[distance < 1.6 * step]
    if len(fresh):
        local = local_quadratics(points[confirmed], pixels[confirmed], points[fresh])
        pixels[fresh], jacobian[fresh] = local[0], local[1]
    return pixels, jacobian, fresh


def _one_name_each(
    points: np.ndarray, pixels: np.ndarray, confirmed: np.ndarray, jacobian: np.ndarray, step: float
) -> np.ndarray:
    """The confirmed features (n,) without those that lie where another one was found too.

    Of two on one spot the one stays that lies clearly nearer to where the features found elsewhere say, as a quadratic.
    """
    index = np.flatnonzero(confirmed)
    pitch = step * np.sqrt(np.abs(np.linalg.det(jacobian[index])))
    same = np.maximum(SAME_PLACE * pitch, 1.0)
    pairs = cKDTree(pixels[index]).query_pairs(same.max(initial=0.0), output_type="ndarray")
    apart = np.linalg.norm(pixels[index[pairs[:, 0]]] - pixels[index[pairs[:, 1]]], axis=1)
    pairs = index[pairs[apart < same[pairs].max(axis=1)]]
    single: BoolArray = confirmed.copy()
    single[pairs] = False
    if len(pairs) == 0 or single.sum() < NEAR:
        return single
    rest = np.full(len(points), np.inf)
    doubtful = np.unique(pairs)
    where, _, _ = local_quadratics(points[single], pixels[single], points[doubtful])
    rest[doubtful] = np.linalg.norm(where - pixels[doubtful], axis=1)
    beaten = rest[pairs] > CLEARLY * rest[pairs[:, ::-1]]
    single[doubtful] = True
    single[pairs[beaten]] = False
    return single


def _consistent(points: np.ndarray, pixels: np.ndarray, confirmed: np.ndarray) -> np.ndarray:
    """The confirmed features (n,) without those that do not lie where the ones around them say.

    One wrong feature makes its neighbours look wrong too: only the worst of each neighbourhood goes, time and
    again.
    """
    confirmed = confirmed.copy()
    for _ in range(MOST_ROUNDS):
        index = np.flatnonzero(confirmed)
        if len(index) < 2 * NEAR:
            break
        where, _, _ = local_quadratics(points[index], pixels[index], points[index], others=True)
        rest = np.hypot(*(where - pixels[index]).T)
        _, near = cKDTree(points[index]).query(points[index], k=NEAR)
        pitch = np.hypot(*(pixels[index[near[:, 1]]] - pixels[index]).T)
        worst = rest >= rest[near].max(axis=1)
        bad = worst & (rest > np.maximum(6 * np.median(rest), 0.15 * pitch))
        if not bad.any():
            break
        confirmed[index[bad]] = False
    return confirmed


def _measure_again(
    image: np.ndarray, points: np.ndarray, pixels: np.ndarray, confirmed: np.ndarray, around: Surroundings
) -> np.ndarray:
    """Measure the found features once more, now with the lens's bend about each; writes ``pixels`` (n, 2)."""
    index = np.flatnonzero(confirmed)
    _, jacobian, second = local_quadratics(points[index], pixels[index], points[index])
    bend = second * around.half[index, None, None] ** 2
    refined, good = measure_corners(image, pixels[index], jacobian, bend, around[index])
    pixels[index[good]] = refined[good]
    kept = np.zeros(len(points), dtype=bool)
    kept[index[good]] = True
    return kept


def local_quadratics(
    sites: np.ndarray, pixels: np.ndarray, wanted: np.ndarray, others: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, first and second derivatives at points wanted (m, 2) of quadratics through the sites
    nearby.

    sites (k, 2): metres, with pixels (k, 2). Returns pixels (m, 2), pixels per metre (m, 2, 2), and second
    derivatives (m, 2, 3) for xx, xy, yy. Fitted by least squares to the nearest sixteen; fewer than eight
    make it a plane. others: wanted are the sites themselves, each to be told by the others.
    """
    count = min(16, len(sites) - others)
    distance, near = cKDTree(sites).query(wanted, k=count + others)
    distance, near = distance[:, int(others) :], near[:, int(others) :]
    offset = sites[near] - wanted[:, None]
    scale = distance.max(axis=1)[:, None] + 1e-9
    x, y = offset[..., 0] / scale, offset[..., 1] / scale
    columns = [np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2]
    design = np.stack(columns[: 6 if count >= 8 else 3], axis=-1)
    weight = np.exp(-((distance / scale) ** 2))[..., None]
    left = np.swapaxes(design * weight, 1, 2) @ design + 1e-6 * np.eye(design.shape[2])
    solved = np.linalg.solve(left, np.swapaxes(design * weight, 1, 2) @ pixels[near])
    solved = np.concatenate([solved, np.zeros((len(wanted), 6 - design.shape[2], 2))], axis=1)
    jacobian = np.swapaxes(solved[:, 1:3], 1, 2) / scale[..., None]
    second = np.swapaxes(solved[:, 3:6], 1, 2) / scale[..., None] ** 2
    return solved[:, 0], jacobian, second
