"""A calibration's result as what a report shows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult, Observations
from fisheye_ep_calib.calibration.assessing.camera_difference import points_on_rays
from fisheye_ep_calib.calibration.assessing.uncertainty import projection_uncertainty
from fisheye_ep_calib.calibration.words import calibration_verdict
from fisheye_ep_calib.camera.directions import direction
from fisheye_ep_calib.report.data import (
    CameraReport,
    Rejected,
    Residuals,
    StandInLoss,
    UncertaintyMap,
    View,
)
from fisheye_ep_calib.report.geometry import coverage_of, residuals_of, views_of
from fisheye_ep_calib.report.models import compared_models, lens_curve, near_far_curve, parameters_of
from fisheye_ep_calib.report.pictures import BUDGET, with_pictures

_MAP_RINGS, _MAP_SECTORS = 40, 73


def calibration_report(
    name: str,
    observations: Observations,
    result: CalibrationResult,
    *,
    inputs: dict[str, str] | None = None,
    unused: dict[str, str] | None = None,
    image: Callable[[int], np.ndarray] | None = None,
    picture_budget: int = BUDGET,
) -> CameraReport:
    """observations: what was calibrated. image: of an image's number."""
    rejected = _rejected(result)
    residuals = calibration_residuals(result)
    views = calibration_views(observations, result)
    if image is not None:
        views = with_pictures(views, result.view_images.tolist(), image, picture_budget)
    split = result.diagnosis.near_far
    return CameraReport(
        name=name,
        kind="calibration",
        image_size=result.camera.image_size,
        verdict=calibration_verdict(result),
        findings=result.diagnosis.findings,
        facts=_facts(result),
        models=compared_models(result),
        lens=lens_curve(result.camera, result.uncertainty.covariance),
        parameters=parameters_of(result.camera, result.uncertainty.covariance),
        residuals=residuals,
        coverage=coverage_of(residuals, result.camera),
        views=views,
        uncertainty_maps=_uncertainty_maps(result, float(np.median(residuals.distance))),
        uncertainty_table=result.projection_table,
        near_far=near_far_curve(split) if split else None,
        stand_in=StandInLoss(result.stand_in.distance, dict(result.stand_in.loss_px)),
        rejected=rejected,
        unused={
            **(unused or {}),
            **{
                observations.image_names[view]: "most of its points disagree with every other view"
                for view in result.wrong_views
            },
        },
        reasons=result.reasons,
        budget=result.error_budget,
        board=result.board,
        inputs=inputs or {},
    )


def calibration_residuals(result: CalibrationResult) -> Residuals:
    """The sightings that the chosen fit used."""
    error, theta, _ = result.fit.residuals
    sightings = result.fit.sightings
    poses, used = result.camera_from_target, result.fit.used
    return residuals_of(sightings.observations, sightings.images, poses, error, theta, used)


def calibration_views(observations: Observations, result: CalibrationResult) -> tuple[View, ...]:
    """The views that the chosen fit used, without pictures."""
    names = [observations.image_names[number] for number in result.view_images]
    return views_of(names, calibration_residuals(result), _rejected(result))


def _rejected(result: CalibrationResult) -> tuple[Rejected, ...]:
    """The sightings left out, the worst first."""
    observations = result.observations
    row = {
        (int(image), int(point)): index
        for index, (image, point) in enumerate(zip(observations.image_index, observations.point_index, strict=True))
    }
    points = []
    for rejected in sorted(result.rejected, key=lambda rejected: -np.hypot(*rejected.residual)):
        u, v = observations.pixels[row[rejected.view, rejected.point]]
        points.append(
            Rejected(observations.image_names[rejected.view], rejected.point, (float(u), float(v)), rejected.residual)
        )
    return tuple(points)


def _facts(result: CalibrationResult) -> dict[str, str]:
    chosen = result.comparison.get(result.model)
    facts = {
        "model": result.model,
        "RMS": f"{result.rms_px:.3f} px",
        "on views left out": f"{chosen.cross_validated_rms_px:.3f} px" if chosen else "–",
        "views": f"{result.views}",
        "points": f"{result.points}",
        "field seen": f"{np.degrees(result.camera.theta_max):.0f}° off the axis",
    }
    if result.board.bends:
        facts["target"] = result.board.sentence
    return facts


def _uncertainty_maps(result: CalibrationResult, recorded: float) -> tuple[UncertaintyMap, ...]:
    """At the distance that was recorded and at infinity; a map follows rings of equal angle."""
    camera = result.camera
    theta, azimuth = np.meshgrid(
        np.linspace(0, camera.theta_limit, _MAP_RINGS), np.linspace(0, 2 * np.pi, _MAP_SECTORS), indexing="ij"
    )
    directions = direction(theta, azimuth)
    origins = np.zeros_like(directions)
    origins[..., 2] = -camera.entrance_pupil(theta)
    maps = []
    for distance in (recorded, np.inf):
        points, in_field = points_on_rays(origins, directions, np.full(theta.shape, distance))
        pixels, _ = camera.project(points)
        sigma = projection_uncertainty(camera, result.uncertainty, result.fit.problem.free, points)
        maps.append(UncertaintyMap(float(distance), pixels, np.where(in_field, sigma, np.nan)))
    return tuple(maps)
