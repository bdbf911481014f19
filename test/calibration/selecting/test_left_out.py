"""Views that cannot tell their pose, and what is said of the points that were left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import rows, unknown_scene

from fisheye_ep_calib.calibration import calibrate


def off_line(observations, view: int) -> np.ndarray:
    """bool (M,): the view's sightings that are not on the line through the first of its points along y."""
    points = observations.object_points[observations.point_index]
    inside = observations.image_index == view
    first = points[inside][0]
    return inside & (np.abs(points[:, 0] - first[0]) > 1e-9)


def test_a_view_of_a_single_line_of_points_is_left_out_and_harmless() -> None:
    _, observations = unknown_scene(3, 80)
    view = int(observations.image_index[0])
    lined = rows(observations, ~off_line(observations, view))
    assert (lined.image_index == view).sum() >= 4
    result = calibrate(lined, "ep_even")
    assert result.converged and not result.rejected
    assert view not in result.view_images
    others = calibrate(rows(observations, observations.image_index != view), "ep_even")
    np.testing.assert_allclose(result.camera.parameters, others.camera.parameters, rtol=1e-9)


def test_points_of_views_that_are_too_small_are_not_called_wrong() -> None:
    _, observations = unknown_scene(4, 80)
    view = int(observations.image_index[0])
    observations = rows(observations, np.r_[:3, (observations.image_index == view).sum() : len(observations.pixels)])
    pixels = observations.pixels.copy()
    pixels[200] += [60.0, -40.0]
    result = calibrate(replace(observations, pixels=pixels), "ep_even")
    named = [(point.view, point.point) for point in result.rejected]
    assert named == [(observations.image_index[200], observations.point_index[200])]
    assert result.rejected[0].residual == pytest.approx((-60.0, 40.0), abs=2)
