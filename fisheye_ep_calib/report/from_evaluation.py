"""A camera file measured on another recording, as what a report shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.diagnosis import Finding
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable
from fisheye_ep_calib.report.data import (
    BAD,
    CAUTION,
    GOOD,
    CameraReport,
    Residuals,
    StandInLoss,
    Verdict,
)
from fisheye_ep_calib.report.geometry import coverage_of, residuals_of, views_of
from fisheye_ep_calib.report.models import angles, lens_curve, parameters_of, pupil_curve
from fisheye_ep_calib.report.pictures import BUDGET, with_pictures
from fisheye_ep_calib.report.verdict import sentence
from fisheye_ep_calib.storage.camera_file import CameraFile

_HOLDS, _FAILS = 1.25, 2.0  # RMS over what the calibration's own noise leads to expect
_UNEVEN = 1.5  # RMS of the nearer over the farther third of the views, or the other way round


def evaluation_report(
    name: str,
    file: CameraFile,
    observations: Observations,
    found: Evaluation,
    *,
    inputs: dict[str, str] | None = None,
    image: Callable[[int], np.ndarray] | None = None,
    flat: bool = True,
) -> CameraReport:
    """file: the camera that was measured. observations: on which. image: of an image's number.

    flat: the target was taken as flat, whatever bow the file knows of.
    """
    used = np.isfinite(found.error[:, 0]) & (observations.weights > 0) & np.isin(observations.image_index, found.images)
    residuals = residuals_of(observations, found.images, found.camera_from_target, found.error, found.theta, used)
    images = [int(number) for number in found.images]
    views = views_of([observations.image_names[number] for number in images], residuals)
    if image is not None:
        views = with_pictures(views, images, image, BUDGET)
    findings = _findings(file, residuals, found, flat)
    camera, table = file.camera, file.projection_uncertainty
    return CameraReport(
        name=name,
        kind="evaluation",
        image_size=camera.image_size,
        verdict=_verdict(file, found, findings),
        findings=findings,
        facts={
            "model": camera.model,
            "RMS": f"{found.rms_px:.3f} px",
            "median": f"{found.median_px:.3f} px",
            "95 % below": f"{found.p95_px:.3f} px",
            "views": f"{len(found.images)}",
            "points": f"{found.points}",
        },
        models=(pupil_curve(camera.model, camera, file.covariance, angles(camera), True),),
        lens=lens_curve(camera, file.covariance),
        parameters=parameters_of(camera, file.covariance),
        residuals=residuals,
        coverage=coverage_of(residuals, camera),
        views=views,
        uncertainty_table=ProjectionTable(*(np.array(table[key]) for key in ("theta_deg", "distance_m", "sigma_px")))
        if table
        else None,
        stand_in=StandInLoss(file.stand_in_distance, file.stand_in_loss_px) if file.stand_in_loss_px else None,
        unused={observations.image_names[image]: reason for image, reason in found.failed.items()},
        inputs=inputs or {},
    )


def _expected_rms(file: CameraFile, found: Evaluation) -> float | None:
    """What the calibration's noise leads to expect with the poses refitted: √(2 σ² (2M − 6V)/(2M))."""
    noise = file.calibration.get("noise_px")
    if not isinstance(noise, int | float) or not noise > 0:
        return None
    free = max(1 - 6 * len(found.images) / max(2 * found.points, 1), 0.1)
    return float(noise) * float(np.sqrt(2 * free))


def _verdict(file: CameraFile, found: Evaluation, findings: tuple[Finding, ...]) -> Verdict:
    said = f"The residuals are {found.rms_px:.3f} px RMS over {found.points} points in {len(found.images)} views, "
    said += "every view's pose refitted and the camera as the file has it."
    expected = _expected_rms(file, found)
    concerns = tuple(sentence(one.sentence) for one in findings if one.concern)
    steps = concerns or ("Nothing stands out by distance, angle or view.",)
    if expected is None:
        return Verdict(CAUTION, f"{found.rms_px:.3f} px RMS on this recording.", (said,), steps)
    ratio = found.rms_px / expected
    compared = f"The noise of its own calibration leads to expect {expected:.3f} px: {ratio:.2f} times that was found."
    level, headline = _level(ratio, bool(concerns))
    return Verdict(level, headline, (said, compared), steps)


def _level(ratio: float, concerns: bool) -> tuple[str, str]:
    """ratio: of the RMS found over the RMS expected."""
    if ratio > _FAILS:
        return BAD, "The camera does not hold on this recording."
    if ratio > _HOLDS:
        return CAUTION, "The camera holds less well here than where it was calibrated."
    if concerns:
        return CAUTION, "The camera holds on this recording, with reservations."
    return GOOD, "The camera holds on this recording."


def _findings(file: CameraFile, residuals: Residuals, found: Evaluation, flat: bool) -> tuple[Finding, ...]:
    findings = [_beyond_evidence(file, residuals), *_near_against_far(residuals)]
    bow = 1e3 * float(np.abs(file.board_warp).max())
    if flat and bow > 0:
        said = f"the target of the calibration is bent by {bow:.2f} mm; if this is the same one, give `board_warp`"
        findings.append(Finding("the target's bow", {"bow_mm": bow}, True, said))
    if found.failed:
        count = len(found.failed)
        findings.append(
            Finding("views without a pose", {"views": float(count)}, True, f"{count} views have no pose in this camera")
        )
    return tuple(findings)


def _beyond_evidence(file: CameraFile, residuals: Residuals) -> Finding:
    limit = file.camera.theta_max
    share = float((residuals.theta > limit).mean())
    said = f"{100 * share:.1f} % of the points lie beyond {np.degrees(limit):.0f}°, where the calibration saw nothing"
    return Finding("beyond the calibrated field", {"share": share}, share > 0.01, said)


def _near_against_far(residuals: Residuals) -> list[Finding]:
    """RMS of the nearest against that of the farthest third of the sightings."""
    near, far = np.quantile(residuals.distance, [1 / 3, 2 / 3])
    square = (residuals.error**2).sum(axis=-1)
    if far < 1.1 * near:
        return []
    values = {
        "near_m": float(near),
        "far_m": float(far),
        "near_rms_px": float(np.sqrt(square[residuals.distance <= near].mean())),
        "far_rms_px": float(np.sqrt(square[residuals.distance >= far].mean())),
    }
    ratio = values["near_rms_px"] / max(values["far_rms_px"], 1e-9)
    said = (
        f"points nearer than {near:.3f} m have {values['near_rms_px']:.3f} px RMS, those beyond {far:.3f} m "
        f"{values['far_rms_px']:.3f} px"
    )
    return [Finding("near against far", values, not 1 / _UNEVEN < ratio < _UNEVEN, said)]
