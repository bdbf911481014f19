"""fisheye_ep_calib target: a target file as a page to print."""

from __future__ import annotations

import argparse
from pathlib import Path

from fisheye_ep_calib.commands.reporting import refuse_existing
from fisheye_ep_calib.report.printing import write_target
from fisheye_ep_calib.target import load_target

DESCRIPTION = (
    "Write a target true to scale, to print at 100 % (no 'fit to page'). A 100 mm line on the page shows whether the\n"
    "printer kept the scale: measure it, and measure the target's spacing."
)
EPILOG = """example:
  fisheye_ep_calib target board.yaml --output board.pdf --page a3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("target", type=Path, metavar="TARGET.yaml")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help=".pdf, .svg or .png")
    parser.add_argument(
        "--page", default="a4", metavar="PAGE", help="a4 (default), a3, letter, or WIDTHxHEIGHT in millimetres"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace FILE")


def run(arguments: argparse.Namespace) -> int:
    refuse_existing([arguments.output], arguments.overwrite)
    target = load_target(arguments.target)
    write_target(target, arguments.output, arguments.page, caption=arguments.target.name)
    print(f"wrote {arguments.output}; print it at 100 % and check the 100 mm line")
    return 0
