"""Which point of a plain lattice is which: every view counts from a corner of its own, but the board has one shape.

A lattice without marks looks the same when it is turned, and its part when it is shifted: a camera fits as well, with
another pose. The board's own shape does not: what its points are off by, s_i (metres, target frame), is the same in
all views only where all count alike. With r the residuals of a view beside a flat board, D_i = ∂pixel_i/∂X_i, Q an
orthonormal basis of what its pose can take up, and g = (R, t) a motion of the lattice onto itself, X_g(i) = R X_i + t,

    c(g) = |(1 − Q Qᵀ) (r − D Rᵀ s_g)|²,        s_i = (Σ R Dᵀ D Rᵀ + λ 1)⁻¹ Σ R Dᵀ r     (over the other views)

A view is given the g of least c, the one with the most points being counted as it is; s follows, and the views are
judged again until none changes. λ, the mean of |D|² over a view's points, is the prior of one view. A view keeps its
own count unless another wins by 2 Δ log-likelihood ≥ 9.5 + 2 ln(number of motions).

Views that are counted so as to agree will agree, be it in their noise. So half of every view's points names the views,
and the other half must be predicted better for it: by more than 3 σ of what noise does to the difference of two such
sums, (2 σ)² Σ (|D s|² + |D s'|²). Where it is not, as on a flat board, every view keeps its own count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray, IntArray
from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.robust import robust_spread
from fisheye_ep_calib.calibration.estimating.views import view_blocks

_GATE = 9.5  # of 2 Δ log-likelihood, as for a group of the shape
_SURE = 3.0  # σ
_SWEEPS = 8
_LIKELY = 16  # ways of a view that are judged again
_AT_A_TIME = 64  # ways judged together
_CLIPPED = 4.0  # σ beyond which a residual counts less: a wrong point must not name a view
_ON_LATTICE = 1e-3  # of the spacing
_TURNS = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[-1, 0], [0, -1]], [[0, 1], [-1, 0]]])


@dataclass(frozen=True)
class Recounts:
    """K ways to count the m points of a view, its own the first. turn (K, 3, 3): R. point_index (K, m)."""

    turn: FloatArray
    point_index: IntArray

    def __len__(self) -> int:
        return len(self.turn)


@dataclass(frozen=True)
class Lattice:
    """A board's points as cells. cell (n, 2) int: column and row. index: of the point in a cell, −1 for none."""

    cell: IntArray
    index: IntArray
    square: bool

    @staticmethod
    def of(object_points: np.ndarray) -> Lattice | None:
        """The lattice of points (n, 3) that lie on one, along x and y in a plane z = constant; else None."""
        if len(object_points) < 4 or np.ptp(object_points[:, 2]) > 0:
            return None
        place = object_points[:, :2] - object_points[:, :2].min(axis=0)
        gaps = [np.diff(np.unique(np.round(place[:, axis], 9))) for axis in range(2)]
        if any(len(gap) == 0 for gap in gaps):
            return None
        step = np.array([gap.min() for gap in gaps])
        cell = np.rint(place / step).astype(int)
        index = np.full(cell.max(axis=0) + 1, -1)
        index[cell[:, 0], cell[:, 1]] = np.arange(len(cell))
        on_it = np.abs(place - cell * step).max() < _ON_LATTICE * step.min()
        if not on_it or (index >= 0).sum() < len(cell):
            return None
        return Lattice(cell, index, bool(abs(step[0] - step[1]) < _ON_LATTICE * step.min()))

    def recounts(self, point_index: np.ndarray) -> Recounts:
        """All ways to count points (m,) that leave each a point of the board.

        Turns alone, no reflections: a detector keeps the handedness of what it sees.
        """
        cell = self.cell[point_index]
        turns, names = [np.eye(3)], [point_index]
        for turn in _TURNS if self.square else _TURNS[::2]:
            turned = cell @ turn.T
            turned -= turned.min(axis=0)
            room = np.array(self.index.shape) - turned.max(axis=0)
            in_space = np.eye(3)
            in_space[:2, :2] = turn
            for shift in np.ndindex(*np.maximum(room, 0)):
                column, row = (turned + shift).T
                named = self.index[column, row]
                if (named >= 0).all() and not (turn[0, 0] == 1 and np.array_equal(named, point_index)):
                    turns.append(in_space)
                    names.append(named)
        return Recounts(np.array(turns), np.array(names))


@dataclass(frozen=True)
class _View:
    """rows (m,): of the observations. d_point (m, 2, 3), residual (m, 2) without what the pose takes up, pose (2m, 6):
    all weighted, 0 where a row is not in use; pose with orthonormal columns.
    """

    rows: IntArray
    d_point: FloatArray
    residual: FloatArray
    pose: FloatArray
    ways: Recounts

    @property
    def used(self) -> int:
        """Coordinates in use."""
        return int(self.d_point.any(axis=2).sum())

    def half(self, part: int) -> _View:
        """With every other point alone, those of an even or of an odd place in the view."""
        out = (np.arange(len(self.rows)) % 2 != part)[:, None]
        d_point = np.where(out[..., None], 0.0, self.d_point)
        pose = np.where(np.repeat(out, 2, axis=0), 0.0, self.pose)
        return replace(self, d_point=d_point, residual=np.where(out, 0.0, self.residual), pose=np.linalg.qr(pose)[0])

    def size_of(self, way: int, shape: FloatArray) -> float:
        """|D Rᵀ s|², px², of a way to count, without what the pose takes up."""
        counted = shape[self.ways.point_index[way]] @ self.ways.turn[way]
        moved = np.einsum("mai,mi->ma", self.d_point, counted).reshape(-1)
        return float(moved @ moved - ((moved @ self.pose) ** 2).sum())

    def costs(self, ways: IntArray, shape: FloatArray) -> FloatArray:
        """c(g), px², of ways (k,) for a shape s (n, 3)."""
        costs = np.empty(len(ways))
        for start in range(0, len(ways), _AT_A_TIME):
            some = ways[start : start + _AT_A_TIME]
            counted = shape[self.ways.point_index[some]] @ self.ways.turn[some]
            left = (self.residual - np.einsum("mai,kmi->kma", self.d_point, counted)).reshape(len(some), -1)
            taken_up = left @ self.pose
            costs[start : start + _AT_A_TIME] = (left**2).sum(axis=1) - (taken_up**2).sum(axis=1)
        return costs


class _CommonShape:
    """s (n, 3) as the views say that are added, each counted in one of its ways."""

    def __init__(self, points: int, prior: float) -> None:
        self._normal = np.tile(prior * np.eye(3), (points, 1, 1))
        self._right = np.zeros((points, 3))

    def add(self, view: _View, way: int, sign: float = 1.0) -> None:
        names = view.ways.point_index[way]
        d_point = view.d_point @ view.ways.turn[way].T
        self._normal[names] += sign * (d_point.transpose(0, 2, 1) @ d_point)
        self._right[names] += sign * np.einsum("mai,ma->mi", d_point, view.residual)

    @property
    def deviation(self) -> FloatArray:
        return np.asarray(np.linalg.solve(self._normal, self._right[..., None])[..., 0], dtype=float)


def recounted(fit: Fit) -> tuple[Fit, tuple[int, ...]]:
    """A fit beside a flat or a known board with all views counting alike, and the images that counted otherwise.

    Poses move with the names, so that nothing else changes. The fit itself where the board is no lattice, or no view
    can be counted in two ways.
    """
    lattice = Lattice.of(fit.sightings.observations.object_points)
    if lattice is None:
        return fit, ()
    views = _views(fit, lattice)
    if all(len(view.ways) == 1 for view in views):
        return fit, ()
    given = fit.sightings.target.given[:, :3]
    chosen = _counted_as(views, given) if given.any() else _counted_alike(views, len(given))
    if not chosen.any():
        return fit, ()
    return _renamed(fit, views, chosen), tuple(fit.sightings.images[chosen > 0].tolist())


def _views(fit: Fit, lattice: Lattice) -> list[_View]:
    observations, used = fit.sightings.observations, fit.used
    given = fit.sightings.target.given[:, :3]
    error = np.where(used[:, None], fit.residuals[0], 0.0)
    lengths = np.hypot(error[:, 0], error[:, 1]) * observations.weights
    clip = _CLIPPED * robust_spread(lengths[used])
    weights = np.where(used, observations.weights * np.minimum(1.0, clip / np.maximum(lengths, 1e-12)), 0.0)
    views = []
    row = np.arange(len(observations.image_index))
    rows_of = observations.rows_of(fit.sightings.images)
    for pose, of_view in zip(fit.state.camera_from_target, rows_of, strict=True):
        rows = row[of_view]
        names, weight = observations.point_index[rows], weights[rows]
        points = observations.object_points[names] + given[names]
        d_camera_point = fit.state.camera.project_with_jacobian(points @ pose[:3, :3].T + pose[:3, 3])[2]
        d_camera_point = np.where((weight > 0)[:, None, None], d_camera_point, 0.0)
        d_point = weight[:, None, None] * (d_camera_point @ pose[:3, :3])
        turned = np.cross(np.eye(3)[:, None], points).transpose(1, 2, 0)  # ∂(ω × X)/∂ω
        basis = np.linalg.qr(np.concatenate([d_point, d_point @ turned], axis=-1).reshape(-1, 6))[0]
        residual = np.einsum("mai,mi->ma", d_point, given[names]) - weight[:, None] * error[rows]
        stacked = residual.reshape(-1)
        left = (stacked - basis @ (basis.T @ stacked)).reshape(-1, 2)
        views.append(_View(rows, d_point, left, basis, lattice.recounts(names)))
    return views


def _counted_alike(views: list[_View], points: int) -> IntArray:
    """Each view's way to count (V,), the shape being what the other views say."""
    halves = [[view.half(part) for view in views] for part in (0, 1)]
    named, _ = _named_by_each_other(halves[0], points)
    if not _predicts_better(halves[1], named, points):
        return np.zeros(len(views), dtype=int)
    return _where_surely_better(views, *_named_by_each_other(views, points))


def _named_by_each_other(views: list[_View], points: int) -> tuple[IntArray, FloatArray]:
    """The likeliest way of each view (V,), and what its own and that one cost (V, 2)."""
    common = _CommonShape(points, _prior(views))
    order = sorted(range(len(views)), key=lambda number: -len(views[number].rows))
    likely = [np.arange(len(view.ways)) for view in views]
    chosen = np.zeros(len(views), dtype=int)
    costs = np.zeros((len(views), 2))

    def judge(number: int) -> None:
        """Choose among a view's likely ways, and keep the likeliest of them."""
        cost = views[number].costs(likely[number], common.deviation)
        best = np.argsort(cost, kind="stable")
        own, chosen[number] = cost[likely[number] == 0], likely[number][best[0]]
        costs[number] = own[0], cost[best[0]]
        likely[number] = np.unique(np.append(likely[number][best[:_LIKELY]], 0))

    for position, number in enumerate(order):
        if position:
            judge(number)
        common.add(views[number], chosen[number])
    for _ in range(_SWEEPS):
        before = chosen.copy()
        for number in order:
            common.add(views[number], chosen[number], -1.0)
            judge(number)
            common.add(views[number], chosen[number])
        if (chosen == before).all():
            break
    return chosen, costs


def _predicts_better(views: list[_View], chosen: IntArray, points: int) -> bool:
    """Whether points that did not name the views (V,) are predicted better by the others for it."""
    own, size_own = _left_out_costs(views, np.zeros_like(chosen), points)
    named, size_named = _left_out_costs(views, chosen, points)
    noise = named / sum(view.used for view in views)
    return bool(own - named > _SURE * 2 * np.sqrt(noise * (size_own + size_named)))


def _left_out_costs(views: list[_View], chosen: IntArray, points: int) -> tuple[float, float]:
    """Σ c of the views, each with the shape that the others say, and Σ |D s|² of those shapes."""
    common = _CommonShape(points, _prior(views))
    for view, way in zip(views, chosen, strict=True):
        common.add(view, way)
    cost = size = 0.0
    for view, way in zip(views, chosen, strict=True):
        common.add(view, way, -1.0)
        shape = common.deviation
        cost += float(view.costs(np.array([way]), shape)[0])
        size += view.size_of(way, shape)
        common.add(view, way)
    return cost, size


def _prior(views: list[_View]) -> float:
    """λ, px²/m²."""
    return float(sum((view.d_point**2).sum() for view in views) / max(sum(view.used for view in views) / 2, 1))


def _counted_as(views: list[_View], shape: np.ndarray) -> IntArray:
    """Each view's way to count (V,), the shape (n, 3) being known."""
    costs = [view.costs(np.arange(len(view.ways)), shape) for view in views]
    chosen = np.array([np.argmin(cost) for cost in costs])
    own_and_best = np.array([(cost[0], cost.min()) for cost in costs])
    return _where_surely_better(views, chosen, own_and_best)


def _where_surely_better(views: list[_View], chosen: IntArray, costs: FloatArray) -> IntArray:
    """The chosen ways (V,), but a view's own where the chosen one is not surely better. costs (V, 2): own, chosen."""
    noise = costs[:, 1].sum() / sum(view.used for view in views)
    gate = _GATE + 2 * np.log([len(view.ways) for view in views])
    return np.where(costs[:, 0] - costs[:, 1] >= gate * noise, chosen, 0)


def _renamed(fit: Fit, views: list[_View], chosen: IntArray) -> Fit:
    """The same fit with other names for the points of some views, and poses that belong to them."""
    sightings, points = fit.sightings, fit.sightings.observations.object_points
    names, poses = sightings.observations.point_index.copy(), fit.state.camera_from_target.copy()
    for number in np.flatnonzero(chosen):
        ways, rows, way = views[number].ways, views[number].rows, chosen[number]
        motion = np.eye(4)
        motion[:3, :3] = ways.turn[way]
        motion[:3, 3] = points[ways.point_index[way, 0]] - ways.turn[way] @ points[names[rows[0]]]
        poses[number] = poses[number] @ np.linalg.inv(motion)
        names[rows] = ways.point_index[way]
    observations = replace(sightings.observations, point_index=names)
    blocks = view_blocks(observations, sightings.images)
    state = replace(fit.state, camera_from_target=poses)
    return Fit(
        fit.structure,
        replace(sightings, observations=observations, blocks=blocks),
        replace(fit.problem, blocks=blocks),
        replace(fit.adjustment, state=state),
    )
