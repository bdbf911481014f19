"""Every pupil family, lens and extra in a camera, through `calibrate`, the camera file and `show`: without a line of
their own anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from known_cameras import KINDS, effect_of_coefficients, random_camera
from known_scenes import CAMERA, seen_board

from fisheye_ep_calib import Observations, calibrate, load_camera, save_camera
from fisheye_ep_calib.camera import LENS_EXTRAS, LENSES, PUPIL_FAMILIES, FisheyeCamera
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.storage.camera_file import read_camera_file
from fisheye_ep_calib.storage.observation_file import save_observations

NOISE = 0.02  # px a coordinate
PLAIN_LENS = next(iter(LENSES))


def camera_of(model: str = "kannala", lens: str = PLAIN_LENS, extra: str | None = None) -> FisheyeCamera:
    """E(90°) = −1.2 mm where the family has one, in equal shares; a lens and an extra a little off their start.

    An extra's coefficients together move points near the rim by about a thousandth of the focal length, whatever they
    are counted in.
    """
    family, terms = PUPIL_FAMILIES[model], PUPIL_FAMILIES[model].default_terms
    shift = -1.2e-3 / max(terms, 1) / family.basis(np.array(np.pi / 2), terms)
    start = np.array(LENSES[lens].start_coefficients, dtype=float)
    radial = start + 0.01 / effect_of_coefficients(lens, start)
    extras = {}
    if extra:
        count = len(LENS_EXTRAS[extra].coefficient_names)
        _, by_coefficient = LENS_EXTRAS[extra].jacobian(np.array(1.5), np.array(0.5), np.zeros(count))
        amounts = np.resize((0.002, -0.003, 0.001, 0.0005), count) / count
        extras = {extra: tuple((amounts / np.hypot(*by_coefficient)).tolist())}
    return replace(
        CAMERA, model=model, lens=lens, extras=extras, radial=tuple(radial), coefficients=tuple(shift.tolist())
    )


@lru_cache
def views_of(model: str = "kannala", lens: str = PLAIN_LENS, extra: str | None = None) -> Observations:
    return seen_board(camera_of(model, lens, extra), 25, NOISE)


@dataclass(frozen=True)
class Made:
    """What `calibrate --json` said, and what its camera file holds."""

    said: dict
    path: Path
    camera: FisheyeCamera
    covariance: np.ndarray


def made(command, observations: Observations, *options: str) -> Made:
    save_observations("front.npz", observations)
    ended = command("calibrate", "front.npz", "--output", "out", "--json", *options)
    assert ended.code == 0, ended.err
    said = ended.json["cameras"]["front"]
    path = Path(said["yaml"])
    file = read_camera_file(path)
    return Made(said, path, file.camera, file.covariance)


def check_against_truth(found: Made, shown: dict, truth: FisheyeCamera) -> None:
    """E(θ), r(θ) and every parameter within 5 σ of the true ones, with σ small enough to say something."""
    assert found.said["converged"] and not found.said["rejected_points"]
    assert found.said["rms_px"] == pytest.approx(NOISE * np.sqrt(2), rel=0.1)
    theta = np.radians(shown["theta_deg"])
    inner = theta < np.radians(80)
    for values, sigma, true, allowed in (
        ("E_m", "E_sigma_m", truth.entrance_pupil(theta), 0.1e-3),
        ("r_px", "r_sigma_px", truth.fx * truth.radius(theta), 0.5),
    ):
        error, sigma = np.abs(np.array(shown[values]) - true), np.array(shown[sigma])
        assert (error <= 5 * sigma + 1e-12)[inner].all(), f"{values} is not the true one"
        assert sigma[inner].max() < allowed
    sigma = np.sqrt(np.diag(found.covariance))
    assert found.camera.parameter_names == truth.parameter_names
    deviation = np.abs(found.camera.parameters - truth.parameters)
    assert (deviation <= 5 * sigma).all(), dict(zip(truth.parameter_names, deviation / sigma, strict=True))


def check_shown(command, found: Made) -> dict:
    """What `show` prints is what the file holds; returns its JSON."""
    ended = command("show", found.path, "--json")
    assert ended.code == 0, ended.err
    shown, camera = ended.json, found.camera
    assert (shown["model"], shown["lens"]) == (camera.model, camera.lens)
    assert shown["parameters"] == list(camera.parameter_names)
    theta = np.radians(shown["theta_deg"])
    np.testing.assert_allclose(shown["r_px"], camera.fx * camera.radius(theta), rtol=1e-12)
    if camera.coefficients:
        np.testing.assert_allclose(shown["E_m"], camera.entrance_pupil(theta), rtol=1e-12)
    for name, values in camera.extras.items():
        assert shown[name] == list(values)
    told = command("show", found.path)
    assert told.code == 0 and camera.model in told.out and camera.lens in told.out
    assert all(f"  {name} " in told.out for name in camera.parameter_names)
    return shown


def test_a_pupil_family_is_calibrated_written_and_shown(command, pupil_name) -> None:
    found = made(command, views_of(pupil_name), "--model", pupil_name, "--no-report")
    assert found.said["model"] == found.camera.model == pupil_name
    assert found.said["entrance_pupil_supported"] == bool(PUPIL_FAMILIES[pupil_name].max_terms)
    check_against_truth(found, check_shown(command, found), camera_of(pupil_name))


def test_a_lens_is_calibrated_written_and_shown(command, lens_name) -> None:
    found = made(command, views_of(lens=lens_name), "--model", "kannala", "--lens", lens_name, "--no-report")
    assert found.camera.lens == lens_name
    check_against_truth(found, check_shown(command, found), camera_of(lens=lens_name))


def test_an_extra_is_calibrated_written_and_shown(command, extra_name) -> None:
    switch = f"--{extra_name.replace('_', '-')}"
    found = made(command, views_of(extra=extra_name), "--model", "kannala", switch, "--no-report")
    assert list(found.camera.extras) == [extra_name]
    check_against_truth(found, check_shown(command, found), camera_of(extra=extra_name))
    result = calibrate(views_of(extra=extra_name), model="kannala", **{extra_name: False})
    assert extra_name not in result.camera.extras


@pytest.mark.slow
def test_a_pupil_family_is_in_the_report(command, pupil_name) -> None:
    made(command, views_of(pupil_name))
    page = Path("out/report.html").read_text()
    assert f">{pupil_name}<" in page


@lru_cache
def compared() -> tuple[str, ...]:
    return tuple(calibrate(views_of("kannala")).comparison)


def test_auto_compares_every_pupil_family(pupil_name) -> None:
    assert pupil_name in compared()


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_parameters_have_names_of_their_own_and_go_out_and_in(kind) -> None:
    model, lens, extras = kind
    camera = random_camera(np.random.default_rng(1), model, lens, extras)
    names = camera.parameter_names
    assert len(set(names)) == len(names) == len(camera.parameters)
    assert names[:5] == ("fx", "fy", "skew", "cx", "cy")
    assert camera.with_parameters(camera.parameters) == camera
    marked = np.arange(1.0, len(names) + 1) / 100
    moved, value = camera.with_parameters(marked), dict(zip(names, marked, strict=True))
    assert [getattr(moved, name) for name in names[:5]] == [value[name] for name in names[:5]]
    assert moved.radial == tuple(value[name] for name in LENSES[lens].coefficient_names)
    assert moved.extras == {name: tuple(value[one] for one in LENS_EXTRAS[name].coefficient_names) for name in extras}
    assert moved.coefficients == tuple(value[f"e{i + 1}"] for i in range(len(camera.coefficients)))
    assert (moved.model, moved.lens, moved.image_size) == (model, lens, camera.image_size)


def test_every_number_of_a_camera_comes_back_from_its_file(tmp_path, pupil_name) -> None:
    """With every lens and all extras at once, as given and as calibrated.

    The views are of a lens with a field: a calibration leaves one out where there is nothing of it.
    """
    extras = {name: 0.5 * (1 + np.arange(len(each.coefficient_names))) / 1e3 for name, each in LENS_EXTRAS.items()}
    for lens in LENSES:
        camera = replace(
            camera_of(pupil_name, lens), extras={name: tuple(one.tolist()) for name, one in extras.items()}
        )
        save_camera(tmp_path / "front.yaml", camera, "front")
        assert load_camera(tmp_path / "front.yaml") == camera
    views = views_of(pupil_name, extra=LENS_FIELD.name)
    result = calibrate(views, model=pupil_name, **dict.fromkeys(LENS_EXTRAS, True))
    save_camera(tmp_path / "front.yaml", result.camera, "front")
    assert load_camera(tmp_path / "front.yaml") == result.camera
    assert set(result.camera.extras) == set(LENS_EXTRAS)
