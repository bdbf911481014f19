"""Figures of how two cameras differ."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from fisheye_ep_calib.report.figures.style import ACCENT, SERIES, image_axes, svg
from fisheye_ep_calib.report.magnification import magnification


def difference_by_angle_figure(
    theta_deg: np.ndarray, difference_px: np.ndarray, expected_px: np.ndarray, labels: list[str], identity: str
) -> str:
    """RMS difference (distances, rings) by angle, and dashed what the uncertainties lead to expect."""

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        for number, label in enumerate(labels):
            color = SERIES[number % len(SERIES)]
            axes.plot(theta_deg, difference_px[number], "o-", ms=3.5, color=color, label=label)
            if np.any(expected_px[number] > 0):
                axes.plot(theta_deg, expected_px[number], "--", lw=1.1, color=color)
        axes.set(xlabel="θ, degrees", ylabel="RMS difference, px", xlim=(0, None), ylim=(0, None))
        axes.legend()

    return svg(draw, identity)


def difference_vectors_figure(
    pixels: np.ndarray, difference_px: np.ndarray, size: tuple[int, int], identity: str
) -> tuple[str, float]:
    """Differences (n, 2) as vectors over the image, and the factor by which they are enlarged."""
    width, height = size
    finite = np.isfinite(difference_px[:, 0])
    length = np.linalg.norm(difference_px[finite], axis=-1)
    factor = magnification(length, max(size) / 20)

    def draw(figure: Figure) -> None:
        axes = figure.add_subplot()
        if finite.any():
            axes.quiver(
                *pixels[finite].T,
                *(factor * difference_px[finite]).T,
                angles="xy",
                scale_units="xy",
                scale=1,
                width=0.003,
                color=ACCENT,
            )
        image_axes(axes, size)

    return svg(draw, identity, (4.6, 0.6 + 4.0 * height / width)), factor
