"""The single-viewpoint camera for CameraInfo: as near as such a camera can come, and honest about the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA, seen

from fisheye_ep_calib.calibration import calibrate
from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.simulation import paper_camera, random_poses

pytestmark = pytest.mark.filterwarnings("error")


def rms_over_image(full: FisheyeCamera, single: FisheyeCamera, distance: float) -> float:
    """RMS pixel difference for points seen over the image at a distance from the frame's origin; far is 10 km."""
    distance = min(distance, 1e4)
    u, v = np.meshgrid(np.linspace(0, full.image_size[0] - 1, 41), np.linspace(0, full.image_size[1] - 1, 41))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    origins, directions, valid = full.unproject(pixels)
    middle = (origins * directions).sum(axis=-1, keepdims=True)
    reach = np.sqrt(middle**2 - (origins**2).sum(axis=-1, keepdims=True) + distance**2)
    points = origins + (reach - middle) * directions
    assert np.allclose(np.linalg.norm(points, axis=-1), distance)
    error = single.project(points[valid])[0] - pixels[valid]
    return float(np.sqrt((error**2).sum(axis=-1).mean()))


@pytest.mark.parametrize("distance", [np.inf, 1.0, 0.2])
@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        replace(paper_camera(), theta_max=np.radians(85)),
        replace(CAMERA, lens="double_sphere", radial=(-0.2, 0.6)),
    ],
    ids=["even pupil", "the paper's", "double sphere"],
)
def test_no_other_camera_of_its_kind_comes_nearer(camera, distance) -> None:
    found = single_viewpoint(camera, distance)
    single = found.camera
    assert (single.model, single.lens, single.skew) == (
        "kannala",
        "kannala_brandt",
        0.0,
    ) and not single.extras
    best = rms_over_image(camera, single, distance)
    rng = np.random.default_rng(1)
    for scale in (1e-3, 1e-2):
        for _ in range(20):
            step = rng.normal(0, scale, 9) * [1, 1, 0, 1, 1, 1e-2, 1e-2, 1e-2, 1e-2] * 10
            assert rms_over_image(camera, single.with_parameters(single.parameters + step), distance) > 0.999 * best
    for away, loss in found.loss_px.items():
        assert loss == pytest.approx(rms_over_image(camera, single, away), rel=0.15, abs=1e-3)
    assert found.distance == distance


def test_a_single_viewpoint_camera_is_its_own_stand_in() -> None:
    central = replace(CAMERA, model="kannala", coefficients=(), skew=0.0)
    found = single_viewpoint(central)
    assert found.camera.parameters == pytest.approx(central.parameters, abs=1e-6)
    assert max(found.loss_px.values()) < 1e-6


def test_the_loss_grows_toward_the_lens_and_the_fit_moves_it() -> None:
    far, near = single_viewpoint(CAMERA).loss_px, single_viewpoint(CAMERA, 0.1).loss_px
    assert list(far) == [0.1, 0.3, 1.0, 10.0]
    assert far[0.1] > 2 * far[0.3] > 4 * far[1.0] > far[10.0]
    assert near[0.1] < 0.5 * far[0.1] and near[10.0] > 5 * far[10.0]


def test_distortion_is_never_all_zero() -> None:
    """Consumers take D = 0 for a pinhole."""
    plain = FisheyeCamera((1000, 1000), 400.0, 400.0, 500.0, 500.0)
    assert any(single_viewpoint(plain).camera.radial)


@pytest.mark.parametrize("farthest", [0.8, 2.0, 4.0])
@pytest.mark.parametrize("model", ["kannala", "ep_even"])
def test_a_board_seen_only_near_the_middle(farthest, model) -> None:
    poses = random_poses(BOARD, 20, 3, (0.6 * farthest, farthest), (0.0, 2.0), (5.0, 50.0))
    result = calibrate(seen(CAMERA, BOARD.object_points, poses, noise=0.05), model)
    assert np.degrees(result.camera.theta_max) < 14
    assert all(np.isfinite(loss) for loss in result.stand_in.loss_px.values())
    assert not result.entrance_pupil_supported
