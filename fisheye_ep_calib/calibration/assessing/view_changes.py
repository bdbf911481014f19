"""Whether the board bent from view to view, or something moved while the shutter rolled: findings by likelihood.

Both make the points of a view err together and each explains much of the other, so that the likelier of the two is
told, and only where it gains enough over a board and a camera that stay as they are, with a lens field or without one,
whichever is likelier. Each has two τ, which all views share, and is one of two questions: "enough" is what two τ that
are zero gain by chance (``chance_gain``) in half of the share of recordings that may be told a change where there is
none. What is significant and moves the points by next to nothing is not told.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.estimating.joint_posterior import LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import JointVariances
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHIFT, SHUTTER, TURN
from fisheye_ep_calib.calibration.selecting.pupil_verdict import FEWEST_FOR_MODELS
from fisheye_ep_calib.target.shape.model import GROUPS
from fisheye_ep_calib.target.shape.variances import chance_gain

_FALSE = 0.01  # of recordings in which nothing changes, that may be told a change
_SHARE = 0.05  # of the corner noise, that a change is worth a word
_COEFFICIENTS = 3  # of a view, that do most of what a change does to it


@dataclass(frozen=True)
class ViewChanges:
    """Of each finding by how much −2 log-likelihood falls with it, and what it moves, px RMS of (dx, dy) like noise_px.

    deviation: τ by group (view_effects.py). square_px (V,): what it does to the points of each view a priori, px²,
    summed.
    """

    gain: dict[str, float]
    deviation: dict[str, float]
    visible_px: dict[str, float]
    noise_px: dict[str, float]
    square_px: dict[str, np.ndarray]

    def raised(self, name: str) -> bool:
        enough = self.gain[name] >= least_gain() and self.visible_px[name] >= _SHARE * self.noise_px[name]
        return enough and len(self.square_px[name]) >= FEWEST_FOR_MODELS and self.gain[name] == max(self.gain.values())

    @property
    def told(self) -> str | None:
        """The finding that is raised."""
        return next((name for name in self.gain if self.raised(name)), None)

    def explained_px(self, name: str, counts: np.ndarray) -> np.ndarray:
        """RMS (V,) that a change may have in views of so many points (V,).

        The largest of V views has as much once in a hundred recordings: most of it is the square of a few coefficients.
        """
        from scipy.special import chdtri  # scipy.stats would take half a second more to load

        most = chdtri(_COEFFICIENTS, _FALSE / len(counts)) / _COEFFICIENTS
        explained: np.ndarray = np.sqrt(most * self.square_px[name] / np.maximum(counts, 1))
        return explained


BOARD_FLEXES, ROLLING_SHUTTER = "board_flexes", "rolling_shutter"  # the findings
_GROUPS = {BOARD_FLEXES: (FLEX, IN_PLANE), ROLLING_SHUTTER: SHUTTER}


def least_gain() -> float:
    """Of −2 log-likelihood, that raises a finding."""
    return chance_gain(len(SHUTTER), _FALSE / len(_GROUPS))


def view_changes(found: JointVariances) -> ViewChanges:
    """Raises numpy.linalg.LinAlgError where the sightings leave something open."""
    kinds = GROUPS, (*GROUPS, *LENS_GROUPS)
    deviances = [posterior.deviance(variances) for variances, posterior in map(found.most_likely, kinds)]
    still = int(np.argmin(deviances))
    changes = ViewChanges({}, {}, {}, {}, {})
    for name, groups in _GROUPS.items():
        variances, posterior = found.most_likely((*kinds[still], *groups))
        square = found.linearisation.visible(variances, posterior, groups) / found.linearisation.point_count
        changes.gain[name] = deviances[still] - posterior.deviance(variances)
        changes.deviation.update({group: float(variances.deviation[found.index(group)]) for group in groups})
        changes.visible_px[name] = float(np.sqrt(square))
        changes.noise_px[name] = float(np.sqrt(2)) * variances.noise
        changes.square_px[name] = found.linearisation.expected_square(variances, groups)
    return changes


def changes_found(changes: ViewChanges, estimated: Collection[str] = ()) -> tuple[Finding, Finding]:
    """``board_flexes`` and ``rolling_shutter``; estimated: groups of which the fit has coefficients already."""
    flex_option = "" if FLEX in estimated or IN_PLANE in estimated else "; --flex estimates it"
    shutter_option = "" if TURN in estimated or SHIFT in estimated else "; --rolling-shutter estimates it"
    flex, stretch = (1e3 * changes.deviation[group] for group in (FLEX, IN_PLANE))
    turn, shift = np.degrees(changes.deviation[TURN]), 1e3 * changes.deviation[SHIFT]
    return (
        _finding(
            changes,
            BOARD_FLEXES,
            {"flex_mm": flex, "in_plane_mm": stretch},
            f"the board bent between views (by {flex:.2f} mm, in its plane by {stretch:.2f} mm), which moves its "
            "points by {:.2f} px: use a stiff one" + flex_option,
            "the board keeps its shape from view to view",
        ),
        _finding(
            changes,
            ROLLING_SHUTTER,
            {"turn_deg": turn, "shift_mm": shift},
            f"camera or board moved while the shutter rolled (by {turn:.2f}° and {shift:.2f} mm within an image), "
            "which moves the points by {:.2f} px: hold both still" + shutter_option,
            "nothing moved while the shutter rolled, or it does not roll",
        ),
    )


def _finding(changes: ViewChanges, name: str, values: dict[str, float], told: str, nothing: str) -> Finding:
    raised, moved = changes.raised(name), changes.visible_px[name]
    values = {"gain": changes.gain[name], "visible_px": moved, **values}
    if len(changes.square_px[name]) < FEWEST_FOR_MODELS:
        nothing = f"fewer than {FEWEST_FOR_MODELS} views do not tell a change from view to view"
    return Finding(name, values, raised, told.format(moved) if raised else nothing)
