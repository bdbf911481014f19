"""Real boards and a ray-traced lens: figures that were measured independently."""

from __future__ import annotations

import numpy as np
import pytest

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def ov_plane(shared_data) -> Observations:
    return Observations.load(shared_data / "ov_plane" / "observations.npz")


@pytest.fixture(scope="module")
def laikin(shared_data):
    """Calibration and held-out observations by noise, and the true (θ rad, E metres)."""
    data = np.load(shared_data / "oracle_laikin" / "oracle.npz")

    def observations(which: str, noise: str) -> Observations:
        pixels = data[f"{which}_uv_{noise}"]
        view, point = (index.ravel() for index in np.indices(pixels.shape[:2]))
        return Observations.create(1e-3 * data["object_points"], view, point, pixels.reshape(-1, 2), (2048, 2048))

    return observations, data["curve_theta"], -1e-3 * data["curve_shift_mm"]


@pytest.mark.parametrize(
    ("model", "options", "limit"),
    [
        ("kannala", {}, 0.480),
        ("ep_odd", {}, 0.465),
        ("kannala", {"board_warp": True}, 0.395),
        ("ep_even", {"board_warp": True}, 0.38),
        ("gennery", {"board_warp": True}, 0.38),
    ],
)
def test_a_partial_board_beyond_90_degrees(ov_plane, model, options, limit) -> None:
    result = calibrate(ov_plane, model, **options)
    assert result.views == 25 and result.converged and not result.wrong_views
    assert result.points >= 9500 and result.points + len(result.rejected) == 9587
    assert 0.3 < result.rms_px <= limit
    if options:
        assert 0.2e-3 < np.abs(result.board_warp).max() < 0.6e-3


def test_the_pupil_helps_on_views_it_was_not_fitted_to(ov_plane) -> None:
    trained = ov_plane.select_images(np.flatnonzero(ov_plane.split == "train"))
    tested = ov_plane.select_images(np.flatnonzero(ov_plane.split == "test"))
    rms = {}
    for model in ("kannala", "ep_odd", "ep_even", "gennery"):
        result = calibrate(trained, model, board_warp=True)
        rms[model] = evaluate_camera(result.camera, tested, result.board_warp).rms_px
    assert max(rms["ep_odd"], rms["ep_even"], rms["gennery"]) < 0.985 * rms["kannala"]


@pytest.mark.parametrize(("name", "supported"), [("ov_plane", True), ("urban_fisheye2", False), ("jy_left", False)])
def test_the_verdict(shared_data, name, supported) -> None:
    result = calibrate(Observations.load(shared_data / name / "observations.npz"))
    assert result.entrance_pupil_supported == supported
    answers = ("supported",) if supported else ("doubtful", "not distinguishable")
    assert result.pupil_verdict.answer in answers
    assert np.any(result.board_warp)  # every one of these boards is bent
    assert result.comparison.keys() == {"kannala", "gennery", "ep_odd", "ep_even"}


@pytest.mark.parametrize(
    ("model", "noise", "fitted", "held_out"),
    [
        ("kannala", "clean", (0.93, 0.95), (1.38, 1.41)),
        ("ep_odd", "clean", (0.06, 0.07), (0.11, 0.13)),
        ("ep_even", "clean", (0.0, 0.0100), (0.0, 0.0155)),
        ("gennery", "clean", (0.0, 0.0095), (0.0, 0.0125)),
        ("kannala", "noisy", (0.935, 0.955), (1.38, 1.41)),
        ("ep_odd", "noisy", (0.09, 0.10), (0.13, 0.15)),
        ("ep_even", "noisy", (0.068, 0.072), (0.068, 0.073)),
        ("auto", "noisy", (0.068, 0.072), (0.068, 0.073)),
    ],
)
def test_a_ray_traced_lens(laikin, model, noise, fitted, held_out) -> None:
    observations, theta, shift = laikin
    result = calibrate(observations("calib", noise), model)
    measured = evaluate_camera(result.camera, observations("heldout", noise), result.board_warp)
    assert not result.rejected  # good points at the rim are not outliers
    assert fitted[0] <= result.rms_px <= fitted[1]
    assert held_out[0] <= measured.rms_px <= held_out[1] and not measured.failed
    if model in ("ep_even", "gennery", "auto"):
        below = theta <= np.radians(88)
        error = np.abs(result.camera.entrance_pupil(theta[below]) - shift[below]).max()
        assert error <= 0.03 * abs(np.interp(np.radians(88), theta, shift))
    if model == "auto":
        assert result.model in ("ep_even", "gennery") and result.entrance_pupil_supported


def test_a_test_of_the_evaluation_itself(laikin) -> None:
    """Held-out figures, recomputed from the poses it found."""
    observations, _, _ = laikin
    camera = calibrate(observations("calib", "clean"), "ep_even").camera
    held_out = observations("heldout", "noisy")
    found = evaluate_camera(camera, held_out)
    points = held_out.object_points[held_out.point_index]
    pose = found.camera_from_target[np.searchsorted(found.images, held_out.image_index)]
    in_camera = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
    error = camera.project(in_camera)[0] - held_out.pixels
    assert np.allclose(error, found.error, atol=1e-9)
    length = np.hypot(*error.T)
    assert found.rms_px == pytest.approx(np.sqrt((length**2).mean()))
    assert (found.median_px, found.p95_px) == pytest.approx((np.median(length), np.quantile(length, 0.95)))
    assert found.points == len(points) and found.images.tolist() == list(range(15))
