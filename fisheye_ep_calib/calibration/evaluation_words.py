"""A camera measured on other data, in words and as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.assessing.coverage import azimuth_and_distance
from fisheye_ep_calib.calibration.assessing.diagnosis import Finding
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation
from fisheye_ep_calib.calibration.content import findings_content
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.words import BAD, CAUTION, GOOD, Verdict, sentence

_HOLDS, _FAILS = 1.25, 2.0  # RMS over what the calibration's own noise leads to expect
_UNEVEN = 1.5  # RMS of the nearer over the farther third of the views, or the other way round


def expected_rms(found: Evaluation, noise_px: float | None) -> float | None:
    """What the calibration's noise leads to expect with the poses refitted: √(2 σ² (2M − 6V)/(2M)), px.

    noise_px: σ of one coordinate; None where it is not known.
    """
    if not isinstance(noise_px, int | float) or not noise_px > 0:
        return None
    free = max(1 - 6 * len(found.images) / max(2 * found.points, 1), 0.1)
    return float(noise_px) * float(np.sqrt(2 * free))


def evaluation_verdict(found: Evaluation, expected_px: float | None, findings: tuple[Finding, ...]) -> Verdict:
    """Whether the camera holds. expected_px: as ``expected_rms`` gives it."""
    told = f"The residuals are {found.rms_px:.3f} px RMS over {found.points} points in {len(found.images)} views, "
    told += "every view's pose refitted and the camera as the file has it."
    concerns = tuple(sentence(one.sentence) for one in findings if one.concern)
    steps = concerns or ("Nothing stands out by distance, angle or view.",)
    if expected_px is None:
        return Verdict(CAUTION, f"{found.rms_px:.3f} px RMS on this recording.", (told,), steps)
    ratio = found.rms_px / expected_px
    compared = (
        f"The noise of its own calibration leads to expect {expected_px:.3f} px: {ratio:.2f} times that was found."
    )
    level, headline = _level(ratio, bool(concerns))
    return Verdict(level, headline, (told, compared), steps)


def _level(ratio: float, concerns: bool) -> tuple[str, str]:
    """ratio: of the RMS found over the RMS expected."""
    if ratio > _FAILS:
        return BAD, "The camera does not hold on this recording."
    if ratio > _HOLDS:
        return CAUTION, "The camera holds less well here than where it was calibrated."
    if concerns:
        return CAUTION, "The camera holds on this recording, with reservations."
    return GOOD, "The camera holds on this recording."


def evaluation_findings(
    found: Evaluation, observations: Observations, theta_max: float, bow_m: float = 0.0
) -> tuple[Finding, ...]:
    """theta_max: rad, where the calibration's evidence ends. bow_m: metres, of a target that was taken as flat though
    the calibration found it bent.
    """
    used = used_sightings(found, observations)
    _, distance = azimuth_and_distance(observations, found.images, found.camera_from_target, used)
    square = (found.error[used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
    findings = [_beyond_evidence(found.theta[used], theta_max), *_near_against_far(distance, square)]
    if bow_m > 0:
        told = (
            f"the target of the calibration is bent by {1e3 * bow_m:.2f} mm; if this is the same one, take its bow too"
        )
        findings.append(Finding("board_bent", {"bow_mm": 1e3 * bow_m}, True, told))
    if count := len(found.failed):
        told = f"{count} views have no pose in this camera"
        findings.append(Finding("views_without_a_pose", {"views": float(count)}, True, told))
    return tuple(findings)


def used_sightings(found: Evaluation, observations: Observations) -> np.ndarray:
    """(M,) bool: the observations that were measured."""
    return np.isfinite(found.error[:, 0]) & (observations.weights > 0) & np.isin(observations.image_index, found.images)


def _beyond_evidence(theta: np.ndarray, limit: float) -> Finding:
    share = float((theta > limit).mean())
    told = f"{100 * share:.1f} % of the points lie beyond {np.degrees(limit):.0f}°, where the calibration saw nothing"
    return Finding("beyond_the_calibrated_field", {"share": share}, share > 0.01, told)


def _near_against_far(distance: np.ndarray, square: np.ndarray) -> list[Finding]:
    """RMS of the nearest against that of the farthest third of the sightings; square: px²."""
    near, far = np.quantile(distance, [1 / 3, 2 / 3])
    if far < 1.1 * near:
        return []
    values = {
        "near_m": float(near),
        "far_m": float(far),
        "near_rms_px": float(np.sqrt(square[distance <= near].mean())),
        "far_rms_px": float(np.sqrt(square[distance >= far].mean())),
    }
    ratio = values["near_rms_px"] / max(values["far_rms_px"], 1e-9)
    told = (
        f"points nearer than {near:.3f} m have {values['near_rms_px']:.3f} px RMS, those beyond {far:.3f} m "
        f"{values['far_rms_px']:.3f} px"
    )
    return [Finding("near_against_far", values, not 1 / _UNEVEN < ratio < _UNEVEN, told)]


def evaluation_content(
    found: Evaluation,
    observations: Observations,
    expected_px: float | None,
    verdict: Verdict,
    findings: tuple[Finding, ...],
) -> dict[str, Any]:
    """What there is to say of an evaluation, in numbers, texts and lists of them: ``evaluate --json``."""
    return {
        "rms_px": found.rms_px,
        "expected_rms_px": expected_px,
        "median_px": found.median_px,
        "p95_px": found.p95_px,
        "views": len(found.images),
        "points": found.points,
        "failed_views": [observations.image_names[image] for image in found.failed],
        "verdict": verdict.headline,
        "findings": findings_content(findings),
    }
