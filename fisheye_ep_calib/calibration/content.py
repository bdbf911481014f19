"""A calibration as plain data: the one place where its figures get their names.

``calibrate --json``, calibration.json and whatever else programs read are views of it (docs/calibration_json.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.result import CalibrationResult

# What ``diagnosis`` calls a finding that has another title now; kept for one version.
_FORMER_TITLES = {"correlated_residuals": "errors that hang together"}


def calibration_content(result: CalibrationResult, names: Iterable[str] | None = None) -> dict[str, Any]:
    """What there is to say of a calibration, in numbers, texts and lists of them.

    names: of ``FIGURES``, those wanted; a calibration works out what is asked for alone. All by default.
    """
    return {name: FIGURES[name](result) for name in (FIGURES if names is None else names)}


def findings_content(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """name: as programs know it. raised: whether it limits the result. text: what it means and what to do."""
    return [{"name": finding.name, "raised": finding.concern, "text": finding.sentence} for finding in findings]


def _comparison(result: CalibrationResult) -> dict[str, Any]:
    return {
        name: {"rms_px": model.rms_px, "cross_validated_rms_px": model.cross_validated_rms_px}
        for name, model in result.comparison.items()
    }


def _rejected(result: CalibrationResult) -> list[dict[str, Any]]:
    names = result.observations.image_names
    return [
        {"view": names[point.view], "point": point.point, "residual_px": list(point.residual)}
        for point in result.rejected
    ]


def _wrong_views(result: CalibrationResult) -> list[str]:
    return [result.observations.image_names[view] for view in result.wrong_views]


def _diagnosis(result: CalibrationResult) -> list[dict[str, Any]]:
    """The findings under their former names."""
    return [
        {
            "name": _FORMER_TITLES.get(finding.name, finding.title),
            "values": finding.values,
            "concern": finding.concern,
            "sentence": finding.sentence,
        }
        for finding in result.diagnosis.findings
    ]


FIGURES: dict[str, Callable[[CalibrationResult], Any]] = {
    "model": lambda result: result.model,
    "rms_px": lambda result: result.rms_px,
    "views": lambda result: result.views,
    "points": lambda result: result.points,
    "rejected_points": lambda result: len(result.rejected),
    "refused": lambda result: result.refused,
    "entrance_pupil_supported": lambda result: result.entrance_pupil_supported,
    "entrance_pupil": lambda result: result.pupil_verdict.answer,
    "pupil_verdict": lambda result: result.pupil_verdict.to_dict(),
    "iterations": lambda result: result.iterations,
    "converged": lambda result: result.converged,
    "seconds": lambda result: dict(result.seconds),
    "comparison": _comparison,
    "reasons": lambda result: list(result.reasons),
    "board": lambda result: result.board.to_dict(),
    "error_budget": lambda result: None if result.error_budget is None else result.error_budget.to_dict(),
    "board_warp_mm": lambda result: (1e3 * result.board_warp).tolist(),
    "noise_px": lambda result: result.uncertainty.sigma_px,
    "svp_loss_px": lambda result: {str(key): value for key, value in result.stand_in.loss_px.items()},
    "rejected": _rejected,
    "wrong_views": _wrong_views,
    "findings": lambda result: findings_content(result.diagnosis.findings),
    "diagnosis": _diagnosis,
}
# What a camera file keeps of them under ``calibration``.
FACTS = (
    "rms_px",
    "noise_px",
    "views",
    "points",
    "rejected_points",
    "entrance_pupil_supported",
    "entrance_pupil",
    "refused",
    "converged",
    "error_budget",
)
