"""A camera measured on other data, in words and as plain data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fisheye_ep_calib.arrays import BoolArray
from fisheye_ep_calib.calibration.assessing.coverage import azimuth_and_distance
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation
from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.content import findings_content
from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.calibration.words import BAD, CAUTION, GOOD, Verdict, sentence
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.rotation import motion_jacobian

_HOLDS, _FAILS = 1.25, 2.0  # RMS over what the calibration's own noise leads to expect
_WRONG_PX = 1.0  # px beyond the RMS expected; less may be blur, or a board that is not as its file says
_ABSURD = 0.005  # RMS over the image's longer side, where nothing is expected
BEYOND_EVIDENCE = "beyond_the_calibrated_field"  # a finding's name
_WRONG = "The camera does not hold on this recording: do not use it here."
_WORST = 3  # views that are named
_STANDS_OUT = 2.5  # RMS of a view over that of the middle one
_UNEVEN = 1.5  # RMS of the nearer over the farther third of the views, or the other way round


def expected_rms(evaluation: Evaluation, noise_px: float | None, camera_px2: float = 0.0) -> float | None:
    """What is to be expected with the poses refitted: √(2 σ² (2M − 6V)/(2M) + s²), px.

    noise_px: σ of one coordinate; None where it is not known. camera_px2: s², as ``camera_variance`` gives it.
    """
    if not isinstance(noise_px, int | float) or not noise_px > 0:
        return None
    free = max(1 - 6 * len(evaluation.images) / max(2 * evaluation.points, 1), 0.1)
    return float(np.sqrt(2 * free * float(noise_px) ** 2 + camera_px2))


def camera_variance(
    evaluation: Evaluation, observations: Observations, camera: FisheyeCamera, covariance: np.ndarray
) -> float:
    """Mean over the points of what the camera's own uncertainty adds to dx² + dy², px², once poses are refitted.

    A change δ of the camera's parameters moves the points of a view by J δ; its pose takes up what it can of that,
    which leaves R J δ with R = 1 − P (Pᵀ P)⁻¹ Pᵀ and P the derivatives by the pose. Expected is tr(R J C Jᵀ) over all
    views. covariance (P, P): C, of camera.parameters.
    """
    used = used_sightings(evaluation, observations)
    if not np.any(covariance) or not used.any():
        return 0.0
    camera = replace(camera, theta_max=np.pi)
    total = 0.0
    rows_of = observations.rows_of(evaluation.images)
    for rows, pose in zip(rows_of, evaluation.camera_from_target, strict=True):
        seen = observations.point_index[rows][used[rows]]
        points = observations.object_points[seen] @ pose[:3, :3].T + pose[:3, 3]
        _, valid, d_point, d_parameters = camera.project_with_jacobian(points)
        by_pose = (d_point @ motion_jacobian(points - points.mean(axis=0)))[valid].reshape(-1, 6)
        by_camera = d_parameters[valid].reshape(-1, len(covariance))
        left = by_camera - by_pose @ np.linalg.lstsq(by_pose, by_camera, rcond=None)[0]
        total += float(np.sum((left @ covariance) * left))
    return max(total, 0.0) / int(used.sum())  # a covariance from a file may not be positive


def evaluation_verdict(
    evaluation: Evaluation, expected_px: float | None, findings: tuple[Finding, ...], image_size: tuple[int, int]
) -> Verdict:
    """Whether the camera holds. expected_px: as ``expected_rms`` gives it. BAD where the camera is plainly wrong."""
    told = f"The residuals are {evaluation.rms_px:.3f} px RMS over {evaluation.points} points in "
    told += f"{len(evaluation.images)} views, "
    told += "every view's pose refitted and the camera as the file has it."
    concerns = tuple(sentence(finding.sentence) for finding in findings if finding.concern)
    steps = concerns or ("Nothing stands out by distance, angle or view.",)
    if expected_px is None and evaluation.rms_px > _ABSURD * max(image_size):
        return Verdict(BAD, _WRONG, (told,), steps)
    if expected_px is None:
        return Verdict(CAUTION, f"{evaluation.rms_px:.3f} px RMS on this recording.", (told,), steps)
    ratio = evaluation.rms_px / expected_px
    compared = (
        f"The noise of its points and its own uncertainty lead to expect {expected_px:.3f} px: {ratio:.2f} times that "
        "was found."
    )
    level, headline = _level(ratio, evaluation.rms_px - expected_px, bool(concerns))
    return Verdict(level, headline, (told, compared), steps)


def _level(ratio: float, excess_px: float, concerns: bool) -> tuple[str, str]:
    """ratio: of the RMS found over the RMS expected. excess_px: their difference."""
    if ratio > _FAILS and excess_px > _WRONG_PX:
        return BAD, _WRONG
    if ratio > _FAILS:
        return CAUTION, f"The camera holds on this recording only within {ratio:.1f} times what is expected."
    if ratio > _HOLDS:
        return CAUTION, "The camera holds less well here than where it was calibrated."
    if concerns:
        return CAUTION, "The camera holds on this recording, with reservations."
    return GOOD, "The camera holds on this recording."


def evaluation_findings(evaluation: Evaluation, observations: Observations, theta_max: float) -> tuple[Finding, ...]:
    """theta_max: rad, where the calibration's evidence ends."""
    used = used_sightings(evaluation, observations)
    _, distance = azimuth_and_distance(observations, evaluation.images, evaluation.camera_from_target, used)
    square = (evaluation.error[used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
    findings = [_beyond_evidence(evaluation.theta[used], theta_max), *_near_against_far(distance, square)]
    findings.append(_worst_views(worst_views(evaluation, observations, len(evaluation.images))))
    if count := len(evaluation.failed):
        told = f"{count} views have no pose in this camera"
        findings.append(Finding("views_without_a_pose", {"views": float(count)}, True, told))
    return tuple(findings)


def used_sightings(evaluation: Evaluation, observations: Observations) -> np.ndarray:
    """(M,) bool: the observations that were measured."""
    used: BoolArray = (
        np.isfinite(evaluation.error[:, 0])
        & (observations.weights > 0)
        & np.isin(observations.image_index, evaluation.images)
    )
    return used


def worst_views(evaluation: Evaluation, observations: Observations, most: int = _WORST) -> dict[str, float]:
    """Name → RMS, px, of the views that are worst, the worst first."""
    used = used_sightings(evaluation, observations)
    view = np.searchsorted(evaluation.images, observations.image_index[used])
    square = (evaluation.error[used] ** 2).sum(axis=-1) * observations.weights[used] ** 2
    count = np.bincount(view, minlength=len(evaluation.images))
    rms = np.sqrt(np.bincount(view, weights=square, minlength=len(evaluation.images)) / np.maximum(count, 1))
    order = np.argsort(-rms, kind="stable")[:most]
    return {observations.image_names[int(evaluation.images[row])]: float(rms[row]) for row in order}


def _worst_views(rms: dict[str, float]) -> Finding:
    """rms: of all views, the worst first."""
    middle = float(np.median(list(rms.values())))
    worst = list(rms.items())[:_WORST]
    named = ", ".join(f"{name} {px:.3f} px" for name, px in worst)
    told = f"the worst views: {named}, where the middle one has {middle:.3f} px"
    stands_out = worst[0][1] > _STANDS_OUT * max(middle, 1e-9)
    return Finding(
        "worst_views",
        {"rms_px": worst[0][1], "median_rms_px": middle},
        stands_out,
        f"{told}; look at the first for blur or wrong points" if stands_out else f"{told}: none stands out",
    )


def _beyond_evidence(theta: np.ndarray, limit: float) -> Finding:
    share = float((theta > limit).mean())
    told = f"{100 * share:.1f} % of the points lie beyond {np.degrees(limit):.0f}°, where the calibration saw nothing"
    return Finding(BEYOND_EVIDENCE, {"share": share}, share > 0.01, told)


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
    evaluation: Evaluation,
    observations: Observations,
    expected_px: float | None,
    verdict: Verdict,
    findings: tuple[Finding, ...],
) -> dict[str, Any]:
    """What there is to say of an evaluation, in numbers, texts and lists of them: ``evaluate --json``."""
    return {
        "rms_px": evaluation.rms_px,
        "expected_rms_px": expected_px,
        "median_px": evaluation.median_px,
        "p95_px": evaluation.p95_px,
        "views": len(evaluation.images),
        "points": evaluation.points,
        "failed_views": [observations.image_names[image] for image in evaluation.failed],
        "verdict": verdict.headline,
        "verdict_level": verdict.level,
        "worst_views": worst_views(evaluation, observations),
        "findings": findings_content(findings),
    }
