"""Where the residuals of a calibration come from, in pixels: corner noise, the target, the lens, what changes by view.

One likelihood (estimating/joint_posterior.py) holds them all: the target's shape, smooth and point by point; a lens
field that is not symmetric, which is what any of the lens models leaves; and what differs from view to view, either a
board that flexes and stretches or a motion while the shutter rolls, whichever is likelier. Every share is what that
source does to the residuals of the camera and the poses fitted without it. Shares are not quite independent, as one
source may pass for another in part; together, as squares, they come near the RMS of a target taken as flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit
from fisheye_ep_calib.calibration.estimating.joint_posterior import LENS_GROUPS
from fisheye_ep_calib.calibration.estimating.joint_variances import joint_variances
from fisheye_ep_calib.calibration.estimating.view_effects import FLEX, IN_PLANE, SHUTTER, VIEW_GROUPS
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.target.shape.basis import SMOOTH_GROUPS
from fisheye_ep_calib.target.shape.model import GROUPS, ROUGH_GROUPS

_NEEDED = 2.0  # of −2 log-likelihood, that a smooth field of the target gains at least
_LIMITS = 0.5  # of the corner noise: a source that is less is not worth a word


@dataclass(frozen=True)
class ErrorBudget:
    """Root mean squares of (dx, dy) like ``rms_px``, so that a noise of σ a coordinate counts √2 σ.

    corner_noise_px: what is left. board_px: the target's smooth shape. board_rough_px: single points that are off.
    lens_px: what a lens model that is symmetric leaves. view_px: what differs from view to view. rolling: whether that
    is a motion while the shutter rolls. lens_field: whether the camera has a field that is not symmetric.
    """

    corner_noise_px: float
    board_px: float
    board_rough_px: float
    lens_px: float
    view_px: float
    rolling: bool = False
    lens_field: bool = False

    def to_dict(self) -> dict[str, float]:
        """The numbers that programs read."""
        return {name: value for name, value in asdict(self).items() if name.endswith("_px")}

    @property
    def sentence(self) -> str:
        """What would help most."""
        shares = {
            "board": self.board_px,
            "points": self.board_rough_px,
            "held lens" if self.lens_field else "lens": self.lens_px,
            "motion" if self.rolling else "flex": self.view_px,
        }
        source, most = max(shares.items(), key=lambda item: item[1])
        if most < _LIMITS * self.corner_noise_px:
            return (
                f"corner noise limits you ({self.corner_noise_px:.2f} px): sharper, brighter images or more views "
                "would help, a better board would not"
            )
        return _ADVICE[source].format(most)


_ADVICE = {
    "board": "your board limits you, not your lens ({:.2f} px): glue it to glass; its shape is estimated beside the "
    "camera where that predicts better",
    "points": "single points of your board are off ({:.2f} px): print it anew, larger or with a better printer",
    "lens": "your lens limits you ({:.2f} px): it is not symmetric about its axis; --lens-field describes that",
    "held lens": "your lens limits you ({:.2f} px): it is not symmetric about its axis; the lens field beside it takes "
    "that up as far as views agree",
    "flex": "your board bends between views ({:.2f} px): use a stiff one",
    "motion": "camera or board moved while the shutter rolled ({:.2f} px): hold both still, or use a tripod",
}


def error_budget(fit: Fit) -> ErrorBudget:
    """Of a fit. Raises numpy.linalg.LinAlgError where the sightings leave something open."""
    found = joint_variances(fit)
    models = [found.most_likely((*GROUPS, *LENS_GROUPS, *views)) for views in ((FLEX, IN_PLANE), SHUTTER)]
    best = min(range(2), key=lambda index: models[index][1].deviance(models[index][0]))
    # A smooth field that is not there takes part of what single points are off by, were it let.
    variances, posterior = found.without_needless(*models[best], SMOOTH_GROUPS, _NEEDED)
    count, unit = found.linearisation.point_count, fit.sightings.usual_weight

    def share(groups: Sequence[str]) -> float:
        return float(np.sqrt(found.linearisation.visible(variances, posterior, groups) / count)) / unit

    return ErrorBudget(
        float(np.sqrt(2)) * variances.noise / unit,
        share(SMOOTH_GROUPS),
        share(ROUGH_GROUPS),
        share(LENS_GROUPS),
        share(VIEW_GROUPS),
        bool(best == 1 and variances.deviation[[found.index(name) for name in SHUTTER]].any()),
        LENS_FIELD.name in fit.structure.extras,
    )
