"""fisheye_ep_calib target: the shipped target files, one to begin with, and a target as a page to print."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import read_text_outside
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.report.printing import write_target
from fisheye_ep_calib.target import Target, load_target, shipped_files
from fisheye_ep_calib.target.registry import TARGETS, same_kind
from fisheye_ep_calib.yaml_file import MOST_BYTES

DESCRIPTION = (
    "Write a target true to scale, to print at 100 % (no 'fit to page'). A 100 mm line on the page shows whether the\n"
    "printer kept the scale: measure it, and measure the target's spacing. Without TARGET, lists the targets that are\n"
    "shipped: their names do in the place of a file. With --new, prints a target file to edit."
)
EPILOG = """example:
  fisheye_ep_calib target
  fisheye_ep_calib target --new chessboard > board.yaml
  fisheye_ep_calib target board.yaml --output board.pdf --page a3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "target", type=Path, nargs="?", metavar="TARGET", help="target file, or the name of a shipped one"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=".pdf, .svg or .png")
    parser.add_argument(
        "--page", default="a4", metavar="PAGE", help="a4 (default), a3, letter, or WIDTHxHEIGHT in millimetres"
    )
    parser.add_argument("--new", metavar="KIND", help="print a target file of this kind, or a shipped one, to edit")
    parser.add_argument("--overwrite", action="store_true", help="replace FILE")


def run(arguments: argparse.Namespace) -> int:
    if arguments.new is not None:
        if arguments.target is not None or arguments.output is not None:
            raise InputError("--new prints a target file; give it no TARGET and no --output")
        print(_new(arguments.new), end="")
        return 0
    if arguments.target is None:
        if arguments.output is not None:
            raise InputError(f"--output {arguments.output}: say which TARGET to write")
        print("\n".join(_shipped()))
        return 0
    if arguments.output is None:
        print(_described(load_target(arguments.target)))
        return 0
    refuse_existing([arguments.output], arguments.overwrite)
    target = load_target(arguments.target)
    write_target(target, arguments.output, arguments.page, caption=arguments.target.name)
    print(f"wrote {arguments.output}; print it at 100 % and check the 100 mm line")
    return 0


def _shipped() -> list[str]:
    """A line for each shipped target."""
    return [_described(load_target(path)) for path in shipped_files().values()]


def _described(target: Target) -> str:
    width, height = 1e3 * np.ptp(target.object_points[:, :2], axis=0)
    points = len(target.object_points)
    return f"{target.name:30s} {target.kind:12s} {points:4d} points over {width:.0f} × {height:.0f} mm"


def _new(wanted: str) -> str:
    """The text of a shipped target file, the first of the kind or the one of that name."""
    files = shipped_files()
    for name, path in files.items():
        if name == wanted or same_kind(load_target(path).kind, wanted):
            return read_text_outside(path, MOST_BYTES, "target")
    raise InputError(f"--new {wanted}: give a kind, {', '.join(TARGETS)}, or a shipped name, {', '.join(files)}")
