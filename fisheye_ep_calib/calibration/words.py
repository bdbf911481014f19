"""A calibration in words: how good the camera is, whether it has a pupil that moves, and what to record next.

Every door says it with these: command, page, node and notebook.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable
from fisheye_ep_calib.calibration.result import CalibrationResult
from fisheye_ep_calib.calibration.selecting.pupil_verdict import DOUBTFUL, FEWEST_VIEWS, NOT_DISTINGUISHABLE
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.camera.pupils import CENTRAL_MODEL

GOOD, CAUTION, BAD = "good", "caution", "bad"
_USE = {GOOD: "Use it.", CAUTION: "Use it with care.", BAD: "Do not use it."}
_LARGE_RMS = 1.0  # px; a target that is found well leaves less
_OVERFIT = 1.25  # held-out RMS over RMS
_NEAR_FAR = "near_far"
_RIM = np.radians(80)  # at which E(θ) that is left open is told, where so much was seen


@dataclass(frozen=True)
class Verdict:
    """level: GOOD, CAUTION or BAD. headline: the answer. sentences: why. next_steps: what to record next."""

    level: str
    headline: str
    sentences: tuple[str, ...]
    next_steps: tuple[str, ...]

    @property
    def use(self) -> str:
        """Whether to use the camera, in a word or two."""
        return _USE[self.level]

    def __str__(self) -> str:
        return self.headline


def pupil_sentence(result: CalibrationResult) -> str:
    """Whether the data support an entrance pupil that moves, and with how much certainty."""
    verdict = result.pupil_verdict
    if verdict.answer == NOT_DISTINGUISHABLE:
        return _left_open_sentence(result)
    angle = np.degrees(verdict.theta)
    told = f"E({angle:.0f}°) = {1e3 * verdict.pupil:+.3f} ± {1e3 * verdict.sigma:.3f} mm ({verdict.why})"
    if verdict.answer == DOUBTFUL:
        return f"entrance pupil doubtful: {told}; {_doubt(result)}"
    if result.model == CENTRAL_MODEL:
        told = f"the data support an entrance pupil, which this single-viewpoint model leaves out: {told}"
        return told if result.choice else f"{told}; try model auto"
    return "; ".join([f"entrance pupil supported: {told}", *_clearest(result), *_held_out_gain(result)])


def _clearest(result: CalibrationResult) -> list[str]:
    """Where the pupil is clearest against its σ, said of the rays; the verdict's σ where it is more than the band's."""
    camera, verdict = result.camera, result.pupil_verdict
    theta = np.radians(np.arange(10, np.floor(np.degrees(camera.theta_max)) + 1))
    if not camera.coefficients or len(theta) == 0:
        return []
    at = np.append(theta, verdict.theta)
    shift, sigma = camera.entrance_pupil(at), pupil_sigma(camera, result.uncertainty.covariance, at)
    sigma = sigma * max(1.0, verdict.sigma / max(float(sigma[-1]), 1e-300))
    best = int(np.argmax(np.abs(shift[:-1]) / np.maximum(sigma[:-1], 1e-300)))
    where = "nearer the scene" if shift[best] < 0 else "farther from the scene"
    digits = int(np.clip(np.ceil(-np.log10(max(1e3 * sigma[best], 1e-6))), 0, 4))
    size, sure = 1e3 * abs(float(shift[best])), 1e3 * float(sigma[best])
    return [f"rays {np.degrees(theta[best]):.0f}° off the axis enter {size:.{digits}f} ± {sure:.{digits}f} mm {where}"]


def _held_out_gain(result: CalibrationResult) -> list[str]:
    """What the pupil is worth on views that were left out of the fit; nothing where that was not asked."""
    central, chosen = result.comparison.get(CENTRAL_MODEL), result.comparison.get(result.model)
    if central is None or chosen is None or result.model == CENTRAL_MODEL:
        return []
    without, with_it = central.cross_validated_rms_px, chosen.cross_validated_rms_px
    if not (np.isfinite([without, with_it]).all() and min(without, with_it) > 0):
        return []
    gain = 100 * (1 - with_it / without)
    compared = f"{abs(gain):.0f} % {'better' if gain > 0 else 'worse'} than" if abs(gain) >= 0.5 else "as well as"
    return [f"views left out of the fit are predicted {compared} by a single viewpoint"]


def _doubt(result: CalibrationResult) -> str:
    """Why a pupil is doubted, and what became of it."""
    verdict = result.pupil_verdict
    why = []
    if verdict.pupil > 0:
        why.append("no lens moves its pupil that way")
    if verdict.views < FEWEST_VIEWS:
        why.append(f"{verdict.views} views claim nothing")
    if result.choice is None:
        became = "record near and far views, out to the edge of the image"
    elif verdict.kept:
        became = "the camera keeps it, for views at other distances are predicted better with it"
    elif verdict.other_distances is None:
        became = "the camera goes without it: record more views, near and far"
    else:
        became = "the camera goes without it, for views at other distances are not predicted better with it"
    return "; ".join([*why, became])


def _left_open_sentence(result: CalibrationResult) -> str:
    """E and its band, from the model with a pupil that was judged, and what a single viewpoint may lose."""
    lacks = any(finding.concern for finding in result.diagnosis.findings if finding.name in ("coverage", "depth"))
    where = (
        "the target close to the lens and out to the edge of the image, at several distances" if lacks else "more views"
    )
    advice = f"record {where}, to know"
    open_ = result.left_open
    if open_ is None:
        verdict = result.pupil_verdict
        told = f"E({np.degrees(verdict.theta):.0f}°) = {1e3 * verdict.pupil:+.2f} ± {1e3 * verdict.sigma:.2g} mm"
        return f"{told}: an entrance pupil is not supported, not distinguishable from none by these data; {advice}"
    angle = min(_RIM, result.camera.theta_max)
    shift, sigma = 1e3 * float(open_.pupil.entrance_pupil(angle)), 1e3 * float(open_.pupil.sigma(angle))
    distance, loss = min(open_.largest_loss_px(result.svp_distance).items())
    told = f"E({np.degrees(angle):.0f}°) = {shift:+.2f} ± {sigma:.2g} mm: not distinguishable from 0 by these data"
    if np.isfinite(loss):
        told += f"; a single viewpoint may lose up to {loss:.2g} px at {distance:g} m"
    return f"{told}; {advice}"


def loss_sentence(result: CalibrationResult) -> str:
    """What the camera of plain CameraInfo costs."""
    losses = ", ".join(f"{loss:.2f} px at {distance:g} m" for distance, loss in result.stand_in.loss_px.items())
    open_ = result.choice is not None and result.left_open is not None
    return f"a single-viewpoint consumer of CameraInfo {'may lose up to' if open_ else 'loses'} {losses}"


def calibration_verdict(result: CalibrationResult) -> Verdict:
    findings = result.diagnosis.findings
    concerns = [finding for finding in findings if finding.concern]
    level, headline = _headline(result, concerns)
    sentences = [
        *([sentence(f"refused: {result.refused}")] if result.refused else []),
        _fit_sentence(result),
        sentence(pupil_sentence(result)),
        *_uncertainty_sentences(result.projection_table),
    ]
    if result.rms_px > _LARGE_RMS:
        sentences.append(
            f"An RMS over {_LARGE_RMS:g} px is large: check that the target file describes the printed target, that it "
            "is flat, and that the images are sharp."
        )
    steps = tuple(sentence(finding.sentence) for finding in concerns)
    if not concerns:
        steps = ("Nothing is missing: coverage, depth and the near/far split raise no concern.",)
    return Verdict(level, headline, tuple(sentences), steps)


def _headline(result: CalibrationResult, concerns: list[Finding]) -> tuple[str, str]:
    if not result.converged:
        return BAD, "The fit did not converge: do not use this camera."
    if result.refused:
        return BAD, "Refused, and made all the same: do not use this camera."
    hidden = next((finding for finding in concerns if finding.name == _NEAR_FAR), None)
    if hidden is not None:
        return CAUTION, (
            f"Fits at the distances recorded, but {hidden.values['difference_px']:.2f} px of error may show at others."
        )
    if result.rms_px > _LARGE_RMS:
        return CAUTION, f"Converged with large residuals: {result.rms_px:.2f} px RMS."
    chosen = result.comparison.get(result.model)
    if chosen is not None and chosen.cross_validated_rms_px > _OVERFIT * chosen.rms_px:
        return CAUTION, "Fits its own views better than others: record more."
    if concerns:
        return CAUTION, "Good where it was recorded, with gaps in the recording."
    return GOOD, "A good calibration: it holds over the field and at every distance recorded."


def _fit_sentence(result: CalibrationResult) -> str:
    chosen = result.comparison.get(result.model)
    held_out = f", and {chosen.cross_validated_rms_px:.3f} px on views that were left out of the fit" if chosen else ""
    return (
        f"The residuals are {result.rms_px:.3f} px RMS over {result.points} points in {result.views} views{held_out}."
    )


def _uncertainty_sentences(table: ProjectionTable) -> list[str]:
    if len(table.theta_deg) == 0:
        return []
    inner, outer = min(3, len(table.theta_deg) - 1), len(table.theta_deg) - 1
    near, far = 0, int(np.argmax(table.distance_m))
    degrees = [f"{table.theta_deg[row]:.0f}°" for row in (inner, outer)]
    moves = [
        f"at {distance_text(table.distance_m[column])} by {table.sigma_px[inner, column]:.2g} px {degrees[0]} off the "
        f"axis and by {table.sigma_px[outer, column]:.2g} px at {degrees[1]}"
        for column in (near, far)
    ]
    return [f"What the residuals leave open (1σ) moves a projected point {moves[0]}; {moves[1]}."]


def distance_text(distance_m: float) -> str:
    return "infinity" if np.isinf(distance_m) else f"{distance_m:.3g}\u00a0m"


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    text = text.strip()
    if text[:2] not in ("E(",):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."
