"""Two calibrations side by side as a page."""

from __future__ import annotations

from os import PathLike

from fisheye_ep_calib.calibration.assessing.camera_difference import CameraDifference
from fisheye_ep_calib.calibration.comparison import agreement, alignment_text, by_ring, summaries
from fisheye_ep_calib.calibration.words import distance_text
from fisheye_ep_calib.report.data import ModelCurve


def write_comparison(
    path: str | PathLike[str],
    names: tuple[str, str],
    cameras: CameraDifference,
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

    rows = summaries(cameras)
    theta, difference, expected = by_ring(cameras)
    labels = [distance_text(distance) for distance in cameras.distance_m]
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
        drawn, factor = difference_vectors_figure(cameras.pixels, cameras.difference_px[number], size, identity)
        panels.append(Panel(identity, f"At {label}", drawn, f"B minus A, enlarged {factor:g} times."))
    agree, sentence = agreement(cameras, rows)
    text = render(
        "compare.html",
        title=f"{names[0]} against {names[1]}",
        level={True: "good", False: "caution", None: "caution"}[agree],
        sentence=sentence,
        alignment=alignment_text(cameras, alignment),
        names=names,
        rows=rows,
        panels=panels,
        inputs=inputs,
    )
    atomic_write(path, text.encode())
