"""A camera file measured on another recording, as what a report shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.evaluation import Evaluation
from fisheye_ep_calib.calibration.assessing.uncertainty import ProjectionTable
from fisheye_ep_calib.calibration.evaluation_words import (
    evaluation_findings,
    evaluation_verdict,
    used_sightings,
)
from fisheye_ep_calib.report.data import (
    CameraReport,
    StandInLoss,
)
from fisheye_ep_calib.report.geometry import coverage_of, residuals_of, views_of
from fisheye_ep_calib.report.models import angles, lens_curve, parameters_of, pupil_curve
from fisheye_ep_calib.report.pictures import BUDGET, with_pictures
from fisheye_ep_calib.storage.camera_file_parsing import CameraFile
from fisheye_ep_calib.target.shape.measured import BoardShape


def evaluation_report(
    name: str,
    file: CameraFile,
    observations: Observations,
    evaluation: Evaluation,
    *,
    inputs: dict[str, str] | None = None,
    image: Callable[[int], np.ndarray] | None = None,
    board: BoardShape | None = None,
    expected_px: float | None = None,
) -> CameraReport:
    """file: the camera that was measured. observations: on which. image: of an image's number.

    board: the shape that the target was given; None where it was taken as its file has it. expected_px: RMS.
    """
    used = used_sightings(evaluation, observations)
    residuals = residuals_of(
        observations, evaluation.images, evaluation.camera_from_target, evaluation.error, evaluation.theta, used
    )
    images = [int(number) for number in evaluation.images]
    views = views_of([observations.image_names[number] for number in images], residuals)
    if image is not None:
        views = with_pictures(views, images, image, BUDGET)
    camera, table = file.camera, file.projection_uncertainty
    findings = evaluation_findings(evaluation, observations, camera.theta_max)
    return CameraReport(
        name=name,
        kind="evaluation",
        image_size=camera.image_size,
        verdict=evaluation_verdict(evaluation, expected_px, findings, camera.image_size),
        findings=findings,
        facts={
            "model": camera.model,
            "RMS": f"{evaluation.rms_px:.3f} px",
            "expected": "–" if expected_px is None else f"{expected_px:.3f} px",
            "median": f"{evaluation.median_px:.3f} px",
            "95 % below": f"{evaluation.p95_px:.3f} px",
            "views": f"{len(evaluation.images)}",
            "points": f"{evaluation.points}",
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
        unused={observations.image_names[image]: reason for image, reason in evaluation.failed.items()},
        board=board,
        inputs=inputs or {},
    )
