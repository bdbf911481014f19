"""Which shape the board has where a known camera is measured, and that none hides what is wrong with the camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bent_boards import bent, seen_bent
from known_scenes import BOARD, CAMERA, poses_of, seen, with_gross_errors

from fisheye_ep_calib import calibrate, evaluate
from fisheye_ep_calib.calibration.assessing import evaluated_board
from fisheye_ep_calib.calibration.estimating.fit import refine
from fisheye_ep_calib.calibration.words import BAD, GOOD
from fisheye_ep_calib.pipeline.known_camera import known_camera
from fisheye_ep_calib.simulation import look_pose

FIRST = ("wave", 3e-4, 1)
OTHERS = {"bent otherwise": ("bow", 4e-4, 3), "flat": ("bow", 0.0, 3), "stretched": ("stretched", 3e-3, 3)}


@pytest.fixture(scope="module")
def calibrated():
    """A camera that was calibrated with a wavy board."""
    return calibrate(seen_bent(FIRST[0], FIRST[1], views=20, seed=FIRST[2])[0])


def views_of(kind: str, amount: float, seed: int, views: int = 12):
    """Other views of a board that is bent so."""
    true = bent(BOARD.object_points, kind, amount, seed)
    return replace(seen(CAMERA, true, poses_of(views, 9), 0.1, 9), object_points=BOARD.object_points)


def test_the_same_board_has_the_shape_that_was_measured(calibrated) -> None:
    judged = evaluate(calibrated, views_of(*FIRST))
    assert judged.to_dict()["board_shape"]["source"] == "measured"
    assert "the shape that the calibration measured: bent by" in judged.board_words
    assert judged.verdict.level == GOOD


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("spoilt", [False, True])
def test_another_board_of_the_same_file_has_a_shape_of_its_own(name, spoilt, calibrated) -> None:
    observations = views_of(*OTHERS[name])
    if spoilt:
        observations, _ = with_gross_errors(observations, 0.01)
    judged = evaluate(calibrated, observations)
    shape = judged.to_dict()["board_shape"]
    assert shape["source"] == ("file" if name == "flat" else "estimated")
    assert shape["held_out_px"]["measured"] > 1.2 * min(shape["held_out_px"].values()) or spoilt
    told = "not bent as the calibration's was" if name == "flat" else "estimated from these views, the camera held"
    assert told in judged.board_words
    if not spoilt:
        assert judged.median_px < 0.13  # the noise's own is 0.118
        assert judged.verdict.level == GOOD


@pytest.mark.parametrize("change", [{"fx": 1.06 * CAMERA.fx}, {"cx": CAMERA.cx + 60}, {"radial": (0.06, 0, 0, 0)}])
@pytest.mark.parametrize("name", OTHERS)
def test_no_shape_hides_a_wrong_camera(name, change, calibrated) -> None:
    wrong = replace(known_camera(calibrated), camera=replace(calibrated.camera, **change))
    assert evaluate(wrong, views_of(*OTHERS[name])).verdict.level == BAD


def upright_boards() -> np.ndarray:
    """Poses that all stand upright: fy that is 1 % off looks like paper that is 1 % longer in x."""
    rng = np.random.default_rng(5)
    return np.array(
        [
            look_pose(
                BOARD,
                np.radians(rng.uniform(0, 70)),
                rng.uniform(0, 2 * np.pi),
                rng.uniform(0.15, 0.3),
                np.radians(rng.uniform(0, 40)),
                rng.uniform(0, 2 * np.pi),
                0.0,
            )
            for _ in range(12)
        ]
    )


_PINHOLE = replace(CAMERA, model="kannala", coefficients=(), lens="perspective", radial=(), theta_max=np.radians(75))
CAMERAS = {
    "own": CAMERA,
    "plumb_bob": replace(
        _PINHOLE, fx=700.0, fy=702.0, extras={"brown_conrady": (-0.02, 0.002, 5e-4, -3e-4, *(0.0,) * 8)}
    ),
    "cahvore": replace(CAMERA, lens="cahvore", radial=(0.2, 0.01, -0.01, 0.001), theta_max=np.radians(100)),
}


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_that_a_stretched_board_would_excuse_is_not_excused(name) -> None:
    """Of any kind, those of other calibrators among them, which are held and never estimated."""
    camera = CAMERAS[name]
    views = seen(camera, BOARD.object_points, upright_boards())
    judged = evaluate(replace(camera, fy=1.01 * camera.fy), views)
    assert judged.chosen.source == "file" and judged.chosen.ambiguous and judged.rms_px > 0.4
    assert "so would another camera" in judged.board_words
    assert any(one.name == "board_or_camera" and one.concern for one in judged.findings)


def test_a_camera_whose_fit_finds_no_end_may_be_to_blame(monkeypatch) -> None:
    def endless(start, structure, *others):
        fit = refine(start, structure, *others)
        return replace(fit, adjustment=replace(fit.adjustment, converged=structure.held))

    monkeypatch.setattr(evaluated_board, "refine", endless)
    judged = evaluate(CAMERA, views_of(*OTHERS["stretched"]))
    assert judged.chosen.source == "file" and judged.chosen.ambiguous
    assert "other camera" not in judged.chosen.held_out_px


@pytest.mark.parametrize("name", CAMERAS)
def test_beside_the_right_camera_a_stretched_board_is_seen(name) -> None:
    true = bent(BOARD.object_points, "stretched", 3e-3, 3)
    views = replace(seen(CAMERAS[name], true, poses_of(12, 9), 0.1, 9), object_points=BOARD.object_points)
    judged = evaluate(CAMERAS[name], views)
    assert judged.chosen.source == "estimated" and judged.rms_px < 0.16


def test_two_views_take_the_better_of_what_is_known(calibrated) -> None:
    for shown, source in ((FIRST, "measured"), (OTHERS["bent otherwise"], "file")):
        views = views_of(*shown, views=2)
        assert evaluate(calibrated, views).chosen.source == source
