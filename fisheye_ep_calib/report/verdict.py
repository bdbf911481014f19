"""The answer in words: how good a camera is, and what to record next."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.assessing.diagnosis import Finding
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable
from fisheye_ep_calib.report.data import BAD, CAUTION, GOOD, Verdict

_LARGE_RMS = 1.0  # px; a target that is found well leaves less
_OVERFIT = 1.25  # held-out RMS over RMS
_NEAR_FAR = "near/far split"


def calibration_verdict(result: CalibrationResult, pupil_sentence: str) -> Verdict:
    findings = result.diagnosis.findings
    concerns = [one for one in findings if one.concern]
    level, headline = _headline(result, concerns)
    sentences = [_fit_sentence(result), sentence(pupil_sentence), *_uncertainty_sentences(result.projection_table)]
    if result.rms_px > _LARGE_RMS:
        sentences.append(
            f"An RMS over {_LARGE_RMS:g} px is large: check that the target file describes the printed target, that it "
            "is flat, and that the images are sharp."
        )
    steps = tuple(sentence(one.sentence) for one in concerns)
    if not concerns:
        steps = ("Nothing is missing: coverage, depth and the near/far split raise no concern.",)
    return Verdict(level, headline, tuple(sentences), steps)


def _headline(result: CalibrationResult, concerns: list[Finding]) -> tuple[str, str]:
    if not result.converged:
        return BAD, "The fit did not converge: do not use this camera."
    hidden = next((one for one in concerns if one.name == _NEAR_FAR), None)
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
    said = [
        f"at {distance_text(table.distance_m[column])} by {table.sigma_px[inner, column]:.2g} px {degrees[0]} off the "
        f"axis and by {table.sigma_px[outer, column]:.2g} px at {degrees[1]}"
        for column in (near, far)
    ]
    return [f"What the residuals leave open (1σ) moves a projected point {said[0]}; {said[1]}."]


def distance_text(distance_m: float) -> str:
    return "infinity" if np.isinf(distance_m) else f"{distance_m:.3g}\u00a0m"


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    text = text.strip()
    if text[:2] not in ("E(",):
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else f"{text}."
