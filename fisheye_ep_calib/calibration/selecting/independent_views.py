"""Views are independent or they are one: images of a board at rest, and copies of an image, count as one view.

Two images of one place share every error but the noise of their points: what the board's file, the light and the lens
model leave is the same in both, so that a second image is no second witness. They are one view where the rigid motion
of the board between them moves its points by less than a single point's noise. With d the differences between the
pixels of n points in both and J their Jacobian by the pose,

    d = J δ + e,   |J δ|² / 2n ≤ σ²,   σ = 1.4826 median |e|

Points are paired by where they lie, not by their names, which a board without marks may exchange from image to image.
The pixels of such images are averaged. Their weights stay: what is common to the images does not average out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray, IntArray
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.prediction import predict
from fisheye_ep_calib.calibration.estimating.sightings import Sightings
from fisheye_ep_calib.calibration.observations import Observations

_NEARBY = 0.005  # of the image's longer side: points further apart are not the same
_SAME_PLACE = 0.01  # of the image's longer side, likewise
_COMMON = 0.5  # of the points of the view that has fewer: less in common is another view
_FEWEST_COMMON = 6  # points: fewer hardly tell a motion from noise
_PAIRED = 0.1  # of the distance between neighbouring points: what differs by more is not the same point
_FEW = 60  # views of which every pair is compared
_FEW_PAIRS = 1_000_000  # of points, of two views that are compared point by point
_MEDIAN_TO_SIGMA = 1.4826  # of the absolute values of a Gaussian


@dataclass(frozen=True)
class IndependentViews:
    """observations: each place once, under the number and name of its first image.

    images: number of such an image → the numbers of all images that it stands for, itself included; only where more
    than one.
    """

    observations: Observations
    images: dict[int, tuple[int, ...]]


def without_copies(observations: Observations) -> IndependentViews:
    """Images whose points, pixels and weights are exactly those of an earlier one count once; nothing is averaged."""
    first: dict[bytes, list[int]] = {}
    for image, rows in _rows_of_images(observations):
        order = rows[np.argsort(observations.point_index[rows], kind="stable")]
        content = (observations.point_index[order], observations.pixels[order], observations.weights[order])
        first.setdefault(b"".join(part.tobytes() for part in content), []).append(image)
    groups = [tuple(images) for images in first.values()]
    kept = observations.select_images(np.array([group[0] for group in groups]))
    return IndependentViews(kept, {group[0]: group for group in groups if len(group) > 1})


def without_resting_views(fit: Fit) -> IndependentViews:
    """Images between which the board rested, averaged into one view; images without a pose in the fit stay."""
    observations = fit.sightings.observations
    views = _PointsOfViews(fit)
    place, point = observations.image_index.copy(), observations.point_index.copy()
    members: dict[int, list[int]] = {}
    for view, candidates in enumerate(views.near()):
        rows = views.rows[view]
        for first in (other for other in candidates if other in members):
            names = views.names_at_rest(first, view)
            if names is not None:
                place[rows], point[rows] = fit.sightings.images[first], names
                members[first].append(view)
                break
        else:
            members[view] = [view]
    groups = [tuple(int(fit.sightings.images[view]) for view in group) for group in members.values() if len(group) > 1]
    if not groups:
        return IndependentViews(observations, {})
    return IndependentViews(_averaged(observations, place, point), {group[0]: group for group in groups})


def places(sightings: Sightings) -> np.ndarray:
    """Number (V,) of the place of each view: views whose points have nearly the same middle and spread in the image.

    They differ by more than noise, and so are views of their own; but what is wrong with one of them is wrong with the
    others, so that one cannot bear witness for another.
    """
    observations = sightings.observations
    used = (observations.weights > 0) & np.isin(observations.image_index, sightings.images)
    view = np.searchsorted(sightings.images, observations.image_index[used])
    count = np.bincount(view)[:, None]
    moments = [observations.pixels[used] ** power for power in (1, 2)]
    middle, square = (
        np.stack([np.bincount(view, part[:, axis]) for axis in range(2)], axis=-1) / count for part in moments
    )
    spread = np.sqrt(np.maximum(square - middle**2, 0.0))
    near = _neighbours_of(np.concatenate([middle, spread], axis=1), _SAME_PLACE * max(observations.image_size))
    number, count_of_places = np.full(len(count), -1), 0
    for first in range(len(number)):
        if number[first] < 0:  # few neighbours are asked for: where the board rests, all views are those of each other
            candidates = np.asarray(near(first))
            number[candidates[number[candidates] < 0]] = count_of_places
            count_of_places += 1
    return number


class _PointsOfViews:
    """Measured pixels and their Jacobians by the pose. rows: observation rows of each view, those in use."""

    def __init__(self, fit: Fit) -> None:
        observations = fit.sightings.observations
        self._fit = fit
        self._point_index, self._pixels = observations.point_index, observations.pixels
        self._reach = _NEARBY * max(observations.image_size)
        self._jacobian = np.zeros((len(observations.pixels), 2, 6))
        self.rows: list[np.ndarray] = [np.empty(0, dtype=int)] * len(fit.sightings.images)
        surface = fit.problem.shape.surface(fit.state.shape)
        for block in fit.problem.blocks:
            predicted = predict(
                fit.state.camera,
                fit.problem.features,
                surface,
                fit.state.camera_from_target[block.views],
                block,
                fit.problem.theta_limit,
                jacobian=True,
            )
            self._jacobian[block.rows] = predicted.d_pose.transpose(2, 3, 0, 1)
            used = block.real & (block.weights > 0) & predicted.valid
            for slot, view in enumerate(block.views):
                self.rows[view] = block.rows[slot, used[slot]]

    def near(self) -> list[list[int]]:
        """Of each view those, itself included, that may show the same place.

        By the fitted poses, or by the middle and the spread of the points in the image: a board without marks may
        have another pose at the same place, and two images of a place may show different points of it.
        """
        pixels = [self._pixels[rows] for rows in self.rows]
        spread = np.array([[*each.mean(axis=0), *each.std(axis=0)] if len(each) else [-1e9] * 4 for each in pixels])
        by_points = _neighbours(spread, self._reach)
        by_pose = _neighbours(_corner_directions(self._fit), self._reach / self._fit.state.camera.fx)
        return [sorted({*some, *others}) for some, others in zip(by_points, by_pose, strict=True)]

    def names_at_rest(self, first: int, second: int) -> np.ndarray | None:
        """The names that the second view's points have in the first, or None where the board moved between them.

        −1 for points that the first does not have, where names differ between the two.
        """
        rows_a, rows_b = self.rows[first], self.rows[second]
        distance, nearest = _nearest(self._pixels[rows_a], self._pixels[rows_b], len(self.rows) <= _FEW)
        common = distance < self._reach
        if common.sum() < max(_FEWEST_COMMON, _COMMON * min(len(rows_a), len(rows_b))):
            return None
        partner = rows_a[nearest[common]]
        difference = (self._pixels[rows_b[common]] - self._pixels[partner]).reshape(-1)
        columns = self._jacobian[partner].reshape(len(difference), 6)
        moved = columns @ np.linalg.lstsq(columns, difference, rcond=None)[0]
        noise = _MEDIAN_TO_SIGMA * float(np.median(np.abs(difference - moved)))
        # Where nothing differs at all, rounding alone is left on both sides.
        if noise > _PAIRED * self._pitch(rows_a) or float(np.sqrt((moved**2).mean())) > max(noise, 1e-9):
            return None
        names: IntArray = self._point_index[rows_b]
        if np.array_equal(names[common], self._point_index[partner]):
            return names
        names = np.full(len(rows_b), -1)
        names[common] = self._point_index[partner]
        return names

    def _pitch(self, rows: np.ndarray) -> float:
        """Median distance, px, of a view's points to their nearest neighbours."""
        pixels = self._pixels[rows]
        if len(pixels) ** 2 > _FEW_PAIRS:
            from scipy.spatial import cKDTree

            return float(np.median(cKDTree(pixels).query(pixels, k=2)[0][:, 1]))
        square = _squares(pixels, pixels)
        np.fill_diagonal(square, np.inf)
        return float(np.median(np.sqrt(square.min(axis=1))))


def _squares(points: np.ndarray, others: np.ndarray) -> FloatArray:
    """Squares (n, m) of the distances of points (n, 2) to others (m, 2)."""
    return np.asarray(sum((points[:, None, axis] - others[:, axis]) ** 2 for axis in range(2)))


def _nearest(points: np.ndarray, others: np.ndarray, is_rare: bool) -> tuple[np.ndarray, np.ndarray]:
    """Of each of others (m, 2) the distance of the nearest point (n, 2), and its number.

    is_rare: whether it is asked for seldom, so that to load scipy.spatial would take longer.
    """
    if is_rare and len(points) * len(others) <= _FEW_PAIRS:
        square = _squares(others, points)
        nearest = square.argmin(axis=1)
        return np.sqrt(square[np.arange(len(others)), nearest]), nearest
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points).query(others)
    return distance, nearest


def _neighbours(values: np.ndarray, reach: float) -> list[list[int]]:
    """Of each row (V, k) the rows that differ by no more than the reach in every column."""
    if len(values) <= _FEW:  # to load scipy.spatial would take longer
        near = (np.abs(values[:, None] - values) <= reach).all(axis=-1)
        return [np.flatnonzero(row).tolist() for row in near]
    from scipy.spatial import cKDTree

    return list(cKDTree(values).query_ball_point(values, reach, p=np.inf))


def _neighbours_of(values: np.ndarray, reach: float) -> Callable[[int], Sequence[int]]:
    """``_neighbours`` of one row, by its number."""
    if len(values) <= _FEW:
        return _neighbours(values, reach).__getitem__
    from scipy.spatial import cKDTree

    tree = cKDTree(values)
    return lambda row: list(tree.query_ball_point(values[row], reach, p=np.inf))


def _corner_directions(fit: Fit) -> np.ndarray:
    """Unit vectors (V, 12) from the camera to the four corners of the board, in the camera frame."""
    board, poses = fit.sightings.features.board, fit.state.camera_from_target
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = board.middle + (signs * board.half_extent) @ board.axes[:, :2].T
    in_camera = corners @ np.swapaxes(poses[:, :3, :3], 1, 2) + poses[:, None, :3, 3]
    directions: FloatArray = (in_camera / np.linalg.norm(in_camera, axis=-1, keepdims=True)).reshape(len(poses), -1)
    return directions


def _averaged(observations: Observations, place: np.ndarray, point: np.ndarray) -> Observations:
    """The rows of each place and point as one; pixels are averaged by the squares of their weights.

    place, point (M,): the image and the point that each row stands for; rows of point −1 are left out.
    """
    kept, points = point >= 0, len(observations.object_points)
    keys, row = np.unique(place[kept] * points + point[kept], return_inverse=True)
    weights, measured = observations.weights[kept], observations.pixels[kept]
    total, used = np.bincount(row, weights**2), np.bincount(row, weights > 0)
    # A point that no image of the place uses keeps a plain average, and no weight.
    share = np.where(total[row] > 0, weights**2, 1.0)
    share /= np.bincount(row, share)[row]
    pixels = np.stack([np.bincount(row, share * measured[:, axis]) for axis in range(2)], axis=-1)
    return replace(
        observations,
        image_index=keys // points,
        point_index=keys % points,
        pixels=pixels,
        weights=np.sqrt(total / np.maximum(used, 1)),
    )


def _rows_of_images(observations: Observations) -> Iterable[tuple[int, np.ndarray]]:
    images, starts = np.unique(observations.image_index, return_index=True)
    stops = np.append(starts[1:], len(observations.image_index))
    return [(int(image), np.arange(a, b)) for image, a, b in zip(images, starts, stops, strict=True)]
