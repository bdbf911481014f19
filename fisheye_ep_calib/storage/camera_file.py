"""The camera file: one YAML with two readers.

Its top level is what camera_info_manager reads; the block ``entrance_pupil`` carries the full camera, its covariance
and what is known about the calibration. ``docs/model.md`` names every field.
"""

from __future__ import annotations

import datetime
import operator
from collections.abc import Iterable
from dataclasses import dataclass, field
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
from fisheye_ep_calib.formats.reading import origin, read_foreign, recognised, stand_in_of
from fisheye_ep_calib.outside import read_text_outside
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.content import board_content, parse_board
from fisheye_ep_calib.target.shape.measured import BoardShape
from fisheye_ep_calib.version import __version__
from fisheye_ep_calib.yaml_file import MOST_BYTES, parse_yaml

if TYPE_CHECKING:  # the command show is to answer without what calibrates
    from fisheye_ep_calib.calibration.result import CalibrationResult

SCHEMA = 1
_LARGEST_VARIANCE = 1e20
_LONGEST_TEXT = 200


@dataclass(frozen=True)
class CameraFile:
    """What a camera file says. covariance (P, P): of camera.parameters, zero where unknown or fixed.

    stand_in: the camera of the top level. stand_in_distance: metres. stand_in_loss_px: by distance in metres.
    board_warp (3,): metres. board: the shape of the target that the camera was calibrated with. calibration: the other
    facts about how it was made.
    projection_uncertainty: theta_deg, distance_m and the rows sigma_px; empty where unknown.
    origin: of a camera of another program, which and what kind.
    """

    name: str
    camera: FisheyeCamera
    stand_in: FisheyeCamera
    covariance: np.ndarray
    stand_in_distance: float = np.inf
    stand_in_loss_px: dict[float, float] = field(default_factory=dict)
    board_warp: np.ndarray = field(default_factory=lambda: np.zeros(len(WARP_NAMES)))
    calibration: dict[str, Any] = field(default_factory=dict[str, Any])
    projection_uncertainty: dict[str, Any] = field(default_factory=dict[str, Any])
    board: BoardShape | None = None
    origin: str = ""


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
    """
    own = name or getattr(camera, "name", None) or Path(path).stem
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
    return yaml.safe_dump(
        {**plain, "entrance_pupil": content},
        sort_keys=False,
        default_flow_style=None,
        allow_unicode=True,
        width=1 << 16,
    )


def _full_camera(camera: FisheyeCamera) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "model": camera.model,
        "lens": camera.lens,
        "intrinsics": {key: float(getattr(camera, key)) for key in PIXEL_NAMES},
        "radial": _floats(camera.radial),
        **{
            extra: _floats(camera.extras.get(extra, (0.0,) * len(family.coefficient_names)))
            for extra, family in KNOWN_EXTRAS.items()
            if extra in LENS_EXTRAS or extra in camera.extras
        },
        "coefficients": _floats(camera.coefficients),
        "theta_max": float(camera.theta_max),
        "parameters": list(camera.parameter_names),
    }


def _calibrated(result: CalibrationResult, source: str) -> dict[str, Any]:
    if result.fit.structure.target_axis:
        raise CalibrationError(f"{result.model} is no camera and cannot be saved; take ep_odd")
    from fisheye_ep_calib.calibration.content import FACTS, calibration_content

    return {
        **_full_camera(result.camera),
        "covariance": [_floats(row) for row in result.uncertainty.covariance],
        **_left_open(None if result.left_open is None else result.left_open.pupil),
        "projection_uncertainty": _projection_uncertainty(result),
        "calibration": {
            **{name: value for name, value in calibration_content(result, FACTS).items() if value is not None},
            "board_warp": _floats(result.board_warp),
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


def _read_left_open(block: dict[str, Any]) -> PupilLeftOpen | None:
    content = block.get("pupil_left_open")
    if content is None:
        return None
    covariance = [_floats(row) for row in content["covariance"]]
    return PupilLeftOpen.of(_text(content, "model"), _floats(content["coefficients"]), covariance)


def _projection_uncertainty(result: CalibrationResult) -> dict[str, Any]:
    """1σ in px per axis, a row an angle and a column a distance."""
    table = result.projection_table
    return {
        "theta_deg": _floats(table.theta_deg),
        "distance_m": _floats(table.distance_m),
        "sigma_px": [[round(value, 6) for value in _floats(row)] for row in table.sigma_px],
    }


def _floats(values: Iterable[Any]) -> list[float]:
    return [float(value) for value in values]


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
    path, chosen = _camera_in_file(Path(path))
    text = read_text_outside(path, MOST_BYTES, "camera")
    try:
        foreign = recognised(text)
        if foreign is None and chosen:
            raise InputError("it holds one camera: no name belongs behind its own")
        file = _camera_file(parse_yaml(text, "it")) if foreign is None else _foreign_file(text, foreign, chosen)
        for camera in (file.camera, file.stand_in):
            refuse_absurd(camera)
        return file
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else first_line(error)
        raise InputError(f"{path} is not a camera file: {what}") from None


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
        one_line(foreign_camera.name, _LONGEST_TEXT),
        foreign_camera.camera,
        stand_in_of(foreign_camera.camera),
        unknown,
        origin=told,
    )


def _camera_file(content: dict[str, Any]) -> CameraFile:
    if not isinstance(content, dict):
        raise InputError("a camera file is a mapping")
    stand_in = _stand_in(content)
    name = _text(content, "camera_name", "camera")
    block = content["entrance_pupil"]
    if block["schema"] != SCHEMA:
        raise InputError(f"schema {shown(block['schema'])} of entrance_pupil is not known here; known: {SCHEMA}")
    intrinsics = block["intrinsics"]
    extras = {extra: tuple(_floats(block[extra])) for extra in KNOWN_EXTRAS if extra in block}
    parameters = block.get("parameters", ())
    camera = FisheyeCamera(
        stand_in.image_size,
        float(intrinsics["fx"]),
        float(intrinsics["fy"]),
        float(intrinsics["cx"]),
        float(intrinsics["cy"]),
        float(intrinsics["skew"]),
        tuple(_floats(block["radial"])),
        _text(block, "model"),
        tuple(_floats(block["coefficients"])),
        {
            extra: values
            for extra, values in extras.items()
            if any(values) or set(KNOWN_EXTRAS[extra].coefficient_names) & set(parameters)
        },
        _text(block, "lens", "kannala_brandt"),
        float(block.get("theta_max", np.pi)),
        _read_left_open(block),
    )
    svp = block.get("svp", {})
    facts = _facts(block)
    calibration = {one_line(key, _LONGEST_TEXT): _fact(key, value) for key, value in facts.items() if key != "board"}
    return CameraFile(
        name,
        camera,
        stand_in,
        _covariance(block, camera),
        _stand_in_distance(svp.get("distance", np.inf)),
        {float(key): float(value) for key, value in svp.get("loss_px", {}).items()},
        _board_warp(calibration.get("board_warp", ())),
        calibration,
        _checked_table(block.get("projection_uncertainty", {})),
        None if facts.get("board") is None else parse_board(facts["board"]),
    )


def _stand_in(content: dict[str, Any]) -> FisheyeCamera:
    """The single-viewpoint camera of the top level."""
    if content["distortion_model"] != "equidistant":
        raise InputError(f"distortion_model {shown(content['distortion_model'])} is not equidistant")
    matrix = np.array(_floats(content["camera_matrix"]["data"])).reshape(3, 3)
    size = operator.index(content["image_width"]), operator.index(content["image_height"])
    if not (0 < size[0] <= 1 << 16 and 0 < size[1] <= 1 << 16):
        raise InputError(f"an image of {size[0]}×{size[1]} pixels is not possible")
    distortion = tuple(_floats(content["distortion_coefficients"]["data"]))
    if len(distortion) != 4:
        raise InputError(f"equidistant takes 4 distortion coefficients, not {len(distortion)}")
    return FisheyeCamera(
        size, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], skew=matrix[0, 1], radial=distortion
    )


def _text(block: dict[str, Any], key: str, default: str | None = None) -> str:
    value = block[key] if default is None else block.get(key, default)
    if not isinstance(value, str | int | float):
        raise InputError(f"{key} must be text")
    return one_line(value, _LONGEST_TEXT)


def _facts(block: dict[str, Any]) -> dict[str, Any]:
    facts = block.get("calibration") or {}
    if not isinstance(facts, dict):
        raise InputError("calibration must be a list of keys and values")
    return facts


def _fact(name: object, value: Any) -> Any:
    """A number, a line of text, a list of them or, within the facts, numbers by name: what a program can print."""
    if isinstance(value, list) and not any(isinstance(element, list | dict) for element in value):
        return [_fact(name, element) for element in value]
    numbers = isinstance(value, dict) and all(isinstance(number, int | float) for number in value.values())
    if numbers and name == "error_budget":
        return {one_line(key, _LONGEST_TEXT): float(number) for key, number in value.items()}
    if isinstance(value, str):
        return one_line(value)
    if value is not None and not isinstance(value, int | float):
        raise InputError(f"calibration: {one_line(name, 60)} must be a number, a text or a list of them")
    return value


def _stand_in_distance(value: Any) -> float:
    distance = float(value)
    if not distance > 0:
        raise InputError(f"svp: distance must be positive, not {distance}")
    return distance


def _checked_table(block: dict[str, Any]) -> dict[str, Any]:
    if not block:
        return {}
    table = {key: np.array(block[key], dtype=float) for key in ("theta_deg", "distance_m", "sigma_px")}
    if table["sigma_px"].shape != (len(table["theta_deg"]), len(table["distance_m"])):
        raise InputError("projection_uncertainty has a row an angle and a column a distance")
    return {key: value.tolist() for key, value in table.items()}


def _covariance(block: dict[str, Any], camera: FisheyeCamera) -> np.ndarray:
    count = len(camera.parameters)
    if "covariance" not in block:
        return np.zeros((count, count))
    covariance = np.array(block["covariance"], dtype=float)
    if tuple(block["parameters"]) != camera.parameter_names or covariance.shape != (count, count):
        raise InputError("parameters and covariance do not fit the camera")
    if not (np.abs(covariance) <= _LARGEST_VARIANCE).all():
        raise InputError(f"covariance must be finite, and at most {_LARGEST_VARIANCE:g}")
    return covariance


def _board_warp(values: Iterable[Any]) -> np.ndarray:
    """Shorter lists are filled with zeros: the twist came last."""
    floats = _floats(values)
    if len(floats) > len(WARP_NAMES) or not np.isfinite(floats).all():
        raise InputError(f"board_warp holds up to {len(WARP_NAMES)} finite numbers")
    return np.array(floats + [0.0] * (len(WARP_NAMES) - len(floats)))
