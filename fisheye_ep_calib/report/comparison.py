"""Two calibrations side by side: in numbers, in words and as a page."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import numpy as np

from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference
from fisheye_ep_calib.report.data import ModelCurve
from fisheye_ep_calib.report.models import by_ring, rms
from fisheye_ep_calib.report.verdict import distance_text

_BEYOND_NOISE = 2.5  # times what the uncertainties lead to expect


@dataclass(frozen=True)
class DistanceSummary:
    """At one distance, px over the field; expected_px: the RMS that the uncertainties alone lead to expect."""

    distance_m: float
    rms_px: float
    median_px: float
    p95_px: float
    largest_px: float
    expected_px: float

    @property
    def beyond_noise(self) -> bool:
        return self.rms_px > _BEYOND_NOISE * self.expected_px


def summaries(found: CameraDifference) -> tuple[DistanceSummary, ...]:
    """One a distance; NaN where the cameras share no pixel."""
    rows = []
    for distance, length, sigma in zip(found.distance_m, found.length_px, found.sigma_px, strict=True):
        seen = length[np.isfinite(length)]
        if len(seen) == 0:
            rows.append(DistanceSummary(float(distance), *[float("nan")] * 5))
            continue
        middle, high = np.quantile(seen, [0.5, 0.95])
        rows.append(
            DistanceSummary(
                float(distance), float(rms(length)), float(middle), float(high), float(seen.max()), float(rms(sigma))
            )
        )
    return tuple(rows)


def agreement(found: CameraDifference, rows: tuple[DistanceSummary, ...]) -> tuple[bool | None, str]:
    """Whether the cameras agree within their uncertainties, None where neither brought one; and in words."""
    rows = tuple(row for row in rows if np.isfinite(row.rms_px))
    if not rows:
        return None, "The cameras share no part of the field at these distances."
    worst = max(rows, key=lambda row: row.rms_px)
    if not any(found.known):
        said = f"They differ by up to {worst.rms_px:.3g} px RMS, at {distance_text(worst.distance_m)}"
        return None, f"{said}; neither file carries uncertainties to compare it with."
    partly = "" if all(found.known) else " Only one of the files carries its uncertainty."
    clear = [row for row in rows if row.beyond_noise]
    if not clear:
        said = f"They agree within their uncertainties: {worst.rms_px:.3g} px RMS at most, at "
        return True, f"{said}{distance_text(worst.distance_m)}.{partly}"
    worst = max(clear, key=lambda row: row.rms_px)
    said = f"They differ by more than their uncertainties explain: {worst.rms_px:.3g} px RMS at "
    said += f"{distance_text(worst.distance_m)}, where {worst.expected_px:.3g} px is expected."
    return False, said + partly


def alignment_text(found: CameraDifference, alignment: str) -> str:
    """What was taken out before the cameras were compared."""
    if alignment == "none":
        return "Nothing was aligned: the frames of both cameras are taken as they are."
    angle = np.degrees(np.linalg.norm(found.rotation))
    said = f"B was turned by {angle:.4f}° to agree best over all of these distances: "
    said += "an orientation is no property of a camera."
    if alignment == "rotation":
        return said
    return f"{said} Its origin was shifted by {1e3 * np.linalg.norm(found.shift):.4f} mm too."


def write_comparison(
    path: str | PathLike[str],
    names: tuple[str, str],
    found: CameraDifference,
    alignment: str,
    curves: tuple[ModelCurve, ModelCurve],
    size: tuple[int, int],
    inputs: dict[str, str],
) -> None:
    """Write the page whole or not at all. curves: ModelCurve of A and of B."""
    from fisheye_ep_calib.report.figures.curves import pupil_figure
    from fisheye_ep_calib.report.figures.difference import difference_by_angle_figure, difference_vectors_figure
    from fisheye_ep_calib.report.html import render
    from fisheye_ep_calib.report.panels import Panel
    from fisheye_ep_calib.storage.atomic import atomic_write

    rows = summaries(found)
    theta, difference, expected = by_ring(found)
    labels = [distance_text(distance) for distance in found.distance_m]
    panels = [
        Panel(
            "by-angle",
            "Difference by angle",
            difference_by_angle_figure(theta, difference, expected, labels, "by-angle"),
            "RMS over rings of 10°; dashed, what the uncertainties of both cameras lead to expect.",
        ),
        Panel("pupils", "Entrance pupils E(θ)", pupil_figure(curves, "pupils"), "Of A and B, with 1σ bands."),
    ]
    for number, label in enumerate(labels):
        identity = f"vectors-{number}"
        drawn, factor = difference_vectors_figure(found.pixels, found.difference_px[number], size, identity)
        panels.append(Panel(identity, f"At {label}", drawn, f"B minus A, enlarged {factor:g} times."))
    agree, sentence = agreement(found, rows)
    text = render(
        "compare.html",
        title=f"{names[0]} against {names[1]}",
        level={True: "good", False: "caution", None: "caution"}[agree],
        sentence=sentence,
        alignment=alignment_text(found, alignment),
        names=names,
        rows=rows,
        panels=panels,
        inputs=inputs,
    )
    atomic_write(path, text.encode())
