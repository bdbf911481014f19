"""A figure with one pair of axes as SVG: grid, numbers, labels, legend and colour bar around what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fisheye_ep_calib.report.drawing.axes import PageAxes
from fisheye_ep_calib.report.drawing.colours import Colouring
from fisheye_ep_calib.report.drawing.frame import FAINT, FONT, INK, Frame, line, markers, text, width_of
from fisheye_ep_calib.report.drawing.raster import as_address
from fisheye_ep_calib.report.drawing.scales import Scale

_LABEL, _PAD, _TICK = 10.0, 6.0, 3.5  # points: font of labels, room between things, length of a tick's line
_BAR = 10.0  # width of a colour bar
_PER_TICK = (36.0, 19.0)  # points along x and y that a tick takes
_SIDE = 28.0  # beside a circle, for what stands there
_SAMPLE, _ROW = 22.0, 13.5  # of a legend: its piece of line, its height


def page_figure(axes: PageAxes, identity: str, size: tuple[float, float]) -> str:
    """The SVG of axes in a figure of ``size`` inches. identity: unique in the page."""
    width, height = 72 * size[0], 72 * size[1]
    frame = _framed(axes, width, height)
    clip = f"{identity}-clip"
    parts = [
        f'<svg aria-hidden="true" focusable="false" viewBox="0 0 {width:g} {height:g}" '
        'style="overflow: visible" '
        'xmlns="http://www.w3.org/2000/svg">',
        f'<defs><clipPath id="{clip}"><rect x="{frame.left - 2:.2f}" y="{frame.top - 2:.2f}" '
        f'width="{frame.width + 4:.2f}" height="{frame.height + 4:.2f}"/></clipPath></defs>',
    ]
    if not axes.polar:
        parts.append(_ticks(axes, frame))
    parts += [f'<g clip-path="url(#{clip})">', axes.marks(frame), "</g>", axes.frame_line(frame), axes.words(frame)]
    if axes.has_legend:
        parts.append(_legend(axes, frame))
    if axes.bar is not None:
        parts.append(_colour_bar(axes.bar, frame, width))
    return "".join([*parts, "</svg>"])


def _framed(axes: PageAxes, width: float, height: float) -> Frame:
    """The largest box that leaves room for numbers and labels."""
    if axes.polar:
        right = _bar_room(axes)
        return Frame(_SIDE, 16, width - right - 2 * _SIDE, height - 32, axes.x, axes.y, True)
    _, texts = axes.y.marked(int(height / _PER_TICK[1]))
    left = 2 + (_LABEL + _PAD if axes.y.label else 0) + max(map(width_of, texts), default=0) + _TICK + 3
    bottom = 2 + (_LABEL + _PAD if axes.x.label else 0) + FONT + _TICK + 3
    _, texts = axes.x.marked(int((width - left) / _PER_TICK[0]))
    right = max(_bar_room(axes), width_of(texts[-1]) / 2 + 2 if texts else 4)
    frame = Frame(left, 7, width - left - right, height - 7 - bottom, axes.x, axes.y)
    if not axes.aspect_equal:
        return frame
    spans = [abs(scale.limits()[1] - scale.limits()[0]) for scale in (axes.x, axes.y)]
    unit = min(frame.width / spans[0], frame.height / spans[1])
    inner = unit * spans[0], unit * spans[1]
    return replace(
        frame,
        left=frame.left + (frame.width - inner[0]) / 2,
        top=frame.top + (frame.height - inner[1]) / 2,
        width=inner[0],
        height=inner[1],
    )


def _ticks(axes: PageAxes, frame: Frame) -> str:
    """Grid, ticks, their numbers and the labels."""
    left, bottom = frame.left, frame.top + frame.height
    parts, grid = [], []
    ticks, texts = axes.x.marked(int(frame.width / _PER_TICK[0]))
    for u, words in zip(left + frame.width * axes.x.place(ticks), texts, strict=True):
        grid.append([[u, frame.top], [u, bottom], [np.nan, np.nan]])
        parts.append(line(np.array([[u, bottom], [u, bottom + _TICK]]), INK, 0.8))
        parts.append(text(words, u, bottom + _TICK + 1 + FONT, FONT, "middle"))
    ticks, texts = axes.y.marked(int(frame.height / _PER_TICK[1]))
    widest = max(map(width_of, texts), default=0)
    for v, words in zip(frame.top + frame.height * (1 - axes.y.place(ticks)), texts, strict=True):
        grid.append([[left, v], [left + frame.width, v], [np.nan, np.nan]])
        parts.append(line(np.array([[left - _TICK, v], [left, v]]), INK, 0.8))
        parts.append(text(words, left - _TICK - 3, v + 0.35 * FONT, FONT, "end"))
    if axes.x.label:
        down = bottom + _TICK + FONT + _PAD + _LABEL - 1
        parts.append(text(axes.x.label, left + frame.width / 2, down, _LABEL, "middle"))
    if axes.y.label:
        aside = left - _TICK - 3 - widest - _PAD
        parts.append(text(axes.y.label, aside, frame.top + frame.height / 2, _LABEL, "middle", turned=True))
    behind = line(np.array(grid).reshape(-1, 2), FAINT, 0.6) if axes.has_grid and grid else ""
    return behind + "".join(parts)


def _bar_room(axes: PageAxes) -> float:
    """What a colour bar takes on the right."""
    if axes.bar is None:
        return 0.0
    colouring, label, _ = axes.bar
    widest = max(map(width_of, _bar_scale(axes.bar).marked(9)[1]), default=0)
    return 3 * _PAD + _BAR + _TICK + widest + (_LABEL + _PAD if label else 0)


def _bar_scale(bar: tuple[Colouring, str, object]) -> Scale:
    colouring, _, text_of = bar
    return Scale(
        low=colouring.low,
        high=colouring.high,
        logarithmic=colouring.logarithmic,
        ticks=colouring.levels or None,
        text_of=text_of,  # type: ignore[arg-type]
    )


def _colour_bar(bar: tuple[Colouring, str, object], frame: Frame, width: float) -> str:
    colouring, label, _ = bar
    scale = _bar_scale(bar)
    height = 0.85 * frame.height
    left, top = frame.left + frame.width + (_SIDE if frame.polar else 2 * _PAD), frame.top + (frame.height - height) / 2
    shares = (np.arange(256)[::-1] + 0.5) / 256
    low, high = scale.limits()
    values = low * (high / low) ** shares if scale.logarithmic else low + (high - low) * shares
    picture = np.concatenate([colouring.rgb(values), np.full((256, 1), 255, np.uint8)], axis=1)[:, None]
    parts = [
        f'<image x="{left:.2f}" y="{top:.2f}" width="{_BAR:g}" height="{height:.2f}" preserveAspectRatio="none" '
        f'xlink:href="{as_address(picture)}"/>'
    ]
    ticks, texts = scale.marked(int(height / _PER_TICK[1]))
    right = left + _BAR
    for v, words in zip(top + height * (1 - scale.place(ticks)), texts, strict=True):
        parts.append(line(np.array([[right, v], [right + _TICK, v]]), INK, 0.8))
        parts.append(text(words, right + _TICK + 2, v + 0.35 * FONT))
    if label:
        aside = right + _TICK + 2 + max(map(width_of, texts), default=0) + _PAD + 0.6 * _LABEL
        parts.append(text(label, aside, top + height / 2, _LABEL, "middle", turned=True))
    return "".join(parts)


def _legend(axes: PageAxes, frame: Frame) -> str:
    loc, columns = axes.legend_place
    widest = _SAMPLE + _PAD + max(width_of(entry.label) for entry in axes.entries)
    rows = -(-len(axes.entries) // columns)
    width, height = columns * (widest + _PAD), rows * _ROW
    corners = {
        f"{side} {end}": (
            frame.left + 4 if end == "left" else frame.left + frame.width - width,
            frame.top + 2 if side == "upper" else frame.top + frame.height - height - 4,
        )
        for side in ("upper", "lower")
        for end in ("right", "left")
    }
    free = min(corners, key=lambda name: _covered(axes, frame, corners[name], width, height))
    u, v = corners.get(loc, corners[free])
    parts = []
    for number, entry in enumerate(axes.entries):
        left = u + (number // rows) * (widest + _PAD)
        middle = v + (number % rows + 0.5) * _ROW
        if entry.width:
            ends = np.array([[left, middle], [left + _SAMPLE, middle]])
            parts.append(line(ends, entry.colour, entry.width, 1.0, entry.dash))
        if entry.marker:
            parts.append(markers(np.array([[left + _SAMPLE / 2, middle]]), entry.marker, entry.size, entry.colour))
        parts.append(text(entry.label, left + _SAMPLE + _PAD, middle + 0.35 * FONT))
    return "".join(parts)


def _covered(axes: PageAxes, frame: Frame, at: tuple[float, float], width: float, height: float) -> int:
    """How many points of what is drawn a legend at a place would lie on."""
    count = 0
    for x, y in axes.points:
        places = frame.places(x, y) - np.array(at)
        count += int(((places >= 0) & (places <= (width, height))).all(axis=-1).sum())
    return count
