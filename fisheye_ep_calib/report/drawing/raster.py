"""What is drawn as pixels within an SVG: thousands of dots or lines, and fields of colours.

Places are in pixels of the picture (h, w), y down; a picture is RGBA.
"""

from __future__ import annotations

import base64

import cv2
import numpy as np

from fisheye_ep_calib.arrays import FloatArray
from fisheye_ep_calib.report.drawing.colours import Colouring, rgb_of

_FINER = 2  # lines and fields are drawn so many times as large, so that their edges are smooth
_OVERSAMPLED = 1.5  # samples a pixel of a field, so that no pixel is left out


def dots(places: np.ndarray, size: tuple[int, int], radius: float, colour: str, alpha: float) -> np.ndarray:
    """Round dots at places (n, 2) that cover each other as if painted one after the other."""
    height, width = size
    column, row = np.round(places[np.isfinite(places).all(axis=1)]).astype(int).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    count = np.bincount(row[inside] * width + column[inside], minlength=height * width).reshape(size)
    reach = int(np.ceil(radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = np.clip(radius + 0.5 - np.hypot(x, y), 0, 1).astype(np.float32)
    covered = cv2.filter2D(count.astype(np.float32), -1, kernel, borderType=cv2.BORDER_CONSTANT)
    return painted(1 - (1 - alpha) ** covered, colour)


def segments(starts: np.ndarray, ends: np.ndarray, size: tuple[int, int], width: float, colour: str) -> np.ndarray:
    """Lines from places (n, 2) to places (n, 2)."""
    mask = np.zeros((_FINER * size[0], _FINER * size[1]), np.uint8)
    shift = 4
    lines = np.stack([starts, ends], axis=1)
    lines = np.round((_FINER * (lines + 0.5) - 0.5) * 2**shift).astype(np.int32)
    cv2.polylines(mask, list(lines), False, 255, max(round(_FINER * width), 1), cv2.LINE_AA, shift)
    return painted(cv2.resize(mask, size[::-1], interpolation=cv2.INTER_AREA) / 255.0, colour)


def painted(alpha: np.ndarray, colour: str) -> np.ndarray:
    """One colour with alpha (h, w), 0 to 1."""
    picture = np.empty((*alpha.shape, 4), np.uint8)
    picture[..., :3] = rgb_of(colour)
    picture[..., 3] = np.round(255 * np.clip(alpha, 0, 1))
    return picture


def coloured(values: np.ndarray, colouring: Colouring) -> np.ndarray:
    """Values (h, w) as colours, clear where they are NaN."""
    picture = np.empty((*values.shape, 4), np.uint8)
    picture[..., :3] = colouring.rgb(values)
    picture[..., 3] = np.where(np.isnan(values), 0, 255)
    return picture


def cells(column: np.ndarray, row: np.ndarray, columns: np.ndarray, rows: np.ndarray, values: np.ndarray) -> FloatArray:
    """The value of the cell (rows, columns) that each place lies in, by edges in ascending order; NaN outside."""
    i, j = np.searchsorted(rows, row, side="right") - 1, np.searchsorted(columns, column, side="right") - 1
    inside = (i >= 0) & (i < len(rows) - 1) & (j >= 0) & (j < len(columns) - 1)
    found = values[np.clip(i, 0, len(rows) - 2), np.clip(j, 0, len(columns) - 2)]
    return np.where(inside, found, np.nan)


def grid_field(places: np.ndarray, values: np.ndarray, size: tuple[int, int]) -> FloatArray:
    """Values (h, w) between the nodes of a grid: places (r, c, 2), values (r, c), NaN where there are none."""
    steps = [np.nan_to_num(np.linalg.norm(np.diff(places, axis=axis), axis=-1)) for axis in (0, 1)]
    finer = [int(np.clip(np.ceil(_OVERSAMPLED * step.max(initial=1.0)), 1, 200)) for step in steps]
    rows, columns = (np.linspace(0, n - 1, (n - 1) * f + 1) for n, f in zip(values.shape, finer, strict=True))
    stacked = np.concatenate([places, values[..., None]], axis=-1).astype(np.float32)
    across = np.meshgrid(columns.astype(np.float32), rows.astype(np.float32))
    samples = cv2.remap(stacked, *across, cv2.INTER_LINEAR)
    return _splatted(samples.reshape(-1, 3), size)


def triangle_field(places: np.ndarray, values: np.ndarray, size: tuple[int, int]) -> FloatArray:
    """Values (h, w) between places (n, 2) and their values (n,), linear in the triangles of Delaunay's net.

    It has no edges inside, so that every second pixel is enough to know it by.
    """
    corners = _triangles(places)
    if len(corners) == 0:
        return np.full(size, np.nan)
    known = np.concatenate([(places - 0.5) / 2, values[:, None]], axis=1)
    edges = np.linalg.norm(places[corners] - places[np.roll(corners, 1, axis=1)], axis=-1) / 2
    steps = 4 * np.ceil(_OVERSAMPLED * np.maximum(edges.max(axis=1), 1.0) / 4).astype(int)
    samples = [
        (_within_triangle(count) @ known[corners[steps == count]]).reshape(-1, 3) for count in np.unique(steps).tolist()
    ]
    coarse = _splatted(np.concatenate(samples), ((size[0] + 1) // 2, (size[1] + 1) // 2))
    return np.asarray(cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_LINEAR))


def _within_triangle(steps: int) -> FloatArray:
    """Weights (n, 3) of a triangle's corners at the nodes of a net with so many steps a side."""
    first, second = np.mgrid[: steps + 1, : steps + 1].reshape(2, -1)
    within = first + second <= steps
    weights = np.stack([first, second, steps - first - second], axis=-1)[within] / steps
    return np.asarray(weights)


def _triangles(places: np.ndarray) -> np.ndarray:
    """Corners (t, 3), by number of place."""
    low, high = places.min(axis=0) - 10, places.max(axis=0) + 10
    net = cv2.Subdiv2D((0, 0, int(np.ceil(high[0] - low[0])) + 1, int(np.ceil(high[1] - low[1])) + 1))
    number = {net.insert((float(u), float(v))): index for index, (u, v) in enumerate(places - low)}
    corners = []
    for edge in net.getLeadingEdgeList():
        ring = [net.edgeOrg(edge)[0]]
        for _ in range(2):
            edge = net.getEdge(edge, cv2.SUBDIV2D_NEXT_AROUND_LEFT)
            ring.append(net.edgeOrg(edge)[0])
        if all(corner in number for corner in ring):
            corners.append([number[corner] for corner in ring])
    return np.array(corners, int).reshape(-1, 3)


def _splatted(samples: np.ndarray, size: tuple[int, int]) -> FloatArray:
    """Samples (n, 3), x, y and value, each at its pixel."""
    field = np.full(size, np.nan)
    samples = samples[np.isfinite(samples).all(axis=1)]
    column, row = np.round(samples[:, :2]).astype(int).T
    inside = (column >= 0) & (column < size[1]) & (row >= 0) & (row < size[0])
    field[row[inside], column[inside]] = samples[inside, 2]
    return field


def as_address(picture: np.ndarray) -> str:
    """A picture as a data address."""
    _, encoded = cv2.imencode(".png", np.ascontiguousarray(picture[..., [2, 1, 0, 3]]))
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
