"""What is asked for: one pose after the other, until reached, given up, or enough is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fisheye_ep_calib.live.advice import Wanted, first_plan
from fisheye_ep_calib.live.camera_views import Verdict
from fisheye_ep_calib.live.frame import Sighting
from fisheye_ep_calib.live.guide import FRAMES, PATIENCE, Guide
from fisheye_ep_calib.live.look import Event, Looks
from fisheye_ep_calib.live.seeing import Seeing
from fisheye_ep_calib.planning.detectability import EVERYWHERE, Board
from fisheye_ep_calib.planning.steering import steer
from fisheye_ep_calib.planning.view_selection import ViewSignature, view_signature
from fisheye_ep_calib.simulation import look_pose, paper_camera, paper_target
from fisheye_ep_calib.target import Detection

TARGET = paper_target()
CAMERA = paper_camera()


def seen(theta: float, azimuth: float, distance: float, tilt: float = 0.0, turn: float = 0.0) -> ViewSignature:
    """Signature of the board in a direction, degrees."""
    pose = look_pose(TARGET, np.radians(theta), np.radians(azimuth), distance, np.radians(tilt), np.radians(turn))
    pixels, valid = CAMERA.project(TARGET.object_points @ pose[:3, :3].T + pose[:3, 3])
    signature = view_signature(TARGET.object_points[valid], pixels[valid], CAMERA.image_size)
    assert signature is not None
    return signature


@pytest.fixture
def plan() -> tuple[Wanted, ...]:
    return first_plan(TARGET, CAMERA.image_size, EVERYWHERE, CAMERA)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_next_is_asked_for_once_one_is_reached(plan) -> None:
    guide = Guide()
    guide.follow(plan)
    assert guide.wanted is plan[0] and "middle" in plan[0].sentence
    guide.searched(None)
    guide.searched(plan[1].signature)  # another one
    assert guide.wanted is plan[0]
    guide.searched(plan[0].signature)
    assert guide.wanted is plan[1] and guide.tried == ()


def test_a_pose_that_is_not_reached_is_given_up_for_good(plan) -> None:
    clock = Clock()
    guide = Guide(clock)
    guide.follow(plan)
    for _ in range(FRAMES):
        guide.searched(None)
    assert guide.wanted is plan[0]  # not before time has passed as well
    clock.now += PATIENCE + 1
    guide.searched(None)
    assert guide.wanted is plan[1] and guide.tried == (plan[0].suggestion,)
    guide.follow(plan)
    assert guide.wanted is plan[1]


def test_what_was_tried_is_asked_for_again_once_nothing_else_is_left(plan) -> None:
    clock = Clock()
    guide = Guide(clock)
    guide.follow(plan[:2])
    for _ in range(2 * FRAMES):
        clock.now += PATIENCE
        guide.searched(None)
    assert guide.wanted is None and len(guide.tried) == 2
    guide.follow(plan[:2], [plan[0].signature])
    assert guide.wanted is plan[1] and guide.tried == ()


def test_a_small_image_has_a_plan_too() -> None:
    assert len(first_plan(TARGET, (640, 640), EVERYWHERE)) >= 12


def test_what_kept_views_show_is_not_asked_for(plan) -> None:
    guide = Guide()
    guide.follow(plan, [one.signature for one in plan[:3]])
    assert guide.wanted is plan[3]
    guide.forget()
    assert guide.wanted is None


def test_steering_says_which_way() -> None:
    middle = seen(0, 0, 0.15)
    right = steer(middle, seen(45, 0, 0.15))
    assert right.move[0] > 0.1 and abs(right.move[1]) < 0.05 and right.sentence.startswith("right")
    assert steer(middle, seen(45, 90, 0.15)).sentence.startswith("down")
    assert steer(middle, seen(0, 0, 0.08)).sentence == "nearer"
    assert steer(middle, seen(0, 0, 0.40)).sentence == "farther"
    assert steer(middle, middle).reached and steer(middle, middle).sentence == "hold it there"
    one, other = (steer(middle, seen(0, 0, 0.15, 50, turn)) for turn in (0, 180))
    assert {one.tip, other.tip} == {"upper", "lower"}
    assert {steer(middle, seen(0, 0, 0.15, 50, turn)).tip for turn in (90, 270)} == {"left", "right"}


def test_the_side_to_bring_nearer_is_the_one_that_is_nearer_where_it_is_wanted() -> None:
    wanted = look_pose(TARGET, 0.0, 0.0, 0.15, np.radians(50), np.radians(90))
    in_camera = TARGET.object_points @ wanted[:3, :3].T + wanted[:3, 3]
    nearer_is_right = in_camera[in_camera[:, 2].argmin(), 0] > 0
    assert steer(seen(0, 0, 0.15), seen(0, 0, 0.15, 50, 90)).tip == ("right" if nearer_is_right else "left")


def test_the_most_telling_look_since_it_was_asked_for() -> None:
    looks = Looks()
    found = Detection(np.arange(20), np.zeros((20, 2)))

    def look(verdict: Verdict, detection: Detection = found) -> None:
        looks.take(Sighting("1", (100, 100), detection), verdict)

    look(Verdict.NOT_NEW)
    look(Verdict.KEPT)
    look(Verdict.NOT_FOUND, Detection(reason="blurred by about 6 px: no board"))
    assert looks.last.event is Event.BLURRED and looks.last.number == 3
    assert looks.since_asked().event is Event.KEPT
    look(Verdict.NOT_NEW)
    assert looks.since_asked().event is Event.NOT_NEW
    assert looks.since_asked().event is Event.NONE


def test_light_is_gathered_over_frames_and_blur_is_their_median() -> None:
    seeing, nothing = Seeing(), Detection(reason="none")
    assert seeing.sight().lit.all() and seeing.sight().blur == 1.0
    left, right = np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8)
    left[:, 1], right[:, 2] = 200, 200
    for light, blur in ((left, 0.8), (right, 3.0), (right, 0.9)):
        seeing.take(replace(Sighting("1", (40, 40), nothing), light=light, blur=blur))
    sight = seeing.sight()
    assert sight.lit.any(axis=0).tolist() == [False, True, True, False] and sight.blur == 0.9
    assert Board.of(TARGET).feature == 0.008
