"""What of the field can be covered at all, what has been, and what a view would add."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.assessing.coverage import SECTOR_NAMES, sector_of
from fisheye_ep_calib.calibration.assessing.finding import Finding

RING_DEGREES = 15
SECTORS = len(SECTOR_NAMES)
RINGS = 180 // RING_DEGREES
ENOUGH = 0.9  # of the cells that can be covered
_BORDER = np.radians(3.0)  # of the image circle, into which only the board's margin reaches
_OUTER = 0.75  # of the largest angle: where depth is wanted
_DEPTH_RATIO = 2.0  # of the farthest to the nearest sightings there


@dataclass(frozen=True)
class Field:
    """Cells of the field by ring of incidence angle and sector of azimuth (coverage.py).

    points (n, 3): some of the target's. counts (rings, sectors): sightings. reachable: bool, same shape: cells that are
    covered, or would be by a pose that can be detected, or into which the image circle reaches. rim: rad, the largest
    angle that can be reached. nearest, farthest: metres, of the sightings at the rim; NaN where there are none.
    """

    points: np.ndarray
    counts: np.ndarray
    reachable: np.ndarray
    rim: float
    nearest: float
    farthest: float

    @staticmethod
    def of(
        points: np.ndarray, camera_from_target: np.ndarray, offered: np.ndarray, ends: np.ndarray | None = None
    ) -> Field:
        """points: of the target. camera_from_target: of the views so far. offered: poses that can be detected.

        ends (sectors,): rad, where the image circle ends; None where that is not known.
        """
        none = np.zeros((RINGS, SECTORS), dtype=int)
        empty = Field(points, none, none > 0, 0.0, np.nan, np.nan)
        counts = sum((empty._cells(pose[None])[0] for pose in camera_from_target), none)
        could = empty._cells(offered).sum(axis=0) if len(offered) else none
        reached = np.concatenate([empty._angles(poses)[0].ravel() for poses in (camera_from_target, offered)])
        rim = float(reached.max()) if len(reached) else 0.0
        theta, _, distance = empty._angles(camera_from_target)
        outer = distance[theta > _OUTER * rim]
        near, far = np.quantile(outer, [0.05, 0.95]) if len(outer) else (np.nan, np.nan)
        reachable = (counts > 0) | (could > 0)
        if ends is not None:
            middles = np.radians(RING_DEGREES * (np.arange(RINGS) + 0.5))
            reachable |= middles[:, None] < ends - _BORDER
        return Field(points, counts, reachable, rim, float(near), float(far))

    @property
    def share(self) -> float:
        """Of the cells that can be covered, those that are."""
        return float((self.counts > 0).sum() / max(int(self.reachable.sum()), 1))

    @property
    def finding(self) -> Finding:
        """Coverage against what can be covered."""
        missing = np.argwhere(self.reachable & (self.counts == 0))
        values = {"share_of_field": self.share, "rings": float(self.reachable.any(axis=1).sum())}
        if len(missing) == 0:
            return Finding("coverage", values, False, "every part of the field that the image shows is covered")
        ring = int(missing[:, 0].max())
        sectors = ", ".join(SECTOR_NAMES[sector] for which, sector in missing if which == ring)
        told = f"{100 * self.share:.0f} % of the field that the image shows is covered; show the target "
        where = f"{RING_DEGREES * ring}–{RING_DEGREES * (ring + 1)}° off the axis ({sectors})"
        return Finding("coverage", values, self.share < ENOUGH, told + where)

    @property
    def deep(self) -> bool:
        """Whether the sightings at the rim are far enough apart in distance to observe a pupil."""
        return bool(self.farthest >= _DEPTH_RATIO * self.nearest)

    def worth(self, poses: np.ndarray) -> np.ndarray:
        """What poses (F, 4, 4) would add, (F,): in cells not covered yet and, at the rim, in depth."""
        worth = np.zeros(len(poses))
        if self.share < ENOUGH:
            added = (self._cells(poses) > 0) & (self.counts == 0)
            worth += added.sum(axis=(1, 2)) / SECTORS
        if not self.deep:
            theta, _, distance = self._angles(poses)
            outer = theta > _OUTER * self.rim
            median = np.array(
                [
                    np.median(distances[which]) if which.any() else np.nan
                    for distances, which in zip(distance, outer, strict=True)
                ]
            )
            with np.errstate(invalid="ignore"):
                apart = np.maximum(median / self.nearest, self.farthest / median)
            worth += np.where(outer.mean(axis=1) > 0.2, np.clip(np.nan_to_num(apart, nan=1.5) - 1, 0, 1.2), 0)
        return worth

    def with_view(self, pose: np.ndarray) -> Field:
        """Once a view at a pose (4, 4) is kept."""
        theta, _, distance = self._angles(pose[None])
        outer = distance[0][theta[0] > _OUTER * self.rim]
        finite = [value for value in (self.nearest, self.farthest, *outer) if np.isfinite(value)]
        near, far = (min(finite), max(finite)) if finite else (np.nan, np.nan)
        return replace(self, counts=self.counts + self._cells(pose[None])[0], nearest=near, farthest=far)

    def _angles(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Incidence angle, azimuth (rad) and distance (metres) of the points at poses (F, 4, 4), each (F, n)."""
        x, y, z = np.moveaxis(self.points @ np.swapaxes(poses[:, :3, :3], -1, -2) + poses[:, None, :3, 3], -1, 0)
        across = np.hypot(x, y)
        return np.arctan2(across, z), np.arctan2(y, x), np.hypot(across, z)

    def _cells(self, poses: np.ndarray) -> np.ndarray:
        """Points (F, rings, sectors) in each cell at poses (F, 4, 4)."""
        theta, azimuth, _ = self._angles(poses)
        ring = np.minimum((np.degrees(theta) // RING_DEGREES).astype(int), RINGS - 1)
        cell = ring * SECTORS + sector_of(azimuth, SECTORS)
        rows = np.arange(len(poses))[:, None] * (RINGS * SECTORS) + cell
        counted = np.bincount(rows.ravel(), minlength=len(poses) * RINGS * SECTORS)
        result: np.ndarray = counted.reshape(len(poses), RINGS, SECTORS)
        return result
