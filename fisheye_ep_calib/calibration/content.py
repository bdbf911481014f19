"""A calibration as plain data: the one place where its figures get their names.

``calibrate --json``, calibration.json and whatever else programs read are views of it (docs/calibration_json.md).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from fisheye_ep_calib.calibration.assessing.finding import Finding
from fisheye_ep_calib.calibration.result import CalibrationResult

# What ``diagnosis`` calls a finding that has another title now; kept for one version.
_FORMER_TITLES = {"correlated_residuals": "errors that hang together"}


def calibration_content(result: CalibrationResult) -> dict[str, Any]:
    """What there is to say of a calibration, in numbers, texts and lists of them."""
    names = result.fit.sightings.observations.image_names
    findings = result.diagnosis.findings
    return {
        "model": result.model,
        "rms_px": result.rms_px,
        "views": result.views,
        "points": result.points,
        "rejected_points": len(result.rejected),
        "refused": result.refused,
        "entrance_pupil_supported": result.entrance_pupil_supported,
        "entrance_pupil": result.pupil_verdict.answer,
        "pupil_verdict": result.pupil_verdict.to_dict(),
        "iterations": result.iterations,
        "converged": result.converged,
        "seconds": dict(result.seconds),
        "comparison": {
            name: {"rms_px": entry.rms_px, "cross_validated_rms_px": entry.cross_validated_rms_px}
            for name, entry in result.comparison.items()
        },
        "reasons": list(result.reasons),
        "board": result.board.to_dict(),
        "error_budget": None if result.error_budget is None else result.error_budget.to_dict(),
        "board_warp_mm": (1e3 * result.board_warp).tolist(),
        "noise_px": result.uncertainty.sigma_px,
        "svp_loss_px": {str(key): value for key, value in result.stand_in.loss_px.items()},
        "rejected": [
            {"view": names[point.view], "point": point.point, "residual_px": list(point.residual)}
            for point in result.rejected
        ],
        "wrong_views": [names[view] for view in result.wrong_views],
        "findings": findings_content(findings),
        "diagnosis": [
            {
                "name": _FORMER_TITLES.get(entry.name, entry.title),
                "values": entry.values,
                "concern": entry.concern,
                "sentence": entry.sentence,
            }
            for entry in findings
        ],
    }


def findings_content(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """name: as programs know it. raised: whether it limits the result. text: what it means and what to do."""
    return [{"name": finding.name, "raised": finding.concern, "text": finding.sentence} for finding in findings]
