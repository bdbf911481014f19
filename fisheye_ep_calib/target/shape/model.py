"""How a target may depart from what its file says, and how it does.

    X_i = nominal_i + given_i + Σ_k a_k φ_k(i) + A_i ρ_i

given: a shape measured before. φ: smooth fields with coefficients a (basis.py, or the three of bow.py). ρ_i: what the
point i is off by itself, along the axes A_i of its plane. Smooth coefficients and ρ carry penalties,
½ Σ λ_k a_k² + ½ Σ λ ρ², λ = σ²/τ² with the noise σ² in px² and the prior variances τ² in m²; 0 leaves them free.

The boundary of a disc bends with the board: its tangents are e_x + ∂X/∂x and e_y + ∂X/∂y of the smooth part.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.target.shape.basis import SMOOTH_GROUPS, smooth_fields
from fisheye_ep_calib.target.shape.bow import bow_height, bow_slope
from fisheye_ep_calib.target.shape.faces import faces_of
from fisheye_ep_calib.target.shape.frame import BoardFrame, board_frame
from fisheye_ep_calib.target.shape.variances import Posterior, Variances

FLAT, BOW, FREE = "flat", "bow", "free"
ROUGH_GROUPS = ("rough z", "rough xy")
GROUPS = (*SMOOTH_GROUPS, *ROUGH_GROUPS)
FIRST_DEVIATIONS = np.array([1e-4] * len(SMOOTH_GROUPS) + [2e-5] * len(ROUGH_GROUPS))  # τ, m, where nothing is known
REVIVED_DEVIATION = 2e-6  # τ, metres, with which a group that was left out gets another chance
AXIS_GROUP = len(SMOOTH_GROUPS) + np.array([1, 1, 0])  # group of a point's own shift along x, y and the normal
_NONE = 1e-9  # metres: τ of an axis along which no point moves by itself
LOCAL = 9  # numbers of a point's deformation: its shift, and the derivatives of the shift along x and y


@dataclass(frozen=True)
class Surface:
    """Where the target's points are. points (n, 3): metres. tangents (n, 2, 3): along its x and y, 1 on flat boards."""

    points: np.ndarray
    tangents: np.ndarray


@dataclass(frozen=True)
class ShapeModel:
    """What is free of a target's shape.

    nominal: the points (n, 3) as the file has them. frame: of the plane. given (n, LOCAL): a shape held fixed, target
    frame. fields (n, LOCAL, S): ∂(shift, its derivatives along x, along y)/∂a, target frame. group (S,): index into
    GROUPS, −1 for a bow's. penalty (S,) and rough_penalty (n, 3): λ, px²/m²; None where no point moves by itself.
    freedom: how many of the unknowns the data determine. names (S,): of the fields, by which models share them.
    variances: of the groups, from which the penalties are. axes (n, 3, 3): of each point's face; the frame's where
    None.
    """

    kind: str
    nominal: np.ndarray
    frame: BoardFrame
    given: np.ndarray
    fields: np.ndarray
    group: np.ndarray
    penalty: np.ndarray
    rough_penalty: np.ndarray | None = None
    freedom: float = 0.0
    names: tuple[int, ...] = ()
    variances: Variances | None = None
    axes: np.ndarray | None = None

    @property
    def point_axes(self) -> np.ndarray:
        """(n, 3, 3): columns x, y, normal of each point's face, along which its own shift is."""
        return np.tile(self.frame.axes, (len(self.nominal), 1, 1)) if self.axes is None else self.axes

    @property
    def smooth_size(self) -> int:
        return len(self.penalty)

    @property
    def rough_size(self) -> int:
        return 0 if self.rough_penalty is None else self.rough_penalty.size

    @property
    def size(self) -> int:
        """Shared parameters of the shape: smooth coefficients, then every point's own three."""
        return self.smooth_size + self.rough_size

    @property
    def all_penalties(self) -> np.ndarray:
        """Of the unknowns in the order of ``ShapeState.vector``, (S + 3n,)."""
        rough = np.zeros(0) if self.rough_penalty is None else self.rough_penalty.reshape(-1)
        return np.concatenate([self.penalty, rough])

    def state_like(self, other: ShapeModel, state: ShapeState) -> ShapeState:
        """Another model's state in this one's unknowns: coefficients of the same fields, and the points' own shifts."""
        smooth = self.start().smooth
        if self.kind == other.kind:
            theirs = dict(zip(other.names, state.smooth, strict=True))
            smooth = np.array([theirs.get(name, 0.0) for name in self.names])
        rough = state.rough if len(state.rough) else np.zeros(self.nominal.shape)
        return ShapeState(smooth, rough if self.rough_size else np.zeros((0, 3)))

    def start(self) -> ShapeState:
        return ShapeState(np.zeros(self.smooth_size), np.zeros((len(self.nominal) if self.rough_size else 0, 3)))

    def local(self, state: ShapeState) -> np.ndarray:
        """Shift of every point and its derivatives along x and y, (n, LOCAL), target frame."""
        local: FloatArray = self.given + self.local_change(state.vector)
        return local

    def local_change(self, unknowns: np.ndarray) -> np.ndarray:
        """(n, LOCAL, ...) for unknowns in the order of ``ShapeState.vector``, (S + 3n, ...)."""
        count = self.smooth_size
        local = np.tensordot(self.fields, unknowns[:count], axes=1)
        if self.rough_size and len(unknowns) > count:
            rough = unknowns[count:].reshape(-1, 3, *unknowns.shape[1:])
            local[:, :3] += np.einsum("nij,nj...->ni...", self.point_axes, rough)
        return local

    def surface(self, state: ShapeState) -> Surface:
        local = self.local(state)
        slopes = local[:, 3:].reshape(-1, 2, 3)
        return Surface(self.nominal + local[:, :3], self.frame.axes[:, :2].T + slopes)


@dataclass(frozen=True)
class ShapeState:
    """smooth (S,): coefficients a, metres. rough (n, 3): ρ, metres along the frame's axes, or none at all (0, 3)."""

    smooth: np.ndarray = field(default_factory=lambda: np.zeros(0))
    rough: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def vector(self) -> np.ndarray:
        """All unknowns (S + 3n,): smooth, then rough by point and axis."""
        return np.concatenate([self.smooth, self.rough.reshape(-1)])

    def moved(self, step: np.ndarray) -> ShapeState:
        """After a step (S + 3n,)."""
        count = len(self.smooth)
        return ShapeState(self.smooth + step[:count], self.rough + step[count:].reshape(-1, 3))


def flat_model(object_points: np.ndarray, given: np.ndarray | None = None) -> ShapeModel:
    """The target as its file has it, or as it was measured: given (n, LOCAL)."""
    count = len(object_points)
    given = np.zeros((count, LOCAL)) if given is None else given
    none = np.zeros(0)
    return ShapeModel(
        FLAT, object_points, board_frame(object_points), given, np.zeros((count, LOCAL, 0)), none.astype(int), none
    )


def bow_model(flat: ShapeModel) -> ShapeModel:
    """With a bow on top of it, free of any penalty."""
    height, slope = bow_height(flat.frame, flat.nominal), bow_slope(flat.frame, flat.nominal)
    normal = flat.frame.axes[:, 2]
    parts = [normal[:, None] * part[:, None] for part in (height, slope[:, 0], slope[:, 1])]
    fields = np.concatenate(parts, axis=1)
    return replace(flat, kind=BOW, fields=fields, group=np.full(3, -1), penalty=np.zeros(3), names=(0, 1, 2))


def free_model(flat: ShapeModel, measured: np.ndarray) -> ShapeModel:
    """With all smooth fields, orthonormal over the points measured (n,) bool, and every point's own shift on top of it.

    Each face of a target that is not flat has fields of its own; they share their groups.
    """
    parts, groups = [np.zeros((len(flat.nominal), LOCAL, 0))], []
    axes = np.tile(flat.frame.axes, (len(flat.nominal), 1, 1))
    for face in faces_of(flat.nominal):
        points = flat.nominal[face]
        frame = board_frame(points)
        fields = smooth_fields(frame, points, measured[face])
        local = [
            np.einsum("ij,njk->nik", frame.axes, part)
            for part in (fields.value, fields.slope[:, 0], fields.slope[:, 1])
        ]
        own = np.zeros((len(flat.nominal), LOCAL, len(fields.group)))
        own[face] = np.concatenate(local, axis=1)
        axes[face] = frame.axes
        parts.append(own)
        groups.append(fields.group)
    group = np.concatenate(groups) if groups else np.zeros(0, int)
    return replace(
        flat,
        kind=FREE,
        fields=np.concatenate(parts, axis=-1),
        group=group,
        penalty=np.zeros(len(group)),
        rough_penalty=np.zeros(flat.nominal.shape),
        names=tuple(range(len(group))),
        axes=axes,
    )


def with_variances(free: ShapeModel, variances: Variances, posterior: Posterior) -> ShapeModel:
    """The fields and shifts of a free model that have a variance, with their penalties."""
    present = variances.deviation > 0
    kept = np.flatnonzero(present[free.group])
    penalties = np.minimum(variances.penalties, variances.noise**2 / _NONE**2)
    rough = None
    if present[AXIS_GROUP].any():
        rough = np.tile(penalties[AXIS_GROUP], (len(free.nominal), 1))
    return replace(
        free,
        fields=free.fields[..., kept],
        group=free.group[kept],
        penalty=penalties[free.group[kept]],
        rough_penalty=rough,
        freedom=float(posterior.determined(variances).sum()),
        names=tuple(free.names[index] for index in kept),
        variances=variances,
    )
