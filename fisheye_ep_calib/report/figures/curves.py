"""Figures of curves over θ and distance: E(θ), r(θ), near against far, what the stand-in loses.

Each is drawn on axes; ``…_figure`` makes an SVG of it for the page.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from fisheye_ep_calib.report.data import LensCurve, ModelCurve, NearFar, StandInLoss
from fisheye_ep_calib.report.figures.style import ACCENT, INK, SECOND, SERIES, svg

_DASHES = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 2, 1.5, 2)))
_LEAST_LOSS = 1e-3  # px; less cannot be told from nothing


def draw_pupil(axes: Axes, models: tuple[ModelCurve, ...]) -> None:
    """E(θ), mm, of every model with its 1σ band."""
    lowest, highest = [0.0], [0.0]
    for number, model in enumerate(sorted(models, key=lambda entry: not entry.chosen)):
        degrees, shift, sigma = np.degrees(model.theta), 1e3 * model.pupil, 1e3 * model.pupil_sigma
        color, dashes = SERIES[number % len(SERIES)], _DASHES[number % len(_DASHES)]
        label = f"{model.name} (chosen)" if model.chosen and len(models) > 1 else model.name
        axes.fill_between(degrees, shift - sigma, shift + sigma, color=color, alpha=0.22, lw=0)
        axes.plot(degrees, shift, color=color, ls=dashes, lw=2.2 if model.chosen else 1.5, label=label)
        reach = np.minimum(sigma, max(np.ptp(shift), 0.05))
        lowest.append(float((shift - reach).min()))
        highest.append(float((shift + reach).max()))
    margin = 0.06 * max(max(highest) - min(lowest), 0.02)
    axes.set(
        xlabel="θ, degrees",
        ylabel="E(θ), mm",
        xlim=(0, np.degrees(models[0].theta[-1])),
        ylim=(min(lowest) - margin, max(highest) + margin),
    )
    axes.legend()


def pupil_figure(models: tuple[ModelCurve, ...], identity: str) -> str:
    return svg(lambda figure: draw_pupil(figure.add_subplot(), models), identity)


def draw_lens(axes: Axes, lens: LensCurve) -> None:
    """fx r(θ) − fx θ, px, with its 1σ band."""
    degrees, off = np.degrees(lens.theta), lens.radius_px - lens.focal_px * lens.theta
    axes.fill_between(degrees, off - lens.sigma_px, off + lens.sigma_px, color=ACCENT, alpha=0.25, lw=0)
    axes.plot(degrees, off, color=ACCENT)
    axes.axhline(0, color=INK, lw=0.7)
    axes.set(xlabel="θ, degrees", ylabel="f r(θ) − f θ, px", xlim=(0, degrees[-1]))


def lens_figure(lens: LensCurve, identity: str) -> str:
    return svg(lambda figure: draw_lens(figure.add_subplot(), lens), identity)


def draw_near_far(axes: Axes, near_far: NearFar) -> None:
    """Difference at infinity of the halves' cameras by angle, and what noise leads to expect."""
    axes.plot(near_far.theta_deg, near_far.difference_px, "o-", ms=4, color=SECOND, label="near half − far half")
    axes.fill_between(near_far.theta_deg, 0, near_far.expected_px, color=ACCENT, alpha=0.3, lw=0)
    axes.plot(near_far.theta_deg, near_far.expected_px, color=ACCENT, label="expected from noise, 1σ")
    axes.set(xlabel="θ, degrees", ylabel="RMS at infinity, px", xlim=(0, None), ylim=(0, None))
    axes.legend()


def near_far_figure(near_far: NearFar, identity: str) -> str:
    return svg(lambda figure: draw_near_far(figure.add_subplot(), near_far), identity)


def draw_stand_in(axes: Axes, stand_in: StandInLoss) -> None:
    """RMS that the single-viewpoint stand-in loses by distance."""
    distance = np.array(sorted(stand_in.loss_px))
    loss = np.array([stand_in.loss_px[metres] for metres in distance])
    axes.loglog(distance, np.maximum(loss, _LEAST_LOSS), "o-", ms=5, color=SECOND)
    for x, y in zip(distance, loss, strict=True):
        axes.annotate(f"{y:.2g} px", (x, max(y, _LEAST_LOSS)), textcoords="offset points", xytext=(6, 4))
    axes.margins(x=0.12, y=0.15)
    axes.minorticks_off()
    plain = FuncFormatter(lambda value, _: f"{value:g}")
    axes.set_xticks(distance[np.isfinite(distance)])
    axes.xaxis.set_major_formatter(plain)
    axes.yaxis.set_major_formatter(plain)
    axes.set(xlabel="distance, m", ylabel="RMS lost over the image, px")
