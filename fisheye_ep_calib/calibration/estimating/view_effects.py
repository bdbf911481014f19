"""What differs from view to view beside the pose: a board that flexes or stretches, a motion while the shutter rolls.

    p = R (X + Σ_k b_k φ_k) + t,      flex: the three heights of degree 2; in plane: the fields of degrees 1 and 2
    p ← p + s (ω × (p − c) + v)       shutter: c the board's middle, s the measured row, −½ to ½ over the image

with φ the fields of target/shape/basis.py and b, ω, v of each view its own, a priori N(0, τ²) with one τ a group:
metres, and for ω radians, within one image. All stand beside the view's pose in the normal equations and are eliminated
with it, so that cost stays linear in the views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.prediction import Prediction, ViewChange
from fisheye_ep_calib.calibration.estimating.views import ViewBlock
from fisheye_ep_calib.target.shape.basis import SMOOTH_GROUPS, smooth_fields
from fisheye_ep_calib.target.shape.model import LOCAL, ShapeModel

FLEX, IN_PLANE, TURN, SHIFT = "flex", "in plane", "shutter turn", "shutter shift"
VIEW_GROUPS = (FLEX, IN_PLANE, TURN, SHIFT)
SHUTTER = (TURN, SHIFT)
_HIGHEST_DEGREE = 2
_FIELDS = {FLEX: ("z2",), IN_PLANE: ("xy1", "xy2")}


@dataclass(frozen=True)
class ViewEffects:
    """k coefficients a view: F of fields, then, where the shutter rolls, ω and v.

    fields (n, LOCAL, F): ∂(shift, its derivatives along x, along y)/∂b, target frame. group (k,): index into
    VIEW_GROUPS. rolls: whether ω and v are there. image_height: rows. penalty (k,): λ, px² over the unit squared;
    0 leaves them free. freedom: how many of all views' coefficients the data determine.
    """

    fields: np.ndarray
    group: np.ndarray
    rolls: bool
    image_height: int
    penalty: np.ndarray
    freedom: float = 0.0

    @property
    def size(self) -> int:
        return len(self.group)

    @property
    def names(self) -> tuple[str, ...]:
        """The groups that are there."""
        return tuple(VIEW_GROUPS[index] for index in np.unique(self.group))

    def change(self, block: ViewBlock, values: np.ndarray) -> ViewChange:
        """What coefficients (B, k) do to a block's sightings."""
        count = self.fields.shape[-1]
        local = np.einsum("bnlf,bf->bnl", self.fields[block.points], values[:, :count], optimize=True)
        time = (block.pixels[1] + 0.5) / self.image_height - 0.5
        return ViewChange(local, values[:, count:] if self.rolls else None, time)

    def columns(self, block: ViewBlock, predicted: Prediction) -> np.ndarray:
        """∂pixels/∂b (2, k, B, N)."""
        fields = self.fields[:, : predicted.d_local.shape[1]][block.points]
        columns = np.einsum("rlbn,bnlf->rfbn", predicted.d_local, fields, optimize=True)
        return np.concatenate([columns, predicted.d_twist], axis=1) if self.rolls else columns

    def state_like(self, other: ViewEffects | None, values: np.ndarray, views: int) -> np.ndarray:
        """Coefficients (views, k): another model's, (views, k'), where it has the same groups; else zero."""
        if other is not None and np.array_equal(other.group, self.group):
            return values
        return np.zeros((views, self.size))

    def with_penalty(self, penalty: np.ndarray, freedom: float) -> ViewEffects:
        """penalty (k,)."""
        return replace(self, penalty=penalty, freedom=freedom)


def view_effects(
    target: ShapeModel, measured: np.ndarray, image_height: int, groups: Sequence[str] = VIEW_GROUPS
) -> ViewEffects:
    """The effects of some groups, free of any penalty. measured (n,) bool: points on which fields are orthonormal.

    A target that is not flat has no fields.
    """
    parts, group = [np.zeros((len(target.nominal), LOCAL, 0))], []
    if target.frame.planar and not {FLEX, IN_PLANE}.isdisjoint(groups):
        fields = smooth_fields(target.frame, target.nominal, measured, _HIGHEST_DEGREE)
        axes = target.frame.axes
        local = [
            np.einsum("ij,njk->nik", axes, each) for each in (fields.value, fields.slope[:, 0], fields.slope[:, 1])
        ]
        for name in (FLEX, IN_PLANE):
            if name in groups:
                kept = np.isin(fields.group, [SMOOTH_GROUPS.index(field) for field in _FIELDS[name]])
                parts.append(np.concatenate(local, axis=1)[..., kept])
                group += [VIEW_GROUPS.index(name)] * int(kept.sum())
    rolls = TURN in groups or SHIFT in groups
    group += [VIEW_GROUPS.index(name) for name in SHUTTER for _ in range(3)] * rolls
    return ViewEffects(np.concatenate(parts, axis=-1), np.array(group, int), rolls, image_height, np.zeros(len(group)))
