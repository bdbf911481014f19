"""Images of a target through a fisheye camera with an entrance pupil: each pixel along its own ray."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fisheye_ep_calib.arrays import BoolArray, Image
from fisheye_ep_calib.simulation.patterns import Pattern, pattern
from fisheye_ep_calib.simulation.rays import Window, board_window, pixel_rays, plane_points
from fisheye_ep_calib.simulation.scene_camera import SceneCamera
from fisheye_ep_calib.target import Target

_SAMPLES, _STRIDE = 233, 144  # a Fibonacci lattice: no straight edge passes many of its samples at once
_PIXELS_AT_ONCE = 16384


@dataclass(frozen=True)
class Imaging:
    """Everything about an image that is not geometry. Grey levels are 0..255.

    black, white: grey levels of the print. background: grey level behind the board (outside the field of
    view: 0). texture: peak grey-level amplitude of random structure in the background. blur: σ of the
    Gaussian point spread, pixels. noise: σ of the sensor noise, grey levels. vignetting: fraction of the
    light lost at the image corner, falling with the square of the radius. shading: relative change of
    illumination from the board's middle to its corner, along shading_angle (rad). occluders: polygons (k,
    2) in pixels, drawn over the board with the grey level occluder. seed: of noise and texture.
    """

    black: float = 25.0
    white: float = 225.0
    background: float = 110.0
    texture: float = 0.0
    blur: float = 0.0
    noise: float = 0.0
    vignetting: float = 0.0
    shading: float = 0.0
    shading_angle: float = 0.0
    occluders: tuple[np.ndarray, ...] = ()
    occluder: float = 70.0
    seed: int = 0


PLAIN = Imaging()


def render(camera: SceneCamera, target: Target, camera_from_target: np.ndarray, imaging: Imaging = PLAIN) -> np.ndarray:
    """Image (h, w) uint8 of a target at a pose (4, 4).

    Pixels that an edge of the print crosses are averaged over 233 samples of their area, so that the
    grey-weighted centre of gravity of a disc is right to one or two thousandths of a pixel; all others take
    one.
    """
    printed = pattern(target)
    image = _background(camera, imaging)
    window = board_window(camera, printed, camera_from_target)
    left, top, right, bottom = window
    if right > left and bottom > top:
        grey, coverage = _board(camera, printed, camera_from_target, window, imaging)
        area = image[top:bottom, left:right]
        area += coverage * (grey - area)
    for polygon in imaging.occluders:
        _fill(image, polygon, imaging.occluder)
    return _expose(image, imaging)


def visible_mask(imaging: Imaging, image_size: tuple[int, int]) -> BoolArray:
    """Mask (h, w) bool of the pixels that no occluder touches."""
    hidden = np.zeros((image_size[1], image_size[0]), np.float32)
    for polygon in imaging.occluders:
        _fill(hidden, polygon, 1.0)
    result: BoolArray = hidden == 0
    return result


def _background(camera: SceneCamera, imaging: Imaging) -> np.ndarray:
    """What is behind the board, (h, w) float32."""
    width, height = camera.image_size
    image = np.full((height, width), imaging.background, np.float32)
    if imaging.texture > 0:
        rng = np.random.default_rng([imaging.seed, 1])
        for cells in (12, 40, 150):
            coarse = rng.uniform(-1, 1, (cells, cells)).astype(np.float32)
            image += imaging.texture / 2 * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    in_field = np.isfinite(pixel_rays(camera).directions[1:-1, 1:-1, 2])
    return np.where(in_field, np.maximum(image, 0), np.float32(0))


def _board(
    camera: SceneCamera, printed: Pattern, camera_from_target: np.ndarray, window: Window, imaging: Imaging
) -> tuple[np.ndarray, np.ndarray]:
    """Grey level and coverage 0..1 of the board in a window of the image, each (h, w) float32."""
    x, y = plane_points(pixel_rays(camera), camera_from_target, window, printed.faces)
    x_terms, y_terms = _taylor_terms(x), _taylor_terms(y)
    x, y = x[1:-1, 1:-1], y[1:-1, 1:-1]
    reach_x, reach_y = (0.5 * (np.abs(terms[0]) + np.abs(terms[1])) for terms in (x_terms, y_terms))
    low, high = printed.low, printed.high
    rows, columns = np.nonzero(
        (x > low[0] - reach_x) & (x < high[0] + reach_x) & (y > low[1] - reach_y) & (y < high[1] + reach_y)
    )
    x, y = x[rows, columns], y[rows, columns]
    light = printed.white(x, y).astype(np.float32)
    covered = printed.on_board(x, y).astype(np.float32)
    (mixed,) = np.nonzero(printed.has_edge(x, y, reach_x[rows, columns], reach_y[rows, columns]))
    x_terms, y_terms = (terms[:, rows[mixed], columns[mixed]] for terms in (x_terms, y_terms))
    for first in range(0, len(mixed), _PIXELS_AT_ONCE):
        part = mixed[first : first + _PIXELS_AT_ONCE]
        here = slice(first, first + _PIXELS_AT_ONCE)
        light[part], covered[part] = _average(printed, x[part], y[part], x_terms[:, here], y_terms[:, here])
    light *= _illumination(x, y, printed, imaging)
    grey, coverage = np.zeros(reach_x.shape, np.float32), np.zeros(reach_x.shape, np.float32)
    grey[rows, columns] = imaging.black + (imaging.white - imaging.black) * light
    coverage[rows, columns] = covered
    return grey, coverage


def _taylor_terms(values: np.ndarray) -> np.ndarray:
    """∂u, ∂v, ½∂uu, ∂uv, ½∂vv (5, h, w) by differences, of values (h + 2, w + 2).

    Seen at a slant, the board bends within a pixel: without the second order, edges shift by up to 1e-3 px.
    """
    middle, left, right = values[1:-1, 1:-1], values[1:-1, :-2], values[1:-1, 2:]
    above, below = values[:-2, 1:-1], values[2:, 1:-1]
    twisted = values[2:, 2:] - values[2:, :-2] - values[:-2, 2:] + values[:-2, :-2]
    return np.stack(
        [
            0.5 * (right - left),
            0.5 * (below - above),
            0.5 * (right - 2 * middle + left),
            0.25 * twisted,
            0.5 * (below - 2 * middle + above),
        ]
    )


def _average(
    printed: Pattern, x: np.ndarray, y: np.ndarray, x_terms: np.ndarray, y_terms: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """White share of the covered part of n pixels, and that part's share. x, y (n,), terms (5, n)."""
    index = np.arange(_SAMPLES, dtype=np.float32)[:, None]
    du = (index + 0.5) / _SAMPLES - 0.5
    dv = (index * _STRIDE % _SAMPLES + 0.5) / _SAMPLES - 0.5
    powers = np.hstack([du, dv, du * du, du * dv, dv * dv])
    sample_x, sample_y = x + powers @ x_terms, y + powers @ y_terms
    inside = printed.on_board(sample_x, sample_y)
    count = inside.sum(axis=0)
    with np.errstate(invalid="ignore"):  # not a number beside what the camera does not see, and not inside then
        white = (printed.white(sample_x, sample_y) & inside).sum(axis=0)
    return (white / np.maximum(count, 1)).astype(np.float32), (count / _SAMPLES).astype(np.float32)


def _illumination(x: np.ndarray, y: np.ndarray, printed: Pattern, imaging: Imaging) -> np.ndarray:
    """Relative illumination of points on the board: a linear ramp, 1 in the middle."""
    half, middle = (printed.high - printed.low) / 2, (printed.high + printed.low) / 2
    along_x = np.cos(imaging.shading_angle) * (x - middle[0])
    along_y = np.sin(imaging.shading_angle) * (y - middle[1])
    result: np.ndarray = (1 + imaging.shading / np.hypot(*half) * (along_x + along_y)).astype(np.float32)
    return result


def _fill(image: np.ndarray, polygon: np.ndarray, value: float) -> None:
    """Draw a filled polygon (k, 2), pixels, into a float image."""
    cv2.fillPoly(image, [np.round(np.asarray(polygon) * 16).astype(np.int32)], float(value), shift=4)


def _expose(image: np.ndarray, imaging: Imaging) -> Image:
    """Vignetting, blur, noise and rounding to uint8."""
    height, width = image.shape
    if imaging.vignetting > 0:
        u = (np.arange(width, dtype=np.float32) / (width - 1) * 2 - 1) ** 2
        v = (np.arange(height, dtype=np.float32) / (height - 1) * 2 - 1) ** 2
        image = image * (1 - np.float32(imaging.vignetting / 2) * (u + v[:, None]))
    if imaging.blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), imaging.blur)
    if imaging.noise > 0:
        rng = np.random.default_rng([imaging.seed, 2])
        image = image + np.float32(imaging.noise) * rng.standard_normal(image.shape, np.float32)
    result: Image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return result
