"""Printing a target true to scale: PDF, SVG or PNG with a ruler and a caption."""

from __future__ import annotations

import io
import zlib
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.atomic import atomic_write
from fisheye_ep_calib.target.base import Target

# Portrait, millimetres.
PAGES = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "letter": (215.9, 279.4)}
MARGIN = 8.0
FOOT = 14.0
RULER = 100.0
DOTS_PER_MM = 300 / 25.4
POINTS_PER_MM = 72 / 25.4
# Bézier handles that draw a quarter circle.
KAPPA = 4 / 3 * (np.sqrt(2) - 1)


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


def write_target(target: Target, path: str | PathLike, page: str = "a4", caption: str = "") -> None:
    """Write a target to print at 100 %: .pdf, .svg or .png (300 dots per inch).

    page: a4, a3, letter, turned as it fits, or WIDTHxHEIGHT in millimetres. caption: beside the ruler, the
    target file's name as a rule. Raises InputError where it does not fit.
    """
    path = Path(path)
    writers = {".pdf": _pdf, ".svg": _svg, ".png": _png}
    if path.suffix.lower() not in writers:
        raise InputError(f"{path}: the name must end in {', '.join(writers)}")
    layout = lay_out(target, page, caption or f"{target.name}.yaml")
    atomic_write(path, writers[path.suffix.lower()](layout))


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
    flip = -1.0 if _y_points_up(target) else 1.0
    middle = 500 * (artwork.high + artwork.low) * [1, flip]
    shift = np.array([page_width / 2, MARGIN + (page_height - 2 * MARGIN - FOOT) / 2]) - middle

    def place(values: np.ndarray) -> np.ndarray:
        placed = 1000 * values
        placed[..., 1] *= flip
        placed[..., :2] += shift
        return placed

    ruler = (MARGIN, page_height - MARGIN - 2.0)
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
    if not (50 <= width <= 5000 and 50 <= height <= 5000):
        raise InputError(f"page {page}: sides must be 50 to 5000 mm")
    return [(width, height)]


def _y_points_up(target: Target) -> bool:
    return target.kind == "aprilgrid"


def _describe(target: Target) -> str:
    columns, rows = getattr(target, "columns", 0), getattr(target, "rows", 0)
    return f"{target.kind} {columns}×{rows}"


def _svg(layout: Layout) -> bytes:
    out = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{layout.width}mm" height="{layout.height}mm"'
        f' viewBox="0 0 {layout.width} {layout.height}">',
        f'<rect width="{layout.width}" height="{layout.height}" fill="white"/>',
    ]
    for quad in layout.quads:
        points = " ".join(f"{x:.4f},{y:.4f}" for x, y in quad)
        out.append(f'<polygon points="{points}" fill="black" shape-rendering="crispEdges"/>')
    for circles, colour in ((layout.discs, "black"), (layout.holes, "white")):
        out += [f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{r:.4f}" fill="{colour}"/>' for x, y, r in circles]
    for first, last in ruler_lines(layout):
        out.append(
            f'<line x1="{first[0]}" y1="{first[1]}" x2="{last[0]}" y2="{last[1]}"'
            ' stroke="black" stroke-width="0.2"/>'
        )
    x, y = layout.ruler
    out.append(
        f'<text x="{x}" y="{y - 4}" font-family="sans-serif" font-size="3">{escape(layout.caption)}</text></svg>'
    )
    return "\n".join(out).encode()


def ruler_lines(layout: Layout) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The ruler's line and its tick marks, millimetres on the page."""
    x, y = layout.ruler
    ticks = [((x + step, y - 1.5), (x + step, y)) for step in np.arange(0, RULER + 1, 10).tolist()]
    return [((x, y), (x + RULER, y)), *ticks]


def _png(layout: Layout) -> bytes:
    """300 dots per inch, edges antialiased by drawing with sub-pixel coordinates."""
    scale, shift = DOTS_PER_MM, 6
    size = int(round(layout.width * scale)), int(round(layout.height * scale))
    image = np.full((size[1], size[0]), 255, np.uint8)

    def fixed(values: np.ndarray) -> np.ndarray:
        # The middle of the first pixel is half a pixel from the page's edge.
        return np.rint((np.asarray(values) * scale - 0.5) * 2**shift).astype(np.int32)

    for quad in layout.quads:
        cv2.fillConvexPoly(image, fixed(quad), 0, cv2.LINE_AA, shift)
    for circles, grey in ((layout.discs, 0), (layout.holes, 255)):
        angle = np.linspace(0, 2 * np.pi, 256, endpoint=False)
        for x, y, radius in circles:
            outline = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)
            cv2.fillConvexPoly(image, fixed(outline), grey, cv2.LINE_AA, shift)
    for first, last in ruler_lines(layout):
        start, stop = fixed(np.array(first)), fixed(np.array(last))
        cv2.line(image, tuple(start.tolist()), tuple(stop.tolist()), 0, 2, cv2.LINE_AA, shift)
    x, y = (np.array(layout.ruler) * scale).astype(int).tolist()
    plain = layout.caption.replace("×", "x").replace("·", "-").encode("ascii", "replace").decode()
    cv2.putText(image, plain, (x, y - int(4 * scale)), cv2.FONT_HERSHEY_SIMPLEX, 0.9, 0, 2, cv2.LINE_AA)
    done, data = cv2.imencode(".png", image)
    if not done:
        raise InputError("OpenCV cannot write PNG files here")
    return _with_resolution(data.tobytes())


def _with_resolution(png: bytes) -> bytes:
    """The PNG with a pHYs chunk, so that a program that prints it knows its size."""
    per_metre = round(DOTS_PER_MM * 1000)
    body = b"pHYs" + per_metre.to_bytes(4, "big") * 2 + b"\x01"
    chunk = (len(body) - 4).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
    header = 8 + 25  # signature and IHDR
    return png[:header] + chunk + png[header:]


def _pdf(layout: Layout) -> bytes:
    """A one-page PDF 1.4 of filled paths; its text is Helvetica, which every reader has."""
    drawing = io.StringIO()
    drawing.write(
        f"{POINTS_PER_MM:.9f} 0 0 {-POINTS_PER_MM:.9f} 0 {layout.height * POINTS_PER_MM:.6f} cm\n0 g\n"
    )
    for quad in layout.quads:
        path = " l ".join(f"{x:.4f} {y:.4f}" for x, y in quad).replace(" l ", " m ", 1)
        drawing.write(f"{path} l h f\n")
    drawing.write("".join(_pdf_circle(*circle) for circle in layout.discs))
    drawing.write("1 g\n" + "".join(_pdf_circle(*circle) for circle in layout.holes) + "0 g 0.2 w\n")
    for first, last in ruler_lines(layout):
        drawing.write(f"{first[0]:.4f} {first[1]:.4f} m {last[0]:.4f} {last[1]:.4f} l S\n")
    x, y = layout.ruler
    text = layout.caption.encode("cp1252", "replace").decode("cp1252")
    for sign in "\\()":
        text = text.replace(sign, "\\" + sign)
    drawing.write(f"BT /F 3 Tf 1 0 0 -1 {x:.3f} {y - 4:.3f} Tm ({text}) Tj ET\n")
    stream = zlib.compress(drawing.getvalue().encode("cp1252"))
    box = f"[0 0 {layout.width * POINTS_PER_MM:.4f} {layout.height * POINTS_PER_MM:.4f}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R"
        " /Resources << /Font << /F 5 0 R >> >> >>".encode(),
        f"<< /Length {len(stream)} /Filter /FlateDecode >>\nstream\n".encode() + stream + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    out, places = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"), []
    for number, body in enumerate(objects, start=1):
        places.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    start = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    out += "".join(f"{place:010d} 00000 n \n" for place in places).encode()
    out += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(out)


def _pdf_circle(x: float, y: float, radius: float) -> str:
    """A filled circle as four Bézier curves (radial error below 0.03 %)."""
    h = KAPPA * radius
    return (
        f"{x + radius:.4f} {y:.4f} m "
        f"{x + radius:.4f} {y + h:.4f} {x + h:.4f} {y + radius:.4f} {x:.4f} {y + radius:.4f} c "
        f"{x - h:.4f} {y + radius:.4f} {x - radius:.4f} {y + h:.4f} {x - radius:.4f} {y:.4f} c "
        f"{x - radius:.4f} {y - h:.4f} {x - h:.4f} {y - radius:.4f} {x:.4f} {y - radius:.4f} c "
        f"{x + h:.4f} {y - radius:.4f} {x + radius:.4f} {y - h:.4f} {x + radius:.4f} {y:.4f} c h f\n"
    )
