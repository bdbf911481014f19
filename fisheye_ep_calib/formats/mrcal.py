"""mrcal's cameramodel: a dict of Python. Read: PINHOLE, OPENCV4 to OPENCV12, STEREOGRAPHIC, CAHVOR, CAHVORE.

CAHVORE has a pupil that moves. With ζ along the axis and λ across it, its angle solves

    ζ sinθ − λ cosθ = (θ − sinθ) (e0 + e1 θ² + e2 θ⁴)

and this package's, ρ cosθ = (z + E) sinθ, so that E(θ) = −(θ/sinθ − 1)(e0 + e1 θ² + e2 θ⁴): Gennery's family, number by
number. As θ/sinθ − 1 = θ²/6 + 7 θ⁴/360 + …, an even E = a θ² + b θ⁴ needs e0 = −6 a, e1 = −6 (b − 7 a/60), and so on
without end: cut after e2 it is fitted, over the image and from 0.1 m to infinity. With linearity 0 its lens is
r = θ (1 + r0 + r1 θ² + r2 θ⁴): two terms, which is what it loses most by.

The axis is o = (sinα cosβ, sinβ, cosα cosβ). In a frame with o for z, the image plane is turned by R = R_y(−α) R_x(β),
which is this package's extra ``tilt`` with τx = β, τy = −α, but for its scale R33 and shift (R13, R23).
extrinsics is the camera from the reference, a rotation vector and a shift.
(mrcal, cahvore.cc, mrcal.c, doc/lensmodels.org; Gennery, IJCV 68, 2006.)
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from fisheye_ep_calib.camera import FAR, FisheyeCamera
from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.file_values import needed, numbers
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera, pinhole_camera, size_of
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, floats, statement
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.rotation import vector_from_rotation

_TERMS = 3  # e0, e1, e2
_FITTED = (0.1, 0.3, 1.0, 10.0, np.inf)  # metres
# What a camera was calibrated from, beside it in the file: megabytes in base85, which has no quotes and no backslashes.
_INPUTS = re.compile(r"(['\"]optimization_inputs['\"]\s*:\s*)b(['\"])[^'\"\\\s]*\2")
_MODEL = re.compile(r"LENSMODEL_(PINHOLE|STEREOGRAPHIC|OPENCV(?:4|5|8|12)|CAHVOR|CAHVORE_linearity=(\S+))")


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """LENSMODEL_CAHVORE with linearity 0; of a rig a file a camera, with the camera's name in its name."""
    written = [cahvore(placed.camera) for placed in cameras]
    words = (*statement(cameras, written), "no optimization_inputs: mrcal cannot tell its uncertainty from this file")
    pairs = list(zip(cameras, written, strict=True))
    if len(pairs) == 1:
        return Written({"": _text(*pairs[0], words)}, words)
    return Written({f"_{placed.name}": _text(placed, camera, words) for placed, camera in pairs}, words)


def cahvore(camera: FisheyeCamera) -> FisheyeCamera:
    """The CAHVORE camera with linearity 0 that comes nearest, over the image and over distances."""
    from fisheye_ep_calib.calibration.assessing.nearest_camera import nearest_camera
    from fisheye_ep_calib.calibration.assessing.stand_in import points_over_image

    pixels, points = [], []
    for distance in _FITTED if camera.coefficients else _FITTED[-1:]:
        own, where = points_over_image(camera, distance)
        pixels.append(own)
        points.append(FAR * where if np.isinf(distance) else where)
    series = camera.lens in ("kannala_brandt", "kannala_brandt_6")
    start = FisheyeCamera(
        camera.image_size,
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        radial=(0.0, 0.0, *(camera.radial[:2] if series else (0.0, 0.0))),
        lens="cahvore",
        model="gennery" if camera.coefficients else camera.model,
        coefficients=_gennery(camera) if camera.coefficients else (),
    )
    return nearest_camera(start, ("skew", "linearity", "r0"), np.concatenate(points), np.concatenate(pixels))


def _gennery(camera: FisheyeCamera) -> tuple[float, ...]:
    """e0, e1, e2 whose E(θ) comes nearest on [0, θ_limit]; exact where the family is Gennery's."""
    if camera.model == "gennery":
        return (*camera.coefficients, 0.0, 0.0, 0.0)[:_TERMS]
    from fisheye_ep_calib.camera import PUPIL_FAMILIES

    theta = np.linspace(0.0, min(camera.theta_limit, 2.5), 200)
    basis = PUPIL_FAMILIES["gennery"].basis(theta, _TERMS)
    return tuple(floats(np.linalg.lstsq(basis.T, camera.entrance_pupil(theta), rcond=None)[0]))


def _text(placed: PlacedCamera, camera: FisheyeCamera, words: tuple[str, ...]) -> str:
    _, r0, r1, r2 = camera.radial
    pupil = (*camera.coefficients, 0.0, 0.0, 0.0)[:_TERMS]
    intrinsics = floats([camera.fx, camera.fy, camera.cx, camera.cy, 0.0, 0.0, r0, r1, r2, *pupil])
    pose = placed.camera_from_reference
    extrinsics = floats([*vector_from_rotation(pose[:3, :3]), *pose[:3, 3]])
    lines = [f"# {line}" for line in words] + ["{"]
    lines += ["    'lensmodel': 'LENSMODEL_CAHVORE_linearity=0.00',", f"    'intrinsics': {intrinsics},"]
    lines += [f"    'extrinsics': {extrinsics},", f"    'imagersize': {list(camera.image_size)},", "}"]
    return "\n".join(lines) + "\n"


def without_inputs(text: str) -> str:
    """The text of a cameramodel without its ``optimization_inputs``; any other text as it is."""
    return _INPUTS.sub(r"\1None", text, count=1)


def recognises(text: str) -> bool:
    return "LENSMODEL_" in text and "imagersize" in text


def read(text: str) -> list[ForeignCamera]:
    try:
        content: Any = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError) as error:
        raise InputError(f"not a cameramodel: {first_line(error)}") from None
    if not isinstance(content, dict):
        raise InputError("a cameramodel is a dict")
    model = one_line(needed(content, "lensmodel"))
    match = _MODEL.fullmatch(model)
    if not match:
        raise InputError(
            f"{model[:80]} is not known here; known: PINHOLE, STEREOGRAPHIC, OPENCV4 to 12, CAHVOR, CAHVORE; "
            "mrcal-convert-lensmodel makes one of those of it"
        )
    size = size_of(needed(content, "imagersize"), "imagersize")
    values = numbers(needed(content, "intrinsics"), "intrinsics")
    kind = match[1]
    if kind.startswith("CAHVOR"):
        return [_cahvor(size, values, model, 1.0 if match[2] is None else float(match[2]), match[2] is not None)]
    if len(values) < 4:
        raise InputError(f"{model} takes 4 intrinsics at least, not {len(values)}")
    fx, fy, cx, cy, *distortion = values
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    expected = int(kind.removeprefix("OPENCV")) if kind.startswith("OPENCV") else 0
    if len(distortion) != expected:
        raise InputError(f"{model} takes {expected} distortion coefficients, not {len(distortion)}")
    if kind == "STEREOGRAPHIC":
        radial = (0.5, 0.0, 0.0, 0.0)
        return [ForeignCamera("camera", FisheyeCamera(size, fx, fy, cx, cy, radial=radial, lens="cahvore"), model)]
    return [ForeignCamera("camera", pinhole_camera(size, matrix, distortion), model)]


def _cahvor(size: tuple[int, int], values: list[float], model: str, linearity: float, pupil: bool) -> ForeignCamera:
    """In the frame of its axis; see the module's head."""
    if len(values) != (12 if pupil else 9):
        raise InputError(f"{model} takes {12 if pupil else 9} intrinsics, not {len(values)}")
    fx, fy, cx, cy, alpha, beta, *radial = values[:9]
    turned = _file_from_axis(alpha, beta)
    scale = turned[2, 2]
    if not scale > 0.1:
        raise InputError(f"{model}: its axis is turned out of the image")
    coefficients = tuple(values[9:]) if any(values[9:]) else ()
    camera = FisheyeCamera(
        size,
        fx / scale,
        fy / scale,
        cx + fx * turned[0, 2] / scale,
        cy + fy * turned[1, 2] / scale,
        radial=(linearity, *radial),
        lens="cahvore",
        model="gennery" if coefficients else "kannala",
        coefficients=coefficients,
        extras={"tilt": (beta, -alpha)} if alpha or beta else {},
    )
    return ForeignCamera("camera", camera, model, turned)


def _file_from_axis(alpha: float, beta: float) -> np.ndarray:
    """R (3, 3) = R_y(−α) R_x(β), whose last column is the axis o."""
    about_x = np.array([[1, 0, 0], [0, np.cos(beta), np.sin(beta)], [0, -np.sin(beta), np.cos(beta)]])
    about_y = np.array([[np.cos(alpha), 0, np.sin(alpha)], [0, 1, 0], [-np.sin(alpha), 0, np.cos(alpha)]])
    return np.asarray(about_y @ about_x)


MRCAL = Format("mrcal", "mrcal's cameramodel (CAHVORE, which has a pupil), a file a camera", write, recognises, read)
