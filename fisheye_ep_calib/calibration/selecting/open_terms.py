"""The chosen pupil with its further terms left open, as far as other lenses have them.

A choice of two terms says that the data do not tell a third, not that the lens has none. Left out, it is missing from
the estimate and from its band: two terms of a traced lens's E may be off by several of the σ that they claim, and no
test of the residuals sees it. So an even pupil is fitted once more as the series of four terms, those that the data do
not support under a prior (calibration/pupil_prior.py): estimate and covariance are then those of the posterior.
"""

from __future__ import annotations

from dataclasses import replace

from fisheye_ep_calib.calibration.estimating.fit import Fit, refine
from fisheye_ep_calib.calibration.pupil_prior import MODEL, ROOM, TERMS, PupilPrior
from fisheye_ep_calib.calibration.selecting.candidates import FREER, log_likelihood_gain, with_addition
from fisheye_ep_calib.calibration.structure import FREER_LENS, LENS

_WORTH = 4.6  # of log-likelihood: what two needless parameters gain once in a hundred, ½ χ²


def with_open_terms(fit: Fit, lens_open: bool) -> Fit:
    """A fit with an even pupil as series of four terms, the ones that it has free, the further ones under their prior.

    lens_open: whether r(θ) may have six terms. Six are taken where they gain what chance does not give, for what four
    leave of a lens, the further terms of E would take up. The fit is returned as it is where its family explains that
    much more than the series, and where E > 0: no lens has that sign, and of what else it may be nothing is known.
    """
    if fit.state.camera.entrance_pupil(fit.largest_angle) >= 0:
        return fit
    prior = PupilPrior.like(fit.state.camera, fit.largest_angle, min(fit.structure.pupil_terms, TERMS))
    with_room = replace(prior, room=ROOM)
    own = with_room if fit.structure.lens == FREER_LENS else prior
    series = refine(fit, replace(fit.structure, model=MODEL, terms=TERMS, pupil_prior=own))
    if lens_open and fit.structure.lens == LENS:
        freer = refine(series, replace(with_addition(series.structure, FREER), pupil_prior=with_room))
        if log_likelihood_gain(freer, series) > _WORTH:
            series = freer
    return fit if log_likelihood_gain(fit, series) > _WORTH else series
