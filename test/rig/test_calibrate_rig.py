"""Rigs of known cameras in known places: found to what the noise allows, and no better claimed."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from counted_comparisons import Counted, counted
from scipy.spatial.transform import Rotation
from simulated_rig import PERIOD_NS, cameras, errors, place, see, targets_between

from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.rig import calibrate_rig
from fisheye_ep_calib.rig.uncertainty import of_inverse
from fisheye_ep_calib.rotation import moved_poses
from fisheye_ep_calib.simulation import paper_target
from fisheye_ep_calib.target.boards.chessboard import Chessboard
from fisheye_ep_calib.target.shape.measured import BoardShape

DISCS = paper_target()
SQUARE = Chessboard.create("square", 7, 7, spacing=0.014)
PLACES = [
    np.eye(4),
    place(70, (0.08, 0.01, -0.03), (0.05, 0.0, 0.02)),
    place(140, (0.05, -0.02, -0.12), (-0.03, 0.02, 0.2)),
]


def chain_poses(target, seed: int = 1, count: int = 8) -> np.ndarray:
    """The target between cameras 0 and 1, then between 1 and 2."""
    first = targets_between(PLACES[0], PLACES[1], target, count, seed)
    return np.concatenate([first, targets_between(PLACES[1], PLACES[2], target, count, seed + 1)])


@pytest.mark.parametrize("target", [DISCS, SQUARE], ids=["discs", "square board"])
def test_a_chain_of_plain_lattices_counted_from_any_end(target) -> None:
    """Cameras 0 and 2 see nothing in common; every view's points are counted from any end."""
    seen = see(cameras(3, theta_max_deg=60), PLACES, target, chain_poses(target), noise=0.1, turned=True)
    rig = calibrate_rig(seen)
    assert rig.converged and rig.paths == ((0,), (0, 1), (0, 1, 2))
    assert {(pair.a, pair.b) for pair in rig.pairs} == {(0, 1), (1, 2)}
    assert rig.rms_px == pytest.approx(0.1414, abs=0.015) and not rig.left_out
    for camera in (1, 2):
        angle, distance = errors(rig.reference_from_camera[camera], PLACES[camera])
        assert angle < 3 * np.linalg.norm(rig.rotation_sigma[camera]) < 1e-3
        assert distance < 3 * np.linalg.norm(rig.position_sigma[camera]) < 3e-4


def test_what_is_told_says_what_was_found() -> None:
    rig = calibrate_rig(see(cameras(3, theta_max_deg=60), PLACES, DISCS, chain_poses(DISCS), noise=0.1))
    told = json.loads(json.dumps(rig.to_dict()))
    assert told["reference"] == "front" and told["converged"] and told["moments"] == rig.moments
    assert [overlap["cameras"] for overlap in told["overlaps"]] == [["front", "left"], ["left", "rear"]]
    for number, (name, camera) in enumerate(told["cameras"].items()):
        pose = rig.reference_from_camera[number]
        assert name == rig.names[number]
        np.testing.assert_allclose(camera["reference_from_camera"], pose)
        np.testing.assert_allclose(camera["position_m"], pose[:3, 3])
        quaternion = camera["quaternion_xyzw"]
        np.testing.assert_allclose(Rotation.from_quat(quaternion).as_matrix(), pose[:3, :3], atol=1e-12)
        assert quaternion[3] >= 0


@pytest.mark.parametrize("weight", [0.1, 10.0])
def test_the_unit_of_the_weights_does_not_matter(weight) -> None:
    seen = see(cameras(2), PLACES[:2], SQUARE, targets_between(PLACES[0], PLACES[1], SQUARE, 8, seed=3), noise=0.1)
    observed = [one.observations for one in seen]
    weighted = [
        replace(one, observations=replace(some, weights=weight * some.weights))
        for one, some in zip(seen, observed, strict=True)
    ]
    plain, other = calibrate_rig(seen), calibrate_rig(weighted)
    assert other.position_sigma == pytest.approx(plain.position_sigma, rel=1e-3)
    assert other.reference_from_camera == pytest.approx(plain.reference_from_camera, abs=1e-6)


def test_the_pupil_is_worth_its_name_in_a_rig(capsys) -> None:
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 12, seed=3, distance=(0.1, 0.2))
    seen = see(cameras(2), PLACES[:2], DISCS, poses)
    rigs = {"entrance pupil": calibrate_rig(seen)}
    for name, distance in (("stand-in at infinity", np.inf), ("stand-in at 150 mm", 0.15)):
        stand_ins = [single_viewpoint(one.camera, distance).camera for one in seen]
        rigs[name] = calibrate_rig([replace(one, camera=camera) for one, camera in zip(seen, stand_ins, strict=True)])
    off = {name: errors(rig.reference_from_camera[1], PLACES[1]) for name, rig in rigs.items()}
    with capsys.disabled():
        print("\na camera's place in another's frame, from 12 views of a target at 100–200 mm:")
        for name, (angle, distance) in off.items():
            rms = rigs[name].rms_px
            print(f"  {name:<22}off by {1e3 * distance:.3f} mm, {np.degrees(angle):.4f}°; RMS {rms:.3f} px")
    assert off["entrance pupil"][1] < 5e-5
    assert min(off[name][1] for name in off if "stand-in" in name) > 5 * off["entrance pupil"][1]


def test_errors_are_as_large_as_claimed() -> None:
    """Over noise draws, the squared error over its covariance averages one per degree of freedom."""
    poses = chain_poses(DISCS, count=5)
    models = cameras(3, theta_max_deg=60)
    scores = []
    for seed in range(8):
        rig = calibrate_rig(see(models, PLACES, DISCS, poses, noise=0.2, seed=seed))
        for camera in (1, 2):
            step = step_between(rig.reference_from_camera[camera], PLACES[camera])
            scores.append(step @ np.linalg.solve(rig.covariance[camera], step) / 6)
    assert 0.55 < np.mean(scores) < 1.7


def test_what_the_camera_files_do_not_know_is_added() -> None:
    """Cameras drawn from their covariance: the poses err as much more as is said."""
    rng = np.random.default_rng(5)
    poses = targets_between(PLACES[0], PLACES[1], SQUARE, 6, seed=4)
    truth = cameras(2)
    seen = see(truth, PLACES[:2], SQUARE, poses, noise=0.02)
    sigma = np.array([0.5, 0.5, 0.0, 0.7, 0.7, 1e-3, 1e-3, 0.0, 0.0, 2e-4, 0.0])
    scores, exact = [], calibrate_rig(seen).position_sigma[1]
    for _ in range(12):
        drawn = [
            replace(
                one,
                camera=model.with_parameters(model.parameters + sigma * rng.normal(size=len(sigma))),
                covariance=np.diag(sigma**2),
            )
            for one, model in zip(seen, truth, strict=True)
        ]
        rig = calibrate_rig(drawn)
        assert (rig.position_sigma[1] > exact).all()
        step = step_between(rig.reference_from_camera[1], PLACES[1])
        scores.append(step @ np.linalg.solve(rig.covariance[1], step) / 6)
    assert 0.4 < np.mean(scores) < 1.8


def step_between(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(ω, δ) (6,) from the truth to what was found, for small angles."""
    turn = found[:3, :3] @ truth[:3, :3].T
    omega = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate([omega, found[:3, 3] - truth[:3, 3]])


def test_covariance_of_the_inverse() -> None:
    rng = np.random.default_rng(0)
    pose = np.linalg.inv(PLACES[1])
    root = 1e-4 * rng.normal(size=(6, 6))
    steps = rng.normal(size=(20000, 6)) @ root.T
    inverse = np.linalg.inv(moved_poses(np.broadcast_to(pose, (len(steps), 4, 4)), steps))
    sampled = np.cov(np.stack([step_between(one, PLACES[1]) for one in inverse]).T)
    assert np.allclose(of_inverse(pose, root @ root.T), sampled, atol=0.03 * np.abs(sampled).max())


def test_cameras_are_refined_with_the_rig() -> None:
    poses = targets_between(PLACES[0], PLACES[1], SQUARE, 20, seed=6, distance=(0.1, 0.3))
    truth = cameras(2)
    seen = see(truth, PLACES[:2], SQUARE, poses, noise=0.05)
    wrong = np.zeros(len(truth[0].parameters))
    wrong[[0, 1, 3, 4]] = 3.0, 3.0, -2.0, 2.0
    spoilt = [replace(one, camera=one.camera.with_parameters(one.camera.parameters + wrong)) for one in seen]
    frozen, refined = calibrate_rig(spoilt), calibrate_rig(spoilt, free_cameras=True)
    assert refined.rms_px < 0.08 < frozen.rms_px
    assert abs(refined.cameras[0].fx - truth[0].fx) < 0.5
    frozen_error, refined_error = (errors(rig.reference_from_camera[1], PLACES[1])[0] for rig in (frozen, refined))
    assert refined_error < frozen_error / 2


def test_the_bow_of_the_target_is_found() -> None:
    bow = np.array([0.4e-3, -0.2e-3, 0.0])
    points = SQUARE.object_points
    half = points[:, :2].max(axis=0) / 2
    x, y = ((points[:, :2] - half) / half).T
    bent = replace_points(SQUARE, points + np.outer(bow[0] * (1 - x**2) + bow[1] * (1 - y**2), [0, 0, 1]))
    poses = targets_between(PLACES[0], PLACES[1], SQUARE, 12, seed=7, distance=(0.1, 0.2))
    seen = see(cameras(2), PLACES[:2], bent, poses, noise=0.05)
    flat = [replace(one, observations=replace(one.observations, object_points=points)) for one in seen]
    rig = calibrate_rig(flat, warp_free=True)
    assert np.allclose(rig.board_warp, bow, atol=3e-5)
    assert calibrate_rig(flat, board_warp=bow).rms_px < 0.1 < calibrate_rig(flat, board_warp=1e-9 * bow).rms_px


def replace_points(target, points):
    return type(target)(target.name, points, None, target.columns, target.rows, target.spacing, target.row_spacing)


def test_views_of_another_moment_are_left_out() -> None:
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 14, seed=8)
    moved = poses.copy()
    moved[4] = moved_poses(moved[4], np.array([0.0, 0.02, 0.0, 0.004, 0.0, 0.0]))  # 4 mm: the target moved on
    moved[9] = poses[2]  # somewhere else altogether
    one, _ = see(cameras(2), PLACES[:2], DISCS, poses)
    _, other = see(cameras(2), PLACES[:2], DISCS, moved)
    rig = calibrate_rig([one, other])
    assert {image for _, image in rig.left_out} == {"000004", "000009"}
    assert errors(rig.reference_from_camera[1], PLACES[1])[1] < 5e-5


def test_views_most_of_which_contradict_each_other_are_refused() -> None:
    """Paired with the next image: a few views agree by chance, or because the target stood still."""
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 23, seed=8)
    poses[8:12] = poses[8]
    one, other = see(cameras(2), PLACES[:2], DISCS, poses)
    late = replace(other, stamps_ns=other.stamps_ns + PERIOD_NS)
    said = r"of 22 common views of front and left contradict each other.*left's clock (99|100)\.\d ms ahead"
    with pytest.raises(CalibrationError, match=said):
        calibrate_rig([one, late])
    rig = calibrate_rig([one, late], find_clocks=True)
    assert abs(rig.clock_offsets_ns[1] - PERIOD_NS) < 10**6
    assert errors(rig.reference_from_camera[1], PLACES[1])[1] < 1e-4
    assert calibrate_rig([one, other]).clock_offsets_ns == (0, 0)


def test_a_target_that_never_moved_is_refused_unless_it_is_unmistakable() -> None:
    poses = np.repeat(targets_between(PLACES[0], PLACES[1], DISCS, 1, seed=9), 6, axis=0)
    seen = see(cameras(2), PLACES[:2], DISCS, poses)
    with pytest.raises(CalibrationError, match="looks the same turned"):
        calibrate_rig(seen)
    rig = calibrate_rig(seen, unmistakable=True)
    assert errors(rig.reference_from_camera[1], PLACES[1])[1] < 1e-3


def test_cameras_that_nothing_joins_are_named() -> None:
    front, left, rear = see(cameras(3, theta_max_deg=60), PLACES, DISCS, chain_poses(DISCS))
    with pytest.raises(CalibrationError, match=r"front, left \| rear"):
        calibrate_rig([front, left, replace(rear, stamps_ns=rear.stamps_ns + 100 * PERIOD_NS)])


def test_clocks_that_never_agree_are_told_with_the_gap() -> None:
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 6, seed=11)
    one, other = see(cameras(2), PLACES[:2], DISCS, poses, jitter_ns=0)
    late = replace(other, stamps_ns=other.stamps_ns + 23 * 10**6)
    with pytest.raises(CalibrationError, match="23.0 ms apart"):
        calibrate_rig([one, late])
    assert calibrate_rig([one, late], tolerance=0.03).converged


def test_wrong_input_is_refused() -> None:
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 4, seed=12)
    one, other = see(cameras(2), PLACES[:2], DISCS, poses)
    with pytest.raises(InputError, match="two cameras at least"):
        calibrate_rig([one])
    with pytest.raises(InputError, match="same name"):
        calibrate_rig([one, replace(other, name="front")])
    with pytest.raises(InputError, match="different targets"):
        calibrate_rig([one, replace(other, observations=replace(other.observations, disc_radius=0.003))])
    with pytest.raises(InputError, match="fewer stamps"):
        calibrate_rig([one, replace(other, stamps_ns=other.stamps_ns[:2])])


def wavy_views(noise: float = 0.1):
    """What two cameras see of a wavy board whose file knows nothing of it, and its shape."""
    points = SQUARE.object_points
    half = points[:, :2].max(axis=0) / 2
    x, y = ((points[:, :2] - half) / half).T
    deviation = np.zeros_like(points)
    deviation[:, 2] = 0.5e-3 * np.cos(3 * x) * np.cos(2 * y)
    poses = targets_between(PLACES[0], PLACES[1], SQUARE, 12, seed=4)
    seen = see(cameras(2), PLACES[:2], replace(SQUARE, object_points=points + deviation), poses, noise)
    flat = [replace(one, observations=replace(one.observations, object_points=points)) for one in seen]
    return flat, BoardShape("free", points, deviation)


def test_a_target_whose_shape_is_known_leaves_only_the_noise() -> None:
    """A camera that brings the shape is enough: they all look at the same target."""
    flat, shape = wavy_views()
    known = [replace(flat[0], observations=flat[0].observations.with_board(shape)), flat[1]]
    assert calibrate_rig(known).rms_px == pytest.approx(0.1414, abs=0.015)
    assert calibrate_rig(flat, board_warp=np.full(3, 1e-12)).rms_px > 0.2
    measured = calibrate_rig([replace(flat[0], board=shape), flat[1]])
    assert measured.rms_px == pytest.approx(0.1414, abs=0.015)
    assert measured.board.source == "measured"
    assert "shape that the calibration measured" in measured.to_dict()["board"]["words"]


@pytest.mark.parametrize("another", [False, True], ids=["nothing known", "another board's shape known"])
def test_a_target_whose_shape_is_not_known_is_estimated(another) -> None:
    flat, shape = wavy_views()
    if another:
        bow = BoardShape("free", shape.object_points, shape.deviation[::-1] * [0, 0, -2])
        flat = [replace(one, board=bow) for one in flat]
    rig = calibrate_rig(flat)
    assert rig.board.source == "estimated" and rig.rms_px == pytest.approx(0.1414, abs=0.015)
    assert rig.board.board.height_rms_mm == pytest.approx(1e3 * shape.deviation[:, 2].std(), rel=0.2)
    assert errors(rig.reference_from_camera[1], PLACES[1])[1] < 3 * np.linalg.norm(rig.position_sigma[1])
    none = np.full(3, 1e-12)
    assert np.linalg.norm(rig.position_sigma[1]) < np.linalg.norm(
        calibrate_rig(flat, board_warp=none).position_sigma[1]
    )


def test_a_flat_target_stays_as_its_file_has_it() -> None:
    poses = targets_between(PLACES[0], PLACES[1], SQUARE, 12, seed=4)
    rig = calibrate_rig(see(cameras(2), PLACES[:2], SQUARE, poses))
    assert rig.board.source == "file" and rig.board.board is None


def test_work_goes_with_the_sightings_not_with_images_times_sightings() -> None:
    poses = targets_between(PLACES[0], PLACES[1], DISCS, 60, seed=1)
    seen = see(cameras(2, theta_max_deg=60), PLACES[:2], DISCS, poses)
    seen = [replace(rig_camera, observations=counted(rig_camera.observations)) for rig_camera in seen]
    rig = calibrate_rig(seen)
    assert rig.moments == 60
    sightings = sum(len(rig_camera.observations.pixels) for rig_camera in seen)
    assert Counted.compared < 20 * sightings  # a comparison with every image is 60 a sighting and pass
