"""What the command line takes: every command with its arguments."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence
from typing import NoReturn

COMMANDS = {
    "calibrate": "calibrate cameras from bags, image folders or observation files",
    "calibrate-fleet": "calibrate many devices, a recording each, and find the odd ones out",
    "evaluate": "measure a camera file on other images, the camera frozen",
    "detect": "find the target in images and show what was found",
    "compare": "how two camera files differ in pixels, against their uncertainties",
    "show": "print a camera file: intrinsics, entrance pupil, what is known about them",
    "export": "a camera or rig file for Kalibr, OpenVINS, Basalt, ORB-SLAM3, VINS, COLMAP, Nerfstudio, OpenCV, mrcal",
    "rig": "where calibrated cameras are to each other, from views of one target",
    "rectify": "images without the fisheye's distortion, the pupil's shift corrected for a distance",
    "target": "write a target true to scale, to print",
    "simulate": "write images of a known camera as a bag",
    "demo": "the whole way once, on rendered images",
}
DESCRIPTION = (
    "Fisheye calibration with a moving entrance pupil: offline from bags, or live as a ROS 2 node (ros2 run "
    "fisheye_ep_calib calibrator)."
)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the whole usage."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Prints the version, which is looked up only where it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from fisheye_ep_calib.version import __version__

        print(f"{parser.prog} {__version__}")
        parser.exit()


def build_parser(program: str, words: Sequence[str]) -> argparse.ArgumentParser:
    """program: the name that it goes by. What it parses has ``run``, to be called with it.

    words: what is to be parsed. Only the command that it names is imported: all of them take five times as long as
    NumPy.
    """
    parser = _Parser(program, description=DESCRIPTION)
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    asked = next((word for word in words if not word.startswith("-")), None)
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary, formatter_class=argparse.RawDescriptionHelpFormatter)
        if name != asked:
            continue
        module = importlib.import_module(f"fisheye_ep_calib.commands.{name.replace('-', '_')}")
        command.description = getattr(module, "DESCRIPTION", summary)
        command.epilog = getattr(module, "EPILOG", None)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser
