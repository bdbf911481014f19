"""Printing a target true to scale: PDF, SVG or PNG with a ruler and a caption, drawn by matplotlib."""

from __future__ import annotations

import io
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.target.base import Target

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Portrait, millimetres.
PAGES = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
MARGIN = 8.0
FOOT = 14.0
RULER = 100.0
NARROWEST, WIDEST = RULER + 2 * MARGIN, 5000.0
MM_PER_INCH = 25.4
DOTS_PER_INCH = 300
DOTS_PER_MM = DOTS_PER_INCH / MM_PER_INCH
MOST_DOTS = 12000  # a side of a PNG
LETTER = 3.0  # mm
STROKE, TICK = 0.2, 1.5  # mm: thickness of the ruler's lines, height of its strokes
# What the user's own matplotlib settings may not change: the page's size, and edges where they are.
_SETTINGS: Any = {
    "savefig.bbox": None,
    "savefig.facecolor": "white",
    "figure.constrained_layout.use": False,
    "figure.autolayout": False,
    "path.simplify": False,
    "path.sketch": None,
    "svg.fonttype": "none",
    "svg.hashsalt": "target",
    "font.family": ["DejaVu Sans"],
    "text.usetex": False,
}
_NO_DATE = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {}}


@dataclass(frozen=True)
class Layout:
    """A target on its page, millimetres from the page's top left, y down.

    width, height: of the page. quads (q, 4, 2), discs (d, 3), holes (h, 3): as in Artwork. ruler: its left
    end.
    """

    width: float
    height: float
    quads: np.ndarray
    discs: np.ndarray
    holes: np.ndarray
    ruler: tuple[float, float]
    caption: str


def write_target(target: Target, path: str | PathLike[str], page: str = "a4", caption: str = "") -> None:
    """Write a target to print at 100 %: .pdf, .svg or .png (300 dots per inch).

    page: a4, a3, letter, turned as it fits, or WIDTHxHEIGHT in millimetres. caption: beside the ruler, the
    target file's name as a rule. Raises InputError where it does not fit.
    """
    path = Path(path)
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _NO_DATE:
        raise InputError(f"{path}: the name must end in {', '.join(f'.{ending}' for ending in _NO_DATE)}")
    layout = lay_out(target, page, caption or f"{target.name}.yaml")
    if kind == "png" and max(layout.width, layout.height) * DOTS_PER_MM > MOST_DOTS:
        size = f"{layout.width:g} × {layout.height:g} mm"
        raise InputError(f"{path}: a picture of {size} is too large; take .pdf or .svg")
    atomic_write(path, draw(layout, kind))


def lay_out(target: Target, page: str, caption: str) -> Layout:
    """Place a target in the middle of a page, over a ruler and a caption. Raises InputError where it does not
    fit.
    """
    artwork = target.artwork()
    width, height = 1000 * (artwork.high - artwork.low)
    sizes = _page_sizes(page)
    for page_width, page_height in sizes:
        if width <= page_width - 2 * MARGIN and height <= page_height - 2 * MARGIN - FOOT:
            break
    else:
        raise InputError(
            f"{target.name} is {width:.0f} × {height:.0f} mm and does not fit on {page}"
            f" (room for {sizes[0][0] - 2 * MARGIN:.0f} × {sizes[0][1] - 2 * MARGIN - FOOT:.0f} mm):"
            " take a larger page or a smaller target"
        )
    flip = -1.0 if target.y_up else 1.0
    middle = 500 * (artwork.high + artwork.low) * [1, flip]
    shift = np.array([page_width / 2, MARGIN + (page_height - 2 * MARGIN - FOOT) / 2]) - middle

    def place(values: np.ndarray) -> np.ndarray:
        placed = 1000 * values
        placed[..., 1] *= flip
        placed[..., :2] += shift
        return placed

    # From the edge of a dot on, so that a PNG shows its length to the dot.
    ruler = (np.ceil(MARGIN * DOTS_PER_MM) / DOTS_PER_MM, page_height - MARGIN - 2.0)
    text = f"{caption} · {_describe(target)} · print at 100 %: this line is {RULER:.0f} mm long"
    return Layout(
        page_width, page_height, place(artwork.quads), place(artwork.discs), place(artwork.holes), ruler, text
    )


def _page_sizes(page: str) -> list[tuple[float, float]]:
    name = page.lower()
    if name in PAGES:
        size = PAGES[name]
        return [size, size[::-1]]
    try:
        width, height = (float(part) for part in name.replace("mm", "").split("x"))
    except ValueError:
        raise InputError(f"unknown page {page!r}; known: {', '.join(PAGES)}, or WIDTHxHEIGHT in mm") from None
    if not (NARROWEST <= width <= WIDEST and NARROWEST <= height <= WIDEST):
        raise InputError(f"page {page}: sides must be {NARROWEST:g} to {WIDEST:g} mm")
    return [(width, height)]


def _describe(target: Target) -> str:
    columns, rows = getattr(target, "columns", 0), getattr(target, "rows", 0)
    told = f"{target.kind} {columns}×{rows}" + (" inner corners" if target.kind == "chessboard" else "")
    for name in ("spacing", "square_size", "marker_size", "tag_size", "tag_spacing"):
        value = getattr(target, name, None)
        if isinstance(value, float):
            told += f", {name.replace('_', ' ')} {1e3 * value:g} mm" if name != "tag_spacing" else f", {value:g} apart"
    if target.disc_radius:
        told += f", radius {1e3 * target.disc_radius:g} mm"
    dictionary = getattr(target, "dictionary", None)
    return told + (f", {dictionary}" if isinstance(dictionary, str) else "")


def ruler_bars(layout: Layout) -> np.ndarray:
    """The ruler's line and its eleven strokes as rectangles, (12, 4, 2) millimetres on the page.

    The outer strokes lie within the line: from tip to tip it is 100 mm, however thick.
    """
    x, y = layout.ruler
    half = STROKE / 2
    middle = x + np.linspace(0, RULER, 11)
    middle[[0, -1]] += [half, -half]
    sides = [(x, x + RULER, y - half, y + half), *((m - half, m + half, y - TICK, y) for m in middle)]
    return np.array([((left, top), (right, top), (right, low), (left, low)) for left, right, top, low in sides])


def draw(layout: Layout, kind: str) -> bytes:
    """The page as pdf, svg or png."""
    import matplotlib

    with matplotlib.rc_context(_SETTINGS):
        page = io.BytesIO()
        metadata = {"Title": layout.caption, **_NO_DATE[kind]}
        _figure(layout).savefig(page, format=kind, dpi=DOTS_PER_INCH, metadata=metadata)
    return page.getvalue()


def _figure(layout: Layout) -> Figure:
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    figure = Figure(figsize=(layout.width / MM_PER_INCH, layout.height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, layout.width), ylim=(layout.height, 0))
    axes.set_axis_off()
    black = np.concatenate([layout.quads, ruler_bars(layout)])
    quads = [Outline(quad, closed=False) for quad in black[:, [0, 1, 2, 3, 0]]]
    discs, holes = ([Outline.circle((x, y), r) for x, y, r in part] for part in (layout.discs, layout.holes))
    for outlines, colour in ((quads + discs, "black"), (holes, "white")):
        if outlines:
            # One outline for all: shapes that touch show no seam. Unsnapped: edges stay off the grid of dots.
            whole = Outline.make_compound_path(*outlines)
            axes.add_patch(PathPatch(whole, facecolor=colour, linewidth=0, snap=False))
    x, y = layout.ruler
    size = LETTER / MM_PER_INCH * 72
    axes.text(x, y - 4, layout.caption, fontsize=size, color="black", parse_math=False)
    return figure
