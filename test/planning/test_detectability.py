"""What is asked for can be seen: suggested poses, rendered through a lens that guidance does not know, are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import half_size

from fisheye_ep_calib.calibration.estimating.fit import first_fit, refine
from fisheye_ep_calib.calibration.estimating.sightings import prepare
from fisheye_ep_calib.calibration.structure import Structure
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.live.frame import LIGHT_CELLS, blur_about, light_of, second_look
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board, Sight, detectable, light_ends
from fisheye_ep_calib.planning.field import SECTORS, Field
from fisheye_ep_calib.planning.first_views import assumed_camera, first_views
from fisheye_ep_calib.planning.guidance import candidates, faces_away, few_points, next_views
from fisheye_ep_calib.simulation import look_pose, observe, paper_camera, paper_target, random_poses
from fisheye_ep_calib.simulation.rendering import Imaging, render
from fisheye_ep_calib.target import Target, load_target, parse_target

TARGETS = {
    "circles": paper_target(),
    "chessboard": parse_target({"type": "chessboard", "columns": 10, "rows": 7, "spacing": 0.012}),
    "aprilgrid": parse_target({"type": "aprilgrid", "columns": 4, "rows": 3, "tag_size": 0.03, "tag_gap": 0.009}),
    "charuco": load_target("charuco_10x7"),
}


CAMERA = half_size(paper_camera())


def imaging(blur: float, seed: int) -> Imaging:
    return Imaging(blur=blur, noise=2.0, texture=30.0, vignetting=0.3, seed=seed)


def sight_of(target: Target, blur: float) -> Sight:
    """As the live node gathers it from a first view."""
    image = render(CAMERA, target, look_pose(target, 0.1, 0.0, 0.15), imaging(blur, 0))
    found = target.detector().detect(image)
    light = light_of(image)
    return Sight(light > 0.12 * np.quantile(light, 0.9), blur_about(image, found.pixels))


def found_share(target: Target, pose: np.ndarray, blur: float, seed: int, known: FisheyeCamera | None = None) -> float:
    """As the live node looks: twice, where it knows the camera."""
    image = render(CAMERA, target, pose, imaging(blur, seed))
    detector = target.detector()
    found = detector.detect(image)
    if known is not None:
        found = second_look(detector, image, found, target, known)
    return len(found) / len(target.object_points)


def guided(target: Target, sight: Sight, count: int, seed: int) -> tuple[FisheyeCamera, list[np.ndarray]]:
    """The camera and the poses that are asked for after six views about the middle."""
    poses = random_poses(target, 6, seed, (0.1, 0.2), (0, 50))
    fit = refine(first_fit(prepare(observe(CAMERA, target, poses, 0.05, seed))), Structure("ep_even"))
    camera, known = replace(fit.state.camera, theta_max=fit.largest_angle), fit.state.camera_from_target
    board = Board.of(target)
    offered = candidates(camera, board, faces_away(board, known), sight)
    field = Field.of(few_points(board.points), known, offered.poses)
    asked = next_views(camera, board, known, offered, count, field)
    return camera, [one.camera_from_target for one in asked]


def test_the_light_and_the_blur_of_an_image_are_seen() -> None:
    sharp, blurred = (sight_of(TARGETS["chessboard"], blur) for blur in (0.7, 2.0))
    assert abs(sharp.blur - 0.7) < 0.4 and abs(blurred.blur - 2.0) < 0.5
    board = Board.of(TARGETS["chessboard"])
    assert board.least_feature(sharp) == 5.5 and 6.5 < board.least_feature(blurred) < 10
    assert sharp.lit.shape == (LIGHT_CELLS, LIGHT_CELLS)
    assert not sharp.lit[0, 0] and not sharp.lit[-1, -1] and sharp.lit[32, 1:-1].all()


def test_a_board_across_the_edge_of_the_light_too_far_or_behind_is_not_detectable() -> None:
    target = TARGETS["circles"]
    board, sight = Board.of(target), sight_of(target, 0.7)

    def can(theta: float, distance: float, tilt: float = 0.0, where: Sight = sight) -> bool:
        pose = look_pose(target, np.radians(theta), 0.3, distance, np.radians(tilt))
        return bool(detectable(CAMERA, board, pose[None], where)[0])

    assert can(0, 0.12) and can(60, 0.2)
    assert not can(85, 0.12)  # a part of it beyond the rim
    assert can(0, 0.40) and not can(0, 0.55)  # discs of 4.3 px
    assert not can(0, 0.30, tilt=70)
    assert not can(0, 0.25, where=replace(sight, blur=3.0))
    assert not can(170, 0.12, where=EVERYWHERE)


@pytest.mark.parametrize("name", TARGETS)
def test_only_what_is_about_the_points_must_be_inside_the_image(name: str) -> None:
    """Not the white border, which can be as wide as it likes: a lens sees less than half of what it could then."""
    target = TARGETS[name]
    board = Board.of(target)
    camera = FisheyeCamera((960, 720), 573.0, 573.0, 479.5, 359.5, radial=(0.0, 0.0, 0.0, 0.0), theta_max=np.pi)
    poses = random_poses(target, 300, 4, (0.09, 0.2), (10, 50), (0, 30))
    can = detectable(camera, board, poses, EVERYWHERE)
    whole = detectable(camera, replace(board, needed=board.outline), poses, EVERYWHERE)
    assert not (whole & ~can).any()
    cut = poses[can & ~whole]
    assert len(cut) >= 5
    for number, pose in enumerate(cut[:5]):
        found = target.detector().detect(render(camera, target, pose, imaging(0.7, number)))
        assert len(found) >= 0.8 * len(target.object_points)


def test_coverage_counts_against_the_image_circle_not_against_what_was_shown() -> None:
    target = TARGETS["circles"]
    poses, board = random_poses(target, 12, 3, (0.1, 0.2), (0, 20)), Board.of(target)
    known = replace(CAMERA, theta_max=np.radians(50))
    ends = light_ends(known, np.linspace(0, 2 * np.pi, SECTORS, endpoint=False), sight_of(target, 0.7))
    assert (np.abs(np.degrees(ends) - 95) < 12).all(), np.degrees(ends)
    field = Field.of(few_points(board.points), poses, poses[:0], ends)
    assert field.finding.concern and "75–90° off the axis" in field.finding.sentence
    assert not Field.of(few_points(board.points), poses, poses[:0]).finding.concern  # of what was shown all is covered


@pytest.mark.parametrize("name", TARGETS)
def test_what_is_asked_for_is_found(name: str) -> None:
    target = TARGETS[name]
    sight = sight_of(target, 0.7)
    camera, poses = guided(target, sight, 8, 1)
    shares = [found_share(target, pose, 0.7, number, camera) for number, pose in enumerate(poses)]
    assert len(shares) == 8 and np.mean(np.array(shares) >= 0.8) >= 0.95, shares


# Edges of cells of few pixels look sharper than they are: from a far view of small markers the blur is told too small.
FALLS_SHORT = {("charuco", 2.0): pytest.mark.xfail(reason="blur is measured too small on small markers")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "blur"),
    [pytest.param(name, blur, marks=FALLS_SHORT.get((name, blur), ())) for name in TARGETS for blur in (0.7, 2.0)],
)
def test_nineteen_of_twenty_poses_asked_for_are_found(name: str, blur: float) -> None:
    target = TARGETS[name]
    sight = sight_of(target, blur)
    asked = [
        (camera, pose) for seed in range(3) for camera, poses in [guided(target, sight, 14, seed)] for pose in poses
    ]
    shares = np.array([found_share(target, pose, blur, number, known) for number, (known, pose) in enumerate(asked)])
    print(f"{name}, blur {blur}: {np.mean(shares >= 0.8):.3f} of {len(shares)} found with 80 % of the points")
    assert len(shares) >= 30 and np.mean(shares >= 0.8) >= 0.95, shares.round(2)


def test_first_views_go_from_the_middle_to_the_edges_near_and_far_and_are_found() -> None:
    target = TARGETS["circles"]
    sight = sight_of(target, 0.7)
    camera = assumed_camera(CAMERA.image_size, sight)
    assert abs(camera.cx - CAMERA.cx) < 20 and abs(camera.cy - CAMERA.cy) < 20
    views = first_views(Board.of(target), CAMERA.image_size, sight, away=True)
    assert len(views) >= 14 and views[0].theta == 0
    assert {one.sentence.split(",")[0] for one in views[1:5]} == {
        f"hold the target towards the {sector} {part} of the image"
        for sector, part in zip(("right", "left", "upper", "lower"), ("part",) * 4, strict=True)
    }
    assert max(one.distance for one in views) > 2 * min(one.distance for one in views)
    shares = [found_share(target, one.camera_from_target, 0.7, number) for number, one in enumerate(views[:10])]
    assert np.mean(np.array(shares) >= 0.8) >= 0.95, shares
