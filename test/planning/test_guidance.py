"""Where to hold the target next: views chosen by it know the pupil sooner than random ones."""

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.calibration.assessing.uncertainty import uncertainty
from fisheye_ep_calib.calibration.estimating.adjustment import evaluate
from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.normal_equations import reduced_information
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.bands import pupil_sigma
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board, Sight
from fisheye_ep_calib.planning.field import Field
from fisheye_ep_calib.planning.guidance import (
    Suggestion,
    candidates,
    faces_away,
    few_points,
    next_views,
    sigma_against_guided,
)
from fisheye_ep_calib.planning.view_information import variance_reduction, view_information
from fisheye_ep_calib.simulation import observe, paper_camera, paper_target, random_poses
from fisheye_ep_calib.target import Target, load_target, parse_target

NOISE = 0.05
TARGET = paper_target()
BOARD = Board.of(TARGET)


BOARDS = {
    "chessboard": load_target("chessboard_9x6"),
    "charuco": parse_target(
        {
            "type": "charuco",
            "columns": 7,
            "rows": 5,
            "spacing": 0.02,
            "marker_size": 0.015,
            "dictionary": "DICT_4X4_50",
        }
    ),
    "aprilgrid": load_target("aprilgrid_6x5"),
}


def whole(camera: FisheyeCamera, target: Target, pose: np.ndarray) -> bool:
    """Whether all points are in the image."""
    pixels, valid = camera.project(target.object_points @ pose[:3, :3].T + pose[:3, 3])
    return bool((valid & (pixels > 0).all(axis=-1) & (pixels < np.array(camera.image_size) - 1).all(axis=-1)).all())


def fitted(poses: np.ndarray, seed: int, model: str):
    return refine(first_fit(prepare(observe(paper_camera(), TARGET, poses, NOISE, seed))), Structure(model))


def pupil_band(fit) -> float:
    """σ of E(60°), metres, at the true noise."""
    known = uncertainty(fit)
    return float(pupil_sigma(fit.state.camera, known.covariance, np.radians(60.0))) * NOISE / known.sigma_px


def suggested(fit, count: int, sight: Sight = EVERYWHERE) -> list[Suggestion]:
    camera, poses = replace(fit.state.camera, theta_max=fit.largest_angle), fit.state.camera_from_target
    offered = candidates(camera, BOARD, faces_away(BOARD, poses), sight)
    return next_views(camera, BOARD, poses, offered, count, Field.of(few_points(BOARD.points), poses, offered.poses))


def views_needed(seed: int, most: int = 15) -> int:
    """How many guided views reach the band of 25 random ones."""
    goal = pupil_band(fitted(random_poses(TARGET, 25, seed), seed, "ep_odd"))
    poses = list(random_poses(TARGET, 4, seed + 100, theta_deg=(0, 50)))
    while len(poses) < most:
        fit = fitted(np.array(poses), seed, "ep_odd" if len(poses) >= 6 else "ep_even")
        if len(poses) >= 6 and pupil_band(fit) <= goal:
            return len(poses)
        poses.append(suggested(fit, 1)[0].camera_from_target)
    return most


def test_information_of_a_view_is_that_of_the_adjustment():
    """Of every parameter, where both see the same corners."""
    poses = random_poses(TARGET, 6, 3, theta_deg=(0, 60))
    points = observe(paper_camera(), replace(TARGET, disc_radius=None), poses, NOISE, 3)
    assert len(points.pixels) == 6 * len(TARGET.object_points)
    fit = refine(first_fit(prepare(points)), Structure("ep_even"))
    told = view_information(fit.state.camera, TARGET.object_points, fit.state.camera_from_target)
    expected = reduced_information(evaluate(fit.problem, fit.state))
    scale = np.sqrt(np.diag(expected))
    assert np.abs((told.information.sum(axis=0) - expected) / scale / scale[:, None]).max() < 1e-6


def test_variance_reduction_is_what_a_little_of_a_view_takes_away():
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(6, 9, 5)) * [1, 10, 100, 0.1, 1]
    information = np.swapaxes(roots, 1, 2) @ roots
    known, sought = information[:4].sum(axis=0), rng.normal(size=(3, 5))
    little = 1e-6

    def variance(matrix):
        return np.einsum("qi,ij,qj->q", sought, np.linalg.inv(matrix), sought)

    lost = [(1 - variance(known + little * one) / variance(known)).sum() / little for one in information]
    np.testing.assert_allclose(variance_reduction(information, known, sought), lost, rtol=1e-4)


def test_a_suggestion_points_where_it_says():
    fit = fitted(random_poses(TARGET, 5, 1, theta_deg=(0, 40)), 1, "ep_even")
    suggestion = suggested(fit, 1)[0]
    middle = 0.5 * (TARGET.object_points.min(axis=0) + TARGET.object_points.max(axis=0))
    seen = suggestion.camera_from_target @ np.append(middle, 1.0)
    assert np.isclose(np.linalg.norm(seen[:3]), suggestion.distance)
    assert np.isclose(np.arctan2(np.hypot(seen[0], seen[1]), seen[2]), suggestion.theta)
    assert suggestion.theta > np.radians(40), "nothing was held beyond 40°: out there is what is missing"
    assert f" of the image ({np.degrees(suggestion.theta):.0f}° off the axis)" in suggestion.sentence
    assert f"about {100 * suggestion.distance:.0f} cm away" in suggestion.sentence
    assert 0 < suggestion.gain <= 1


def test_forty_guided_views_are_the_measure_of_how_well_the_pupil_is_known():
    """Random ones of the paper's distances are far from it, some thirty guided ones are near."""
    fit = fitted(random_poses(TARGET, 25, 4), 4, "ep_odd")
    camera, poses = replace(fit.state.camera, theta_max=fit.largest_angle), fit.state.camera_from_target
    offered = candidates(camera, BOARD, faces_away(BOARD, poses))

    def against(poses: np.ndarray) -> float:
        return sigma_against_guided(camera, BOARD, poses, offered, np.radians(60.0))

    asked = [one.camera_from_target for one in next_views(camera, BOARD, poses[:4], offered, 30)]
    assert against(poses[:8]) > against(poses) > 2
    assert 0.9 < against(np.concatenate([poses[:4], asked])) < 1.3


def test_a_pose_that_was_tried_in_vain_is_not_asked_for_again():
    fit = fitted(random_poses(TARGET, 6, 1, theta_deg=(0, 40)), 1, "ep_even")
    camera, poses = replace(fit.state.camera, theta_max=fit.largest_angle), fit.state.camera_from_target
    offered = candidates(camera, BOARD, faces_away(BOARD, poses))
    tried: list[Suggestion] = []
    for _ in range(4):
        (now,) = next_views(camera, BOARD, poses, offered, 1, tried=tried)
        assert not any(now.like(one) for one in tried)
        tried.append(now)


def test_a_board_too_fine_to_be_seen_anywhere_gets_no_suggestion():
    fit = fitted(random_poses(TARGET, 5, 1, theta_deg=(0, 40)), 1, "ep_even")
    assert suggested(fit, 3, replace(EVERYWHERE, blur=1e3)) == []


@pytest.mark.parametrize("kind", ["circle_grid", "chessboard", "charuco", "aprilgrid"])
def test_a_narrow_lens_is_known_with_half_as_many_views_too(kind: str) -> None:
    """By what the views would tell: in 12 of 25, of which the first four are none of guidance's."""
    camera = FisheyeCamera(
        image_size=(960, 720),
        fx=573.0,
        fy=573.0,
        cx=483.0,
        cy=356.0,
        radial=(0.012, -0.003, 0.0, 0.0),
        model="ep_even",
        coefficients=(-5e-4, -1e-4),
        theta_max=np.radians(61),
    )
    target = {**BOARDS, "circle_grid": TARGET}[kind]
    board, few = Board.of(target), few_points(target.object_points)
    shown = [pose for pose in random_poses(target, 300, 2, (0.1, 0.3), (0, 46), (5, 50)) if whole(camera, target, pose)]
    offered = candidates(camera, board, faces_away(board, np.array(shown[:4])))
    asked = next_views(camera, board, np.array(shown[:4]), offered, 8)
    row = np.zeros(len(camera.parameters))
    row[camera.parameter_slice("coefficients")] = camera.pupil_family.basis(np.radians(55.0), 2)

    def sigma(poses: list[np.ndarray]) -> float:
        known = view_information(replace(camera, theta_max=np.pi), few, np.array(poses)).information.sum(axis=0)
        return float(np.sqrt(row @ np.linalg.solve(known, row)))

    assert len(shown) >= 25
    assert sigma([*shown[:4], *(one.camera_from_target for one in asked)]) < sigma(shown[:25])


def test_guided_views_know_the_pupil_with_half_as_many():
    assert views_needed(1) <= 12


@pytest.mark.slow
def test_guided_views_know_the_pupil_with_half_as_many_whatever_the_start():
    assert np.median([views_needed(seed) for seed in range(10)]) <= 12
