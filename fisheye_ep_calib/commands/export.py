"""fisheye_ep_calib export: a camera or a rig in another program's format."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from fisheye_ep_calib.formats import FORMATS
from fisheye_ep_calib.pipeline.exporting import export, writable_formats
from fisheye_ep_calib.storage.json_text import json_text

DESCRIPTION = (
    "Write a camera file, or all cameras of a rig file, as another program reads it. Nearly all of them know a camera\n"
    "with one viewpoint only: what that loses, by distance, stands in the file. mrcal's CAHVORE has a pupil."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    formats = "\n".join(f"  {name:<18}{FORMATS[name].summary}" for name in writable_formats())
    parser.epilog = (
        f"formats:\n{formats}\n\nexample:\n  fisheye_ep_calib export rig.yaml --to kalibr --output chain.yaml\n"
    )
    parser.add_argument("camera", type=Path, metavar="CAMERA.yaml|rig.yaml")
    parser.add_argument("--to", required=True, choices=writable_formats(), metavar="FORMAT", help="see below")
    parser.add_argument("--output", type=Path, required=True, metavar="FILE")
    parser.add_argument(
        "--svp-distance",
        type=float,
        metavar="METRES",
        help="for which a camera with one viewpoint is to be right (default: the camera file's, usually infinity)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace earlier files")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def run(arguments: argparse.Namespace) -> int:
    done = export(
        arguments.camera,
        arguments.to,
        arguments.output,
        svp_distance=arguments.svp_distance,
        overwrite=arguments.overwrite,
    )
    text_stream = sys.stderr if arguments.json else sys.stdout
    for line in done.words[1:]:  # the first says who wrote the file
        print(line, file=text_stream)
    print(f"wrote {', '.join(map(str, done.paths))}", file=text_stream)
    if arguments.json:
        print(json_text({"to": arguments.to, "files": list(map(str, done.paths)), "words": list(done.words)}))
    return 0
