"""A calibration's result as JSON and as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.pipeline import CameraSource

_MOST_LISTED = 8


def calibration_json(camera: CameraSource, result: CalibrationResult, seconds: dict, path: Path | None) -> dict:
    """What ``calibrate --json`` says of one camera."""
    names = camera.observations.image_names
    return {
        "model": result.model,
        "rms_px": result.rms_px,
        "views": result.views,
        "points": result.points,
        "rejected_points": len(result.rejected),
        "entrance_pupil_supported": result.entrance_pupil_supported,
        "iterations": result.iterations,
        "converged": result.converged,
        "seconds": seconds,
        "yaml": None if path is None else str(path),
        "comparison": {
            name: {"rms_px": one.rms_px, "cross_validated_rms_px": one.cross_validated_rms_px}
            for name, one in result.comparison.items()
        },
        "reasons": list(result.reasons),
        "board_warp_mm": (1e3 * result.board_warp).tolist(),
        "noise_px": result.uncertainty.sigma_px,
        "svp_loss_px": {str(key): value for key, value in result.stand_in.loss_px.items()},
        "rejected": [
            {"view": names[point.view], "point": point.point, "residual_px": list(point.residual)}
            for point in result.rejected
        ],
        "wrong_views": [names[view] for view in result.wrong_views],
        "unused_views": camera.unused_views,
        "diagnosis": [
            {"name": one.name, "values": one.values, "concern": one.concern, "sentence": one.sentence}
            for one in result.diagnosis.findings
        ],
    }


def calibration_text(camera: CameraSource, result: CalibrationResult) -> str:
    """One camera's result for a person."""
    lines = [f"\n{camera.name}: {result.views} views, {result.points} points"]
    lines += [f"  not used: {text}" for text in _not_used(camera, result)]
    lines.append(f"  {'model':<12}{'RMS px':>9}{'held-out px':>13}{'parameters':>12}")
    for name, one in result.comparison.items():
        mark = "  ← chosen" if name == result.model else ""
        lines.append(f"  {name:<12}{one.rms_px:>9.4f}{one.cross_validated_rms_px:>13.4f}{one.parameters:>12}{mark}")
    lines += [f"  {reason}" for reason in result.reasons]
    if np.any(result.board_warp):
        bow = ", ".join(f"{1e3 * value:+.3f}" for value in result.board_warp)
        lines.append(f"  board warp (x, y, twist): {bow} mm")
    lines.append(f"  {verdict(result)}")
    lines += [f"  {'!' if one.concern else '·'} {one.name}: {one.sentence}" for one in result.diagnosis.findings]
    lines.append(f"  a single-viewpoint consumer of CameraInfo loses {_losses(result)}")
    return "\n".join(lines)


def _not_used(camera: CameraSource, result: CalibrationResult) -> list[str]:
    names = camera.observations.image_names
    items = [f"{name}: {reason}" for name, reason in camera.unused_views.items()]
    items += [f"{names[view]}: most of its points disagree with every other view" for view in result.wrong_views]
    if len(items) > _MOST_LISTED:
        items = [*items[:_MOST_LISTED], f"{len(items) - _MOST_LISTED} more"]
    if result.rejected:
        worst = max(result.rejected, key=lambda point: np.hypot(*point.residual))
        items.append(
            f"{len(result.rejected)} points beyond 6 σ, the worst in {names[worst.view]}, point {worst.point}: "
            f"{np.hypot(*worst.residual):.2f} px"
        )
    return items


def verdict(result: CalibrationResult) -> str:
    """Whether the data support an entrance pupil, in one sentence."""
    if not result.entrance_pupil_supported:
        return (
            "an entrance pupil is not supported by these data: record the target close to the lens and out to the "
            "edge of the image, at several distances, if you need one"
        )
    if result.model == "kannala":
        return "the data support an entrance pupil, which this single-viewpoint model leaves out: try model auto"
    camera = result.camera
    angle = min(np.deg2rad(60.0), camera.theta_max)
    shift = 1e3 * float(camera.entrance_pupil(angle))
    sigma = 1e3 * float(pupil_sigma(camera, result.uncertainty.covariance, np.array(angle)))
    return f"entrance pupil supported: E({np.degrees(angle):.0f}°) = {shift:+.3f} ± {sigma:.3f} mm"


def _losses(result: CalibrationResult) -> str:
    return ", ".join(f"{loss:.2f} px at {distance:g} m" for distance, loss in result.stand_in.loss_px.items())
