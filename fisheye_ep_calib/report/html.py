"""The page: one file that needs nothing else, for one camera or several."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Sequence
from importlib import resources
from os import PathLike

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup

from fisheye_ep_calib.calibration.words import distance_text
from fisheye_ep_calib.plain_text import printable
from fisheye_ep_calib.report.data import CameraReport
from fisheye_ep_calib.report.figures.style import without_collection
from fisheye_ep_calib.report.panels import panels_of
from fisheye_ep_calib.report.pictures import overlays_of
from fisheye_ep_calib.storage.atomic import atomic_write

_FILES = ("base.html", "page.html", "camera.html", "compare.html", "tables.html", "page.css", "page.js")


def write_report(path: str | PathLike[str], cameras: Sequence[CameraReport], title: str = "") -> None:
    """Write the cameras' report whole or not at all."""
    atomic_write(path, report_html(cameras, title).encode(errors="backslashreplace"))


def report_html(cameras: Sequence[CameraReport], title: str = "") -> str:
    """The report as text. Whatever comes from outside, names above all, is escaped."""
    pages = []
    for number, camera in enumerate(cameras):
        prefix = f"camera-{number + 1}"
        overlays, magnified = overlays_of(camera)
        with without_collection():
            sections = panels_of(camera, prefix)
        order = sorted(range(len(camera.views)), key=lambda row: -_or_infinite(camera.views[row].rms_px))
        pages.append(
            {
                "prefix": prefix,
                "camera": camera,
                "sections": sections,
                "stand_in_drawn": any(
                    panel.identity == f"{prefix}-stand-in" for panels in sections.values() for panel in panels
                ),
                "views": [(camera.views[row], overlays[row]) for row in order],
                "magnified": magnified,
            }
        )
    names = ", ".join(camera.name for camera in cameras)
    return render("page.html", title=title or f"Calibration of {names}", pages=pages)


def render(template: str, **content: object) -> str:
    """A page from one of the templates, with styles and script within it."""
    texts = {
        name: resources.files(__package__).joinpath("templates").joinpath(name).read_text("utf-8") for name in _FILES
    }
    environment = Environment(
        loader=DictLoader(texts),
        autoescape=True,
        finalize=_plain,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "base64": lambda content: base64.b64encode(content).decode(),
        "distance": distance_text,
        "number": _number,
        "svg": Markup,  # figures are drawn here, from numbers alone
    }
    script = texts["page.js"]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template(template).render(
        style=Markup(texts["page.css"]), script=Markup(script), script_hash=digest, **content
    )


def _plain(value: object) -> object:
    """Text without what no page can show; what is made here stays as it is."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _number(value: float, digits: int = 3) -> str:
    """With a fixed number of decimals; a dash for what is unknown."""
    return "–" if not math.isfinite(value) else f"{value:.{digits}f}".replace("-", "−")


def _or_infinite(value: float) -> float:
    return value if math.isfinite(value) else math.inf
