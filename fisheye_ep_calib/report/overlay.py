"""What is drawn over a view's picture, as SVG path data in the image's pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fisheye_ep_calib.report.data import CameraReport
from fisheye_ep_calib.report.figures.residuals import magnification


@dataclass(frozen=True)
class Overlay:
    """Path data: a square on each point, their residuals enlarged, and crosses on what was rejected."""

    points: str
    vectors: str
    rejected: str


def overlays_of(camera: CameraReport) -> tuple[tuple[Overlay, ...], float]:
    """One overlay a view, and the factor by which residuals are enlarged in all of them."""
    length = np.linalg.norm(camera.residuals.error, axis=-1)
    factor = magnification(length, max(camera.image_size) / 35)
    cross, dot = max(camera.image_size) / 90, round(max(camera.image_size) / 320, 1)
    overlays = []
    for row, view in enumerate(camera.views):
        own = camera.residuals.view == row
        pixels, error = camera.residuals.pixels[own], factor * camera.residuals.error[own]
        wrong = [point.pixel for point in camera.rejected if point.view == view.name]
        overlays.append(
            Overlay(
                "".join(f"M{u - dot / 2:.1f} {v - dot / 2:.1f}h{dot:g}v{dot:g}h-{dot:g}z" for u, v in pixels),
                "".join(f"M{u:.1f} {v:.1f}l{du:.1f} {dv:.1f}" for (u, v), (du, dv) in zip(pixels, error, strict=True)),
                "".join(
                    f"M{u - cross:.1f} {v - cross:.1f}l{2 * cross:.1f} {2 * cross:.1f}m0 {-2 * cross:.1f}"
                    f"l{-2 * cross:.1f} {2 * cross:.1f}"
                    for u, v in wrong
                ),
            )
        )
    return tuple(overlays), factor
