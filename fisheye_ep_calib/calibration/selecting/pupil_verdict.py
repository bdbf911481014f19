"""Whether the data support an entrance pupil that moves: supported, doubtful, or not distinguishable from none.

E at an angle is held against a σ that holds three things: what the noise leaves open, how much views scatter, and by
how much E changes from one model to another of what else may have moved the points (a nuisance model):

    σ_tot² = max(σ_posterior, σ_views)² + Var over models of E,      E from the likeliest of them

The angle is the one where a pupil would be clearest, whatever its size: where a θ², the leading term of every lens that
is symmetric about its axis, is largest against σ_posterior. It follows from where the views are and not from what they
say, so that looking at it is one test and not many.

σ_views is the sandwich over views (Cameron and Miller, J. Human Resources 50, 2015). Supported: |E| > 3 σ_tot, and the
nested test that lets residuals of a view correlate agrees. E > 0 is the sign that no lens has: it takes 10 σ_tot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fisheye_ep_calib.calibration.estimating.fit import Fit, independent_covariance
from fisheye_ep_calib.calibration.estimating.normal_equations import view_robust_covariance
from fisheye_ep_calib.calibration.estimating.nuisance_models import NuisanceModel, nuisance_models
from fisheye_ep_calib.calibration.selecting.nested_tests import nested_test
from fisheye_ep_calib.camera.parameters import pupil_names

SUPPORTED, DOUBTFUL, NOT_DISTINGUISHABLE = "supported", "doubtful", "not distinguishable"
_ANGLES = np.linspace(0.2, 1.0, 33)  # of the largest angle seen: where a pupil may be judged
_CLAIM, _DOUBT = 3.0, 2.0  # σ_tot
_WRONG_SIGN = 10.0  # σ_tot for E > 0
_SIGNIFICANCE, _HINT = 0.0027, 0.01  # of the clustered test: what 3 σ are, and what raises a doubt
FEWEST_VIEWS = 4  # that claim a pupil
FEWEST_FOR_MODELS = 6  # views; fewer do not tell one model from another


@dataclass(frozen=True)
class PupilVerdict:
    """All that decided. model: the family of pupils that was judged. theta: the angle, rad. pupil: E there, metres.

    sigma_posterior, sigma_views, sigma_models: the parts of σ_tot, metres. p_value: of the clustered nested test.
    models: that were weighed; likeliest: which of them E is from. other_distances: whether views at other distances
    are predicted better with the pupil; None where that was not asked. kept: whether the camera has the pupil.
    """

    answer: str
    model: str
    theta: float
    pupil: float
    sigma_posterior: float
    sigma_views: float
    sigma_models: float
    p_value: float
    views: int
    models: tuple[NuisanceModel, ...]
    likeliest: str
    other_distances: bool | None = None
    kept: bool = False

    @property
    def sigma(self) -> float:
        """σ_tot, metres."""
        return float(np.hypot(max(self.sigma_posterior, self.sigma_views), self.sigma_models))

    @property
    def ratio(self) -> float:
        """|E| over σ_tot."""
        return abs(self.pupil) / max(self.sigma, 1e-300)

    @property
    def supported(self) -> bool:
        """Whether both say so: E beyond 3 σ_tot, and the clustered test."""
        return self.ratio > _CLAIM and self.p_value < _SIGNIFICANCE

    @property
    def why(self) -> str:
        """What decided, in numbers."""
        told = f"{self.ratio:.1f} σ"
        if self.sigma_models > 0:
            told += f" over {len(self.models)} models of what else may move points"
        return f"{told}, clustered test p = {self.p_value:.2g}"

    def to_dict(self) -> dict[str, object]:
        """The numbers that programs read; lengths in millimetres."""
        return {
            "answer": self.answer,
            "model": self.model,
            "theta_deg": float(np.degrees(self.theta)),
            "E_mm": 1e3 * self.pupil,
            "sigma_mm": 1e3 * self.sigma,
            "sigma_posterior_mm": 1e3 * self.sigma_posterior,
            "sigma_views_mm": 1e3 * self.sigma_views,
            "sigma_models_mm": 1e3 * self.sigma_models,
            "p_value": self.p_value,
            "models": {
                each.name: {"E_mm": 1e3 * float(each.pupil[0]), "deviance": each.deviance} for each in self.models
            },
            "likeliest": self.likeliest,
            "other_distances": self.other_distances,
            "kept": self.kept,
        }


def judge(pupil: Fit, central: Fit) -> PupilVerdict:
    """The verdict on a fit with a pupil, beside the same with a single viewpoint."""
    theta, posterior, over_views = _clearest(pupil)
    models = _models(pupil, theta, posterior)
    likeliest = min(models, key=lambda each: each.deviance)
    verdict = PupilVerdict(
        "",
        pupil.structure.model,
        theta,
        float(likeliest.pupil[0]),
        max(posterior, float(likeliest.sigma[0])),
        over_views,
        float(np.std([each.pupil[0] for each in models])),
        nested_test(pupil, central),
        len(pupil.sightings.images),
        models,
        likeliest.name,
    )
    return _answered(verdict)


def _models(fit: Fit, theta: float, posterior: float) -> tuple[NuisanceModel, ...]:
    """What else may have moved the points; of few views, or where they leave something open, the fit alone."""
    angles = np.array([theta])
    if len(fit.sightings.images) >= FEWEST_FOR_MODELS and fit.problem.loss.kind == "linear":
        try:
            return nuisance_models(fit, angles)
        except np.linalg.LinAlgError:
            pass
    own = fit.state.camera.entrance_pupil(angles)
    return (NuisanceModel("shape", 0.0, own, np.array([posterior]), fit.sigma_px, {}),)


def _answered(verdict: PupilVerdict) -> PupilVerdict:
    if verdict.supported:
        wrong_sign = verdict.pupil > 0 and verdict.ratio < _WRONG_SIGN
        answer = DOUBTFUL if wrong_sign or verdict.views < FEWEST_VIEWS else SUPPORTED
    else:
        hinted = verdict.ratio > _DOUBT or verdict.p_value < _HINT
        answer = DOUBTFUL if hinted else NOT_DISTINGUISHABLE
    return replace(verdict, answer=answer, kept=answer == SUPPORTED)


def _clearest(fit: Fit) -> tuple[float, float, float]:
    """The angle, rad, where a pupil would be clearest, and σ of E there, metres: of noise and of views' scatter.

    The largest angle seen and infinite σ where the data leave E open.
    """
    camera, angles = fit.state.camera, fit.largest_angle * _ANGLES
    names, _ = fit.shared_parameters
    basis = camera.pupil_family.basis(angles, len(camera.coefficients))
    rows = np.zeros((len(angles), len(names)))
    rows[:, [names.index(name) for name in pupil_names(len(basis))]] = basis.T
    try:
        _, independent = independent_covariance(fit)
        robust = view_robust_covariance(fit.settled)
    except np.linalg.LinAlgError:
        return float(angles[-1]), np.inf, np.inf
    posterior = [_root(fit.clustering * (row @ independent @ row)) for row in rows]
    best = int(np.argmax(angles**2 / np.maximum(posterior, 1e-300)))
    return float(angles[best]), posterior[best], _root(rows[best] @ robust @ rows[best])


def _root(variance: float) -> float:
    return float(np.sqrt(variance)) if variance >= 0 else np.inf
