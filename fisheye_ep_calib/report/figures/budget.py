"""The figure of where residuals come from."""

from __future__ import annotations

from matplotlib.figure import Figure

from fisheye_ep_calib.calibration.assessing.error_budget import ErrorBudget
from fisheye_ep_calib.report.figures.style import ACCENT, Margins, svg

_SOURCES = {
    "corner_noise_px": "corner noise",
    "board_px": "board, its shape",
    "board_rough_px": "board, single points",
    "lens_px": "lens",
    "view_px": "from view to view",
}


def budget_figure(budget: ErrorBudget, identity: str) -> str:
    """A bar for each source, RMS in px."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        shares = budget.to_dict()
        bars = axes.barh([_SOURCES[name] for name in shares], list(shares.values()), color=ACCENT)
        axes.bar_label(bars, fmt="%.3f", padding=3)
        axes.invert_yaxis()
        axes.margins(x=0.12)
        axes.set(xlabel="RMS, px", xlim=(0, None))

    return svg(draw, identity, margins=Margins(left=1.55))
