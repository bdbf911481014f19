"""The camera file: one YAML with two readers.

Its top level is what camera_info_manager reads; the block ``entrance_pupil`` carries the full camera, its covariance
and what is known about the calibration. ``docs/model.md`` names every field.
"""

from __future__ import annotations

import datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from fisheye_ep_calib.camera import KNOWN_EXTRAS, LENS_EXTRAS, FisheyeCamera
from fisheye_ep_calib.camera.camera_info import camera_info_content, plain_camera_info
from fisheye_ep_calib.camera.left_open import PupilLeftOpen
from fisheye_ep_calib.camera.limits import refuse_absurd
from fisheye_ep_calib.camera.parameters import PIXEL_NAMES
from fisheye_ep_calib.errors import CalibrationError, InputError, first_line
from fisheye_ep_calib.formats import Format
from fisheye_ep_calib.formats.mrcal import without_inputs
from fisheye_ep_calib.formats.placed_camera import floats
from fisheye_ep_calib.formats.reading import origin, read_foreign, recognised, stand_in_of
from fisheye_ep_calib.outside import checked_path, read_text_outside
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.storage.camera_file_parsing import LONGEST_TEXT, SCHEMA, CameraFile, parse_camera_file
from fisheye_ep_calib.target.shape.content import board_content
from fisheye_ep_calib.version import __version__
from fisheye_ep_calib.yaml_file import MOST_BYTES, parse_yaml

if TYPE_CHECKING:  # the command show is to answer without what calibrates
    from fisheye_ep_calib.calibration.result import CalibrationResult

_MOST_WITH_INPUTS = 1 << 26  # bytes; a thousand views of a thousand corners are a third of it


def save_camera(
    path: str | PathLike[str], camera: CalibrationResult | FisheyeCamera, name: str | None = None, source: str = ""
) -> None:
    """Write a camera file, whole or not at all.

    Args:
        path: The YAML file.
        camera: A calibration, or a camera alone.
        name: The camera's; by default the one that it has, or the file's.
        source: What it was calibrated from.

    Raises:
        CalibrationError: The file cannot be written.
        InputError: ``path`` is no path, or ``camera`` no camera.
    """
    place = checked_path(path, "path")
    if not place.name:
        raise InputError("`path` must be the path of a file")
    if not isinstance(camera, FisheyeCamera) and not hasattr(camera, "camera"):
        raise InputError(f"`camera` must be a camera or a calibration, not {shown(camera)}")
    own = name or getattr(camera, "name", None) or place.stem
    atomic_write(path, camera_yaml(camera, own, source).encode())


def camera_yaml(camera: CalibrationResult | FisheyeCamera, name: str, source: str = "") -> str:
    """The camera file as text. source: what the camera was calibrated from. Of a camera alone nothing else is known."""
    if isinstance(camera, FisheyeCamera):
        from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint

        stand_in, content = single_viewpoint(camera), _full_camera(camera) | _left_open(camera.pupil_left_open)
    else:
        stand_in, content = camera.stand_in, _calibrated(camera, source)
    content["svp"] = {
        "distance": float(stand_in.distance),
        "loss_px": {float(key): round(value, 6) for key, value in stand_in.loss_px.items()},
    }
    plain = camera_info_content(plain_camera_info(stand_in.camera), name)
    text: str = yaml.dump(
        {**plain, "entrance_pupil": content},
        Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper),  # libyaml's, where there is one: a camera file is long
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
        width=1 << 16,
    )
    return text


def _full_camera(camera: FisheyeCamera) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "model": camera.model,
        "lens": camera.lens,
        "intrinsics": {key: float(getattr(camera, key)) for key in PIXEL_NAMES},
        "radial": floats(camera.radial),
        **{
            extra: floats(camera.extras.get(extra, (0.0,) * len(family.coefficient_names)))
            for extra, family in KNOWN_EXTRAS.items()
            if extra in LENS_EXTRAS or extra in camera.extras
        },
        "coefficients": floats(camera.coefficients),
        "theta_max": float(camera.theta_max),
        "parameters": list(camera.parameter_names),
    }


def _calibrated(result: CalibrationResult, source: str) -> dict[str, Any]:
    if result.fit.structure.target_axis:
        raise CalibrationError(f"{result.model} is no camera and cannot be saved; take ep_odd")
    from fisheye_ep_calib.calibration.content import FACTS, calibration_content

    return {
        **_full_camera(result.camera),
        "covariance": [floats(row) for row in result.uncertainty.covariance],
        **_left_open(None if result.left_open is None else result.left_open.pupil),
        "projection_uncertainty": _projection_uncertainty(result),
        "calibration": {
            **{name: value for name, value in calibration_content(result, FACTS).items() if value is not None},
            "board_warp": floats(result.board_warp),
            "board": _board_content(result),
            "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
            "source": one_line(source),
            "software": f"fisheye_ep_calib {__version__}",
        },
    }


def _board_content(result: CalibrationResult) -> dict[str, Any]:
    """The target's geometry and its shape as it was measured."""
    radius = result.fit.sightings.observations.disc_radius
    return {**board_content(result.board), **({} if radius is None else {"disc_radius": float(radius)})}


def _left_open(pupil: PupilLeftOpen | None) -> dict[str, Any]:
    """What the data leave open of a pupil, where the model has none."""
    if pupil is None:
        return {}
    return {
        "pupil_left_open": {
            "model": pupil.model,
            "coefficients": list(pupil.coefficients),
            "covariance": [list(row) for row in pupil.covariance],
        }
    }


def _projection_uncertainty(result: CalibrationResult) -> dict[str, Any]:
    """1σ in px per axis, a row an angle and a column a distance."""
    table = result.projection_table
    return {
        "theta_deg": floats(table.theta_deg),
        "distance_m": floats(table.distance_m),
        "sigma_px": [[round(value, 6) for value in floats(row)] for row in table.sigma_px],
    }


def load_camera(path: str | PathLike[str]) -> FisheyeCamera:
    """The full camera of a camera file, or of a file of another calibrator.

    Args:
        path: Of a file with several cameras the one named behind a colon, as in "camchain.yaml:cam1".

    Returns:
        The camera.

    Raises:
        InputError: The file, or a key of it that is named, cannot be used.
    """
    return read_camera_file(path).camera


def read_camera_file(path: str | PathLike[str]) -> CameraFile:
    """Everything that a camera file says.

    Files of other programs are read too (``formats``); of one with several cameras the one named behind a colon, as in
    "camchain.yaml:cam1". Raises InputError with the file's name and what is wrong with it.
    """
    path, chosen = _camera_in_file(checked_path(path, "path"))
    text = camera_text(path)
    try:
        foreign = recognised(text)
        if foreign is None and chosen:
            raise InputError("it holds one camera: no name belongs behind its own")
        file = parse_camera_file(parse_yaml(text, "it")) if foreign is None else _foreign_file(text, foreign, chosen)
        for camera in (file.camera, file.stand_in):
            refuse_absurd(camera)
        return file
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else first_line(error)
        raise InputError(f"{path} is not a camera file: {what}") from None


def camera_text(path: Path) -> str:
    """The text of a camera file; of one of mrcal's without the many megabytes that it was calibrated from.

    Raises InputError.
    """
    text = read_text_outside(path, _MOST_WITH_INPUTS, "camera")
    if len(text) > MOST_BYTES:
        text = without_inputs(text)
    if len(text) > MOST_BYTES:
        raise InputError(f"{one_line(path)}: too large for a camera file, at most {MOST_BYTES} bytes")
    return text


def _camera_in_file(path: Path) -> tuple[Path, str]:
    """ "camchain.yaml:cam1" as the file and the camera's name in it."""
    name, colon, camera = path.name.rpartition(":")
    if not colon or path.exists():
        return path, ""
    return path.with_name(name), camera


def _foreign_file(text: str, foreign: Format, chosen: str) -> CameraFile:
    """A camera of another program: nothing is known of its uncertainty."""
    foreign_camera = read_foreign(text, foreign, chosen)
    unknown = np.zeros((len(foreign_camera.camera.parameters),) * 2)
    told = (
        ""
        if foreign.name == "camera_info" and foreign_camera.model == "equidistant"
        else origin(foreign_camera, foreign)
    )
    return CameraFile(
        one_line(foreign_camera.name, LONGEST_TEXT),
        foreign_camera.camera,
        stand_in_of(foreign_camera.camera),
        unknown,
        origin=told,
    )
