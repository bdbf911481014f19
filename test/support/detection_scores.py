"""How a detection compares with the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAR = 2.0


@dataclass(frozen=True)
class Score:
    """share: of the visible features, found. mislabelled: found, but under the name of another."""

    share: float
    mislabelled: int
    median_error: float
    views_found: int


def evaluate(camera, target, views, printed=None) -> tuple[Score, Score]:
    """Both passes over views of an evaluation set; the second is guided by the true camera and pose.

    printed: what the views show where it is not quite the target.
    """
    detector = target.detector()
    passes = ([], [])
    for view in views:
        image = view.image(camera, printed or target)
        first = detector.detect(image)
        second = detector.detect_guided(image, camera, view.pose)
        for results, detection in zip(passes, (first, second), strict=True):
            results.append(_compare(target, detection, view, allow_symmetry=detection is first))
    return tuple(_score(results, views) for results in passes)


def _compare(target, detection, view, allow_symmetry: bool) -> tuple[np.ndarray, int, int]:
    """Errors of visible features that are rightly named, number of wrong names, number found."""
    if len(detection) == 0:
        return np.zeros(0), 0, 0
    error = np.linalg.norm(detection.pixels - view.pixels[detection.point_index], axis=1)
    visible = view.visible[detection.point_index]
    ambiguous = target.kind in ("circle_grid", "chessboard") and not getattr(target, "holed", ())
    if allow_symmetry and ambiguous and np.median(error) > NEAR and same_lattice(target, detection, view.pixels):
        distance = np.linalg.norm(detection.pixels[:, None] - view.pixels, axis=-1)
        error, visible = distance.min(axis=1), view.visible[distance.argmin(axis=1)]
    right = error < NEAR
    return error[right & visible], int((~right).sum()), len(detection)


def _score(results, views) -> Score:
    errors = np.concatenate([result[0] for result in results])
    visible = sum(int(view.visible.sum()) for view in views)
    return Score(
        share=len(errors) / visible,
        mislabelled=sum(result[1] for result in results),
        median_error=float(np.median(errors)),
        views_found=sum(result[2] > 0 for result in results),
    )


def same_lattice(target, detection, truth: np.ndarray) -> bool:
    """Whether the names are right but for a symmetry of the lattice: a plain board looks alike when turned."""
    distance = np.linalg.norm(detection.pixels[:, None] - truth, axis=-1)
    nearest = distance.argmin(axis=1)
    if (distance.min(axis=1) > NEAR).any():
        return False
    given = np.column_stack([target.object_points[detection.point_index, :2], np.ones(len(detection))])
    real = target.object_points[nearest, :2]
    turned = np.linalg.lstsq(given, real, rcond=None)[0]
    return bool(np.abs(given @ turned - real).max() < 1e-6 and np.linalg.det(turned[:2]) > 0.99)
