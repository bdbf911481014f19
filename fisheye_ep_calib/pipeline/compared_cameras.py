"""Two cameras compared, with words and plain data at hand."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fisheye_ep_calib.arguments import positive_length
from fisheye_ep_calib.calibration.assessing.camera_difference import ALIGNMENTS, CameraDifference, camera_difference
from fisheye_ep_calib.calibration.comparison import (
    ComparedBoards,
    DistanceSummary,
    agreement,
    alignment_text,
    comparison_content,
    summaries,
)
from fisheye_ep_calib.calibration.words import distance_text
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.pipeline.known_camera import AnyCamera, known_camera
from fisheye_ep_calib.plain_text import shown

DISTANCES = (0.1, 0.3, 1.0, 10.0, np.inf)  # metres


@dataclass(frozen=True, repr=False, kw_only=True)
class ComparedCameras(CameraDifference):
    """alignment: what was taken out before they were compared. boards: that they were calibrated with."""

    alignment: str
    boards: ComparedBoards

    @property
    def by_distance(self) -> tuple[DistanceSummary, ...]:
        return summaries(self)

    @property
    def agree(self) -> bool | None:
        """Whether they agree within their uncertainties; None where neither brought one."""
        return agreement(self, self.by_distance)[0]

    @property
    def verdict(self) -> str:
        return agreement(self, self.by_distance)[1]

    def to_dict(self) -> dict[str, Any]:
        """What ``compare --json`` prints of the difference."""
        return {**comparison_content(self, self.alignment), "boards": self.boards.to_dict()}

    def __repr__(self) -> str:
        rows = []
        for row in self.by_distance:
            expected = f", {row.expected_px:.4f} px expected" if any(self.covariances_given) else ""
            rows.append(f"  {distance_text(row.distance_m):>10}: {row.rms_px:.4f} px RMS{expected}")
        return "\n".join([self.verdict, alignment_text(self, self.alignment), *rows, self.boards.sentence])


def compare(
    first: AnyCamera, second: AnyCamera, distances: Sequence[float] = DISTANCES, *, alignment: str = "rotation"
) -> ComparedCameras:
    """How two cameras differ in pixels, second minus first.

    Args:
        first: A camera alone, a calibration, a camera file or its path; the last three bring their uncertainties.
        second: Likewise.
        distances: Metres at which points are compared, inf too.
        alignment: What is no property of a camera: "rotation"; "rigid" adds the frame's origin; or "none".

    Returns:
        The difference by angle and distance, and what the uncertainties lead to expect.

    Raises:
        InputError: A camera or argument cannot be used, or the cameras share no part of the field.
    """
    several = distances if isinstance(distances, Iterable) else ()
    lengths = sorted({positive_length(distance, "distances") for distance in several})
    if not lengths:
        raise InputError(f"`distances` must be lengths in metres, not {shown(distances)}")
    if alignment not in ALIGNMENTS:
        raise InputError(f"unknown `alignment` {alignment!r}; known: {', '.join(ALIGNMENTS)}")
    first_file, second_file = known_camera(first), known_camera(second)
    covariances = tuple(file.covariance if file.covariance.any() else None for file in (first_file, second_file))
    difference = camera_difference(
        first_file.camera, second_file.camera, lengths, (covariances[0], covariances[1]), alignment
    )
    if not np.isfinite(difference.length_px).any():
        raise InputError("the two cameras share no part of the field at these distances")
    values = {field.name: getattr(difference, field.name) for field in fields(difference)}
    boards = ComparedBoards(first_file.board, second_file.board)
    return ComparedCameras(**values, alignment=alignment, boards=boards)
