"""The figure of where residuals come from."""

from __future__ import annotations

from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget
from fisheye_ep_calib.report.drawing import PageAxes
from fisheye_ep_calib.report.figures.style import ACCENT, svg

_SOURCES = {
    "corner_noise_px": "corner noise",
    "board_px": "board, its shape",
    "board_rough_px": "board, single points",
    "lens_px": "lens",
    "view_px": "from view to view",
}


def budget_figure(budget: ErrorBudget, identity: str) -> str:
    """A bar for each source, RMS in px."""

    def draw(axes: PageAxes) -> None:
        shares = budget.to_dict()
        texts = [f"{share:.3f}" for share in shares.values()]
        axes.barh([_SOURCES[name] for name in shares], list(shares.values()), ACCENT, texts)
        axes.margins(0.12, 0.05)
        axes.set(xlabel="RMS, px", xlim=(0, None))

    return svg(draw, identity)
