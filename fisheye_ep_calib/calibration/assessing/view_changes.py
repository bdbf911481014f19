"""Whether the board bent from view to view, or something moved while the shutter rolled: findings by likelihood.

Both make the points of a view err together and each explains much of the other, so that the likelier of the two is
told, and only where it gains enough over a board and a camera that stay as they are, with a lens field or without one.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.joint_posterior import LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import JointVariances
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHIFT, SHUTTER, TURN
from fisheye_ep_calib.target.shape.model import GROUPS

GATE = 35.0  # of −2 log-likelihood: below it corners that err together by themselves gain as much


@dataclass(frozen=True)
class ViewChanges:
    """Of each finding by how much −2 log-likelihood falls with it, and what it moves, px RMS.

    deviation: τ by group (view_effects.py).
    """

    gain: dict[str, float]
    deviation: dict[str, float]
    visible_px: dict[str, float]

    def raised(self, name: str) -> bool:
        return self.gain[name] >= GATE and self.gain[name] == max(self.gain.values())


_GROUPS = {"board_flexes": (FLEX, IN_PLANE), "rolling_shutter": SHUTTER}


def view_changes(found: JointVariances) -> ViewChanges:
    """Raises numpy.linalg.LinAlgError where the sightings leave something open."""
    still = [found.most_likely(groups) for groups in (GROUPS, (*GROUPS, *LENS_GROUPS))]
    least = min(posterior.deviance(variances) for variances, posterior in still)
    gain: dict[str, float] = {}
    deviation: dict[str, float] = {}
    visible: dict[str, float] = {}
    for name, groups in _GROUPS.items():
        variances, posterior = found.most_likely((*GROUPS, *groups))
        gain[name] = least - posterior.deviance(variances)
        deviation |= {group: float(variances.deviation[found.index(group)]) for group in groups}
        square = found.linearisation.visible(variances, posterior, groups) / found.linearisation.point_count
        visible[name] = float(np.sqrt(square))
    return ViewChanges(gain, deviation, visible)


def changes_found(changes: ViewChanges, estimated: Collection[str] = ()) -> tuple[Finding, Finding]:
    """``board_flexes`` and ``rolling_shutter``; estimated: groups of which the fit has coefficients already."""
    flex_option = "" if FLEX in estimated or IN_PLANE in estimated else "; --flex estimates it"
    shutter_option = "" if TURN in estimated or SHIFT in estimated else "; --rolling-shutter estimates it"
    flex, stretch = (1e3 * changes.deviation[group] for group in (FLEX, IN_PLANE))
    turn, shift = np.degrees(changes.deviation[TURN]), 1e3 * changes.deviation[SHIFT]
    return (
        _finding(
            changes,
            "board_flexes",
            {"flex_mm": flex, "in_plane_mm": stretch},
            f"the board bent between views (by {flex:.2f} mm, in its plane by {stretch:.2f} mm), which moves its "
            "points by {:.2f} px: use a stiff one" + flex_option,
            "the board keeps its shape from view to view",
        ),
        _finding(
            changes,
            "rolling_shutter",
            {"turn_deg": turn, "shift_mm": shift},
            f"camera or board moved while the shutter rolled (by {turn:.2f}° and {shift:.2f} mm within an image), "
            "which moves the points by {:.2f} px: hold both still" + shutter_option,
            "nothing moved while the shutter rolled, or it does not roll",
        ),
    )


def _finding(changes: ViewChanges, name: str, values: dict[str, float], told: str, nothing: str) -> Finding:
    raised, moved = changes.raised(name), changes.visible_px[name]
    values = {"gain": changes.gain[name], "visible_px": moved, **values}
    return Finding(name, values, raised, told.format(moved) if raised else nothing)
