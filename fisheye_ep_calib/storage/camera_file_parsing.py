"""What a camera file says, read from its YAML and checked: nothing that is not a camera passes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import KNOWN_EXTRAS, FisheyeCamera
from fisheye_ep_calib.camera.left_open import PupilLeftOpen
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.file_values import mapping, matrix, needed, number, numbers
from fisheye_ep_calib.plain_text import one_line, shown
from fisheye_ep_calib.target.shape.bow import WARP_NAMES
from fisheye_ep_calib.target.shape.content import parse_board
from fisheye_ep_calib.target.shape.measured import BoardShape

SCHEMA = 1
LONGEST_TEXT = 200
_LARGEST_VARIANCE = 1e20
_LARGEST_WARP = 1e4  # metres, as of a target's points


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


def parse_camera_file(content: dict[str, Any]) -> CameraFile:
    """Raises InputError where the content is none of a camera file."""
    mapping(content, "a camera file")
    stand_in = _stand_in(content)
    name = _text(content, "camera_name", "camera")
    block = mapping(needed(content, "entrance_pupil"), "entrance_pupil")
    if needed(block, "schema") != SCHEMA:
        raise InputError(f"schema {shown(block['schema'])} of entrance_pupil is not known here; known: {SCHEMA}")
    grid = mapping(needed(block, "intrinsics"), "intrinsics")
    fx, fy, cx, cy, skew = (number(needed(grid, key), f"intrinsics: {key}") for key in ("fx", "fy", "cx", "cy", "skew"))
    extras = {extra: tuple(numbers(block[extra], extra)) for extra in KNOWN_EXTRAS if extra in block}
    parameters = _names(block.get("parameters", []))
    camera = FisheyeCamera(
        stand_in.image_size,
        fx,
        fy,
        cx,
        cy,
        skew,
        tuple(numbers(needed(block, "radial"), "radial")),
        _text(block, "model"),
        tuple(numbers(needed(block, "coefficients"), "coefficients")),
        {
            extra: values
            for extra, values in extras.items()
            if any(values) or set(KNOWN_EXTRAS[extra].coefficient_names) & set(parameters)
        },
        _text(block, "lens", "kannala_brandt"),
        number(block.get("theta_max", np.pi), "theta_max"),
        _read_left_open(block),
    )
    svp = mapping(block.get("svp", {}), "svp")
    loss = mapping(svp.get("loss_px", {}), "svp: loss_px")
    facts = _facts(block)
    calibration = {one_line(key, LONGEST_TEXT): _fact(key, value) for key, value in facts.items() if key != "board"}
    return CameraFile(
        name,
        camera,
        stand_in,
        _covariance(block, camera),
        _stand_in_distance(svp.get("distance", np.inf)),
        {number(key, "svp: loss_px"): number(value, "svp: loss_px") for key, value in loss.items()},
        _board_warp(calibration.get("board_warp", [])),
        calibration,
        _checked_table(mapping(block.get("projection_uncertainty", {}), "projection_uncertainty")),
        None if facts.get("board") is None else parse_board(facts["board"]),
    )


def _stand_in(content: dict[str, Any]) -> FisheyeCamera:
    """The single-viewpoint camera of the top level."""
    if needed(content, "distortion_model") != "equidistant":
        raise InputError(f"distortion_model {shown(content['distortion_model'])} is not equidistant")
    grid = matrix(_data(content, "camera_matrix"), "camera_matrix: data", 3, 3)
    size = _whole(content, "image_width"), _whole(content, "image_height")
    if not (0 < size[0] <= 1 << 16 and 0 < size[1] <= 1 << 16):
        raise InputError(f"an image of {size[0]}×{size[1]} pixels is not possible")
    distortion = tuple(numbers(_data(content, "distortion_coefficients"), "distortion_coefficients: data"))
    if len(distortion) != 4:
        raise InputError(f"equidistant takes 4 distortion coefficients, not {len(distortion)}")
    return FisheyeCamera(size, grid[0, 0], grid[1, 1], grid[0, 2], grid[1, 2], skew=grid[0, 1], radial=distortion)


def _data(content: dict[str, Any], key: str) -> Any:
    return needed(mapping(needed(content, key), key), "data")


def _whole(content: dict[str, Any], key: str) -> int:
    value = needed(content, key)
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f"{key} must be a whole number, not {shown(value)}")
    return value


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError(f"parameters must be a list of names, not {shown(value)}")
    return tuple(value)


def _text(block: dict[str, Any], key: str, default: str | None = None) -> str:
    value = needed(block, key) if default is None else block.get(key, default)
    if not isinstance(value, str | int | float):
        raise InputError(f"{key} must be text")
    return one_line(value, LONGEST_TEXT)


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
        return {one_line(key, LONGEST_TEXT): float(number) for key, number in value.items()}
    if isinstance(value, str):
        return one_line(value)
    if value is not None and not isinstance(value, int | float):
        raise InputError(f"calibration: {one_line(name, 60)} must be a number, a text or a list of them")
    return value


def _stand_in_distance(value: Any) -> float:
    distance = number(value, "svp: distance")
    if not distance > 0:
        raise InputError(f"svp: distance must be positive, not {distance}")
    return distance


def _checked_table(block: dict[str, Any]) -> dict[str, Any]:
    if not block:
        return {}
    names = {key: f"projection_uncertainty: {key}" for key in ("theta_deg", "distance_m", "sigma_px")}
    angles, distances = (numbers(needed(block, key), names[key]) for key in ("theta_deg", "distance_m"))
    sigma = matrix(needed(block, "sigma_px"), names["sigma_px"], len(angles), len(distances))
    return {"theta_deg": angles, "distance_m": distances, "sigma_px": sigma.tolist()}


def _covariance(block: dict[str, Any], camera: FisheyeCamera) -> np.ndarray:
    count = len(camera.parameters)
    if "covariance" not in block:
        return np.zeros((count, count))
    if _names(needed(block, "parameters")) != camera.parameter_names:
        raise InputError("parameters and covariance do not fit the camera")
    covariance = matrix(block["covariance"], "covariance", count, count)
    if not (np.abs(covariance) <= _LARGEST_VARIANCE).all():
        raise InputError(f"covariance must be finite, and at most {_LARGEST_VARIANCE:g}")
    for name, variance in zip(camera.parameter_names, np.diag(covariance), strict=True):
        if variance < 0:
            raise InputError(f"covariance has {variance:.3g} for {name}: no variance is negative")
    return covariance


def _board_warp(values: Any) -> np.ndarray:
    """Shorter lists are filled with zeros: the twist came last."""
    warp = numbers(values, "board_warp")
    if len(warp) > len(WARP_NAMES) or not all(abs(term) <= _LARGEST_WARP for term in warp):
        raise InputError(f"board_warp holds up to {len(WARP_NAMES)} numbers, each at most {_LARGEST_WARP:g} m")
    return np.array(warp + [0.0] * (len(WARP_NAMES) - len(warp)))


def _read_left_open(block: dict[str, Any]) -> PupilLeftOpen | None:
    content = block.get("pupil_left_open")
    if content is None:
        return None
    content = mapping(content, "pupil_left_open")
    coefficients = numbers(needed(content, "coefficients"), "pupil_left_open: coefficients")
    count = len(coefficients)
    covariance = matrix(needed(content, "covariance"), "pupil_left_open: covariance", count, count)
    return PupilLeftOpen.of(_text(content, "model"), coefficients, covariance.tolist())
