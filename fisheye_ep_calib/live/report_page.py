"""A camera's report, as a page of HTML, made where it is asked for: it takes longer than a calibration."""

from __future__ import annotations

from fisheye_ep_calib.calibration import Observations, calibrate


def report_page(observations: Observations, model: str, name: str) -> str:
    """What a worker process runs. Raises CalibrationError."""
    from fisheye_ep_calib.report.from_calibration import calibration_report
    from fisheye_ep_calib.report.html import report_html

    return report_html([calibration_report(name, observations, calibrate(observations, model=model))])
