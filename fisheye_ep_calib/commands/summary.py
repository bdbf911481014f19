"""A calibration's result as text."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration import CalibrationResult
from fisheye_ep_calib.calibration.words import loss_sentence, pupil_sentence
from fisheye_ep_calib.pipeline import CalibratedCamera, CameraSource

_MOST_LISTED = 8


def calibration_text(camera: CameraSource, result: CalibrationResult) -> str:
    """One camera's result for a person."""
    lines = [f"\n{camera.name}: {result.views} views, {result.points} points"]
    lines += [f"  not used: {text}" for text in _not_used(camera, result)]
    lines.append(f"  {'model':<12}{'RMS px':>9}{'held-out px':>13}{'parameters':>12}")
    for name, entry in result.comparison.items():
        mark = "  ← chosen" if name == result.model else ""
        lines.append(
            f"  {name:<12}{entry.rms_px:>9.4f}{entry.cross_validated_rms_px:>13.4f}{entry.parameters:>12}{mark}"
        )
    lines += [f"  {reason}" for reason in result.reasons]
    lines.append(f"  {_intrinsics(result)}")
    if result.board.bends:
        lines.append(f"  the board: {result.board.sentence}")
    lines.append(f"  {pupil_sentence(result)}")
    if result.error_budget:
        lines.append(f"  {result.error_budget.sentence}")
    lines += [f"  {'!' if entry.concern else '·'} {entry.line}" for entry in result.diagnosis.findings]
    lines.append(f"  {loss_sentence(result)}")
    if isinstance(result, CalibratedCamera) and result.change is not None:
        lines.append(f"  {'!' if result.change.changed else '·'} {result.change.sentence}")
    return "\n".join(lines)


def _intrinsics(result: CalibrationResult) -> str:
    """fx, fy, cx and cy with their σ, px."""
    sigma = np.sqrt(np.maximum(np.diag(result.uncertainty.covariance), 0))
    values = dict(zip(result.camera.parameter_names, zip(result.camera.parameters, sigma, strict=True), strict=True))
    told = (f"{name} {values[name][0]:.3f} ± {values[name][1]:.3f}" for name in ("fx", "fy", "cx", "cy"))
    return ", ".join(told) + " px"


def _not_used(camera: CameraSource, result: CalibrationResult) -> list[str]:
    names = camera.observations.image_names
    items = [f"{name}: {reason}" for name, reason in camera.unused_views.items()]
    items += [f"{names[view]}: most of its points disagree with every other view" for view in result.wrong_views]
    if len(items) > _MOST_LISTED:
        items = [*items[:_MOST_LISTED], f"{len(items) - _MOST_LISTED} more"]
    if result.rejected:
        worst = max(result.rejected, key=lambda point: np.hypot(*point.residual))
        items.append(
            f"{len(result.rejected)} points far off, the worst in {names[worst.view]}, point {worst.point}: "
            f"{np.hypot(*worst.residual):.2f} px"
        )
    return items
