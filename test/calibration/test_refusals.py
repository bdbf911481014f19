"""What cannot be calibrated is refused in one line that says why; a poor recording ends in no traceback."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_scenes import BOARD, CAMERA, rows, seen, seen_board

from fisheye_ep_calib.calibration import Observations, calibrate
from fisheye_ep_calib.calibration.assessing.evaluation import evaluate_camera
from fisheye_ep_calib.errors import CalibrationError, InputError
from fisheye_ep_calib.simulation import look_pose

pytestmark = pytest.mark.filterwarnings("error")
MODELS = ["auto", "ep_even"]


@pytest.fixture(scope="module")
def observations() -> Observations:
    return seen_board()


def created(observations: Observations, **change) -> Observations:
    keys = ("object_points", "image_index", "point_index", "pixels", "image_size", "weights")
    return Observations.create(**{**{key: getattr(observations, key) for key in keys}, **change})


def first_changed(array: np.ndarray, value) -> np.ndarray:
    array = array.copy()
    array[0] = value
    return array


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda o: {"point_index": first_changed(o.point_index, o.point_index[1])}, "the same point twice"),
        (lambda o: {"point_index": first_changed(o.point_index, 54)}, r"point_index must lie in 0\.\.53"),
        (lambda o: {"point_index": first_changed(o.point_index, -1)}, r"point_index must lie in 0\.\.53"),
        (lambda o: {"image_index": first_changed(o.image_index, -1)}, "image_index must not be negative"),
        (lambda o: {"image_index": o.image_index + 0.5}, "image_index must hold whole numbers"),
        (lambda o: {"point_index": ["a"] * len(o.point_index)}, "point_index must hold whole numbers"),
        (lambda o: {"image_index": o.image_index + 1_700_000_000}, "number the images from 0"),
        (lambda o: {"image_size": (1600, 1200, 3)}, "image_size must be positive: width and height"),
        (lambda o: {"image_size": (1600.5, 1200)}, "image_size must hold whole numbers"),
        (lambda o: {"pixels": first_changed(o.pixels, np.nan)}, r"observation 0 \(image 0\).*not finite"),
        (lambda o: {"pixels": first_changed(o.pixels, [np.inf, 3])}, "not finite"),
        (
            lambda o: {"pixels": first_changed(o.pixels, [1600.0, 3])},
            r"observation 0 .*outside the 1600×1200 image",
        ),
        (lambda o: {"pixels": first_changed(o.pixels, [5.0, -0.6])}, "outside"),
        (lambda o: {"pixels": o.pixels[:-1]}, "one row an observation"),
        (lambda o: {"object_points": o.object_points[:, :2]}, r"\(n, 3\)"),
        (lambda o: {"object_points": np.full((54, 3), np.nan)}, "finite"),
        (lambda o: {"image_size": (0, 1200)}, "image_size must be positive"),
        (lambda o: {"weights": first_changed(o.weights, -1.0)}, "weights"),
        (lambda o: {"weights": first_changed(o.weights, np.nan)}, "weights"),
        (lambda o: {"weights": o.weights[:-1]}, "weights"),
        (lambda o: {"image_names": ["only one"]}, "image_names is shorter"),
        (lambda o: {"split": ["train"]}, "split"),
        (lambda o: {"disc_radius": -0.001}, "disc_radius"),
        (
            lambda o: dict.fromkeys(("image_index", "point_index"), []) | {"pixels": np.empty((0, 2)), "weights": []},
            "no",
        ),
    ],
)
def test_observations_that_contradict_themselves(observations, change, words) -> None:
    with pytest.raises(InputError, match=words):
        created(observations, **change(observations))


def test_pixels_up_to_the_outer_edge_of_the_border_pixels_are_inside(observations) -> None:
    created(observations, pixels=first_changed(observations.pixels, [-0.5, 1199.5]))


@pytest.mark.parametrize("model", MODELS)
def test_too_few_views(observations, model) -> None:
    with pytest.raises(CalibrationError, match="2 views have .* at least 3 are needed.*record more views"):
        calibrate(observations.select_images([3, 4]), model)
    with pytest.raises(CalibrationError, match="1 view has .* at least 3 are needed"):
        calibrate(observations.select_images([3]), model)
    with pytest.raises(CalibrationError, match="0 views have at least 4 points"):
        calibrate(rows(observations, observations.point_index < 3), model)
    with pytest.raises(CalibrationError, match="0 views"):
        calibrate(replace(observations, weights=np.zeros_like(observations.weights)), model)


@pytest.mark.parametrize("model", MODELS)
def test_all_views_alike(observations, model) -> None:
    rng = np.random.default_rng(1)
    own = observations.image_index == 0
    count = int(own.sum())
    alike = created(
        observations,
        image_index=np.repeat(np.arange(20), count),
        point_index=np.tile(observations.point_index[own], 20),
        pixels=np.tile(observations.pixels[own], (20, 1)) + rng.normal(0, 0.3, (20 * count, 2)),
        weights=None,
    )
    with pytest.raises(CalibrationError, match="all 20 views are alike.*move and tilt the target, near and far"):
        calibrate(alike, model)


@pytest.mark.parametrize("model", [pytest.param("auto", marks=pytest.mark.slow), "ep_even"])
def test_views_that_leave_the_focal_length_open(model) -> None:
    """Boards all square to the axis, rolled about it, or at various depths."""
    rng = np.random.default_rng(2)
    rolled = np.stack([look_pose(BOARD, 0.0, 0.0, 0.2, roll=angle) for angle in np.linspace(0, 3, 6)])
    slid = np.tile(np.eye(4), (6, 1, 1))
    slid[:, :3, 3] = np.column_stack([rng.uniform(-0.2, 0, 6), rng.uniform(-0.1, 0, 6), rng.uniform(0.15, 0.4, 6)])
    for poses in (rolled, slid):
        with pytest.raises(CalibrationError, match="do not determine the focal length.*tilt the target"):
            calibrate(seen(CAMERA, BOARD.object_points, poses), model)


@pytest.mark.parametrize("model", MODELS)
def test_fewer_points_than_parameters(observations, model) -> None:
    corners = np.isin(observations.point_index, [0, 8, 45, 53])
    few = rows(observations, corners & (observations.image_index < 6))
    with pytest.raises(CalibrationError, match=r"points give \d+ equations for \d+ unknowns.*record more views"):
        calibrate(few, model)


@pytest.mark.parametrize("model", MODELS)
def test_a_line_of_points_is_no_view(observations, model) -> None:
    with pytest.raises(CalibrationError, match="0 views"):
        calibrate(rows(observations, observations.point_index < 9), model)
    one = (observations.image_index == 4) & (observations.point_index >= 9)
    result = calibrate(rows(observations, ~one), model)
    assert result.views == 24 and 4 not in result.view_images and result.uncertainty.sigma_px < 0.12


@pytest.mark.parametrize("model", [pytest.param("auto", marks=pytest.mark.slow), "ep_even"])
def test_hopeless_input_is_refused_and_poor_input_survives(observations, model) -> None:
    few = rows(observations.select_images(range(4)), observations.select_images(range(4)).point_index % 3 == 0)
    anywhere = np.random.default_rng(3).uniform(0, 1199, few.pixels.shape)
    for pixels in (anywhere, few.pixels * [1, 0] + [0, 500], np.full_like(anywhere, 600.0)):
        with pytest.raises(CalibrationError):
            calibrate(created(few, pixels=pixels), model)
    corners = np.isin(observations.point_index, [0, 8, 45, 53])
    assert calibrate(rows(observations, corners), model).converged
    assert calibrate(observations.select_images([0, 1, 2]), model).views == 3


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        ("pinhole", {}, "unknown model 'pinhole'; known: kannala"),
        ("ep_odd", {"terms": 5}, "ep_odd takes 1 to 4 terms, not 5"),
        ("gennery", {"terms": 0}, "gennery takes 1 to 3 terms"),
        (
            "ep_odd",
            {"lens": "pinhole"},
            "unknown lens 'pinhole'; known: kannala_brandt, kannala_brandt_6, double_sphere",
        ),
    ],
)
def test_unknown_wishes(observations, model, options, words) -> None:
    with pytest.raises(InputError, match=words):
        calibrate(observations, model, **options)


def test_a_bow_is_not_asked_of_a_solid() -> None:
    solid = np.random.default_rng(4).uniform(-0.05, 0.05, (40, 3))
    poses = np.stack([look_pose(BOARD, 0.3 * i, i, 0.25, tilt=0.3) for i in range(5)])
    with pytest.raises(CalibrationError, match="needs a flat target"):
        calibrate(seen(CAMERA, solid, poses), "ep_even", board_warp=True)


def test_evaluation_refuses_another_image_size_and_names_views_without_a_pose(observations) -> None:
    with pytest.raises(InputError, match="1600×1200 pixels, the observations 1600×1201"):
        evaluate_camera(CAMERA, created(observations, image_size=(1600, 1201)))
    pixels, own = observations.pixels.copy(), np.flatnonzero(observations.image_index == 5)
    pixels[own] = np.random.default_rng(5).uniform(0, 1199, (len(own), 2))
    three = (observations.image_index == 7) & (observations.point_index > 2)
    found = evaluate_camera(CAMERA, rows(replace(observations, pixels=pixels), ~three))
    assert found.failed.keys() == {5, 7} and "points" in found.failed[7] and "no pose" in found.failed[5]
    assert len(found.images) == 23 and found.rms_px == pytest.approx(0.136, abs=0.006)
    with pytest.raises(CalibrationError, match="no view fits the camera"):
        evaluate_camera(CAMERA, replace(observations, pixels=np.random.default_rng(6).uniform(0, 1199, pixels.shape)))


def test_a_fit_that_did_not_converge_says_so(observations, monkeypatch) -> None:
    from fisheye_ep_calib.calibration.estimating import fit as fits

    full = fits.adjust
    monkeypatch.setattr(fits, "adjust", lambda *given, **options: full(*given, **{**options, "max_iterations": 1}))
    assert not calibrate(observations, "ep_even").converged


@pytest.mark.parametrize(
    ("model", "options", "words"),
    [
        ("ep_even_target_axis", {}, "unknown model 'ep_even_target_axis'"),
        ("ep_even", {"loss": "Huber"}, "unknown loss 'Huber'; known: cut, huber"),
        ("ep_even", {"disc_centers": "centre"}, "unknown disc_centers 'centre'"),
        ("ep_even", {"svp_distance": -1.0}, "`svp_distance` must be positive, not -1 m"),
        ("ep_even", {"svp_distance": np.nan}, "must be positive"),
        ("ep_even", {"terms": 9}, "takes 1 to 4 terms"),
    ],
)
def test_options_that_mean_nothing(observations, model, options, words) -> None:
    with pytest.raises(InputError, match=words):
        calibrate(observations, model, **options)


def test_a_stand_in_nearer_than_the_pupil_moves_is_refused(observations) -> None:
    with pytest.raises(CalibrationError, match="choose a larger `svp_distance`"):
        calibrate(observations, "ep_even", svp_distance=1e-6)


def test_a_view_of_one_line_says_so(observations) -> None:
    line = (observations.image_index != 7) | (observations.point_index < 9)
    found = evaluate_camera(CAMERA, rows(observations, line))
    assert found.failed == {7: "its points lie on one line"}


@pytest.mark.parametrize("axes", [(0, 1), (1,), (0,)])
def test_pixels_on_one_line_or_place_are_no_view(observations, axes) -> None:
    """A camera that sees the target edge-on, or a file that says so: the pose is not determined."""
    pixels = observations.pixels.copy()
    flat = np.flatnonzero(observations.image_index == 7)
    pixels[np.ix_(flat, axes)] = 300.0
    found = evaluate_camera(CAMERA, replace(observations, pixels=pixels))
    assert found.failed == {7: "its points lie on one line"}
    pixels[:, axes] = 300.0
    with pytest.raises(CalibrationError, match="0 views have at least 4 points, not on one line|views are alike"):
        calibrate(replace(observations, pixels=pixels))


def test_points_that_no_camera_explains(observations) -> None:
    anywhere = np.random.default_rng(3).uniform(0, 1199, observations.pixels.shape)
    with pytest.raises(CalibrationError, match="check that the target file describes the board|remain"):
        calibrate(replace(observations, pixels=anywhere), "ep_even")
