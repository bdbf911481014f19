"""The detectors' evaluation set: its truth holds in the rendered images, for every kind of target."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fisheye_ep_calib.simulation import disc_centroids, paper_camera, paper_target, render
from fisheye_ep_calib.simulation.evaluation_set import VIEW_KINDS, evaluation_set
from fisheye_ep_calib.target.boards.aprilgrid import AprilGrid
from fisheye_ep_calib.target.boards.charuco import Charuco

needs_aruco = pytest.mark.skipif(not hasattr(cv2, "aruco"), reason="this OpenCV has no aruco")


@pytest.fixture(scope="module")
def camera():
    return paper_camera()


def test_every_kind_of_view_is_there_and_repeats(camera):
    target = paper_target()
    views = evaluation_set(camera, target, seed=1)
    assert len(views) >= 36
    assert {view.kind for view in views} == {kind.name for kind in VIEW_KINDS}
    again = evaluation_set(camera, target, seed=1)
    assert all(np.array_equal(a.pose, b.pose) for a, b in zip(views, again, strict=True))
    assert not np.array_equal(views[0].pose, evaluation_set(camera, target, seed=2)[0].pose)


def test_the_set_reaches_90_degrees_and_hides_discs_only_behind_occluders(camera):
    target = paper_target()
    views = evaluation_set(camera, target)
    widest = max(camera.unproject(view.pixels)[1][..., 2].min() for view in views if view.kind == "edge")
    steepest = min(camera.unproject(view.pixels)[1][..., 2].min() for view in views if view.kind == "edge")
    assert steepest < np.cos(np.radians(89)) and widest < np.cos(np.radians(60))
    for view in views:
        share = view.visible.mean()
        assert 0.4 < share < 0.95 if view.kind == "occluded" else share > 0.7


def test_hidden_and_visible_discs_are_so_in_the_image(camera):
    target = paper_target()
    view = next(view for view in evaluation_set(camera, target) if view.kind == "occluded")
    image = view.image(camera, target)
    without = render(camera, target, view.pose, type(view.imaging)(**{**vars(view.imaging), "occluders": ()}))
    changed = np.abs(image.astype(int) - without) > 30
    column, row = np.round(view.pixels).astype(int).T
    assert not changed[row, column][view.visible].any()
    assert changed[row, column].any()


def test_only_discs_of_a_usable_size_are_asked_for(camera):
    target = paper_target()
    for view in evaluation_set(camera, target):
        rim = [
            disc_centroids(camera, target.object_points + offset, 1e-5, view.pose)[0]
            for offset in target.disc_radius * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        ]
        axes = np.stack([rim[0] - rim[1], rim[2] - rim[3]], axis=-1)
        assert np.linalg.svd(axes, compute_uv=False)[:, 1].min() > 5


@needs_aruco
def test_charuco_markers_are_where_and_what_the_truth_says(camera):
    target = Charuco.create("board", 8, 5, 0.014, 0.0105, "DICT_5X5_250")
    view = evaluation_set(camera, target)[0]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(view.image(camera, target))
    assert sorted(ids.ravel()) == list(range(len(target.marker_squares)))
    place = target.tag_corners[ids.ravel()]
    square = target.marker_size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    points = np.pad(place[:, None] + square, ((0, 0), (0, 0), (0, 1)))
    expected, _ = camera.project(points @ view.pose[:3, :3].T + view.pose[:3, 3])
    assert np.abs(np.concatenate(corners) - expected).max() < 2


@needs_aruco
def test_aprilgrid_tags_are_where_and_what_the_truth_says(camera):
    target = AprilGrid.create("grid", 6, 4, 0.016, 0.0048)
    view = evaluation_set(camera, target)[1]
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = 2
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(view.image(camera, target))
    assert len(ids) >= 20
    truth = view.pixels[target.tag_points[ids.ravel()]]
    middle = np.concatenate(corners).mean(axis=1)
    assert np.abs(middle - truth.mean(axis=1)).max() < 2
    nearest = np.linalg.norm(np.concatenate(corners)[:, :, None] - truth[:, None], axis=-1).min(axis=-1)
    assert np.median(nearest) < 2 and nearest.max() < 5
