"""The command ``fisheye_ep_calib``: parses arguments, turns errors into one line and an exit code."""

from __future__ import annotations

import argparse
import importlib
import io
import logging
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import NoReturn

from fisheye_ep_calib.errors import CalibrationError

PROGRAM = "fisheye_ep_calib"
COMMANDS = {
    "calibrate": "calibrate cameras from bags, image folders or observation files",
    "calibrate-fleet": "calibrate many devices, a recording each, and find the odd ones out",
    "evaluate": "measure a camera file on other images, the camera frozen",
    "detect": "find the target in images and show what was found",
    "compare": "how two camera files differ in pixels, against their uncertainties",
    "show": "print a camera file: intrinsics, entrance pupil, what is known about them",
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


def build_parser() -> argparse.ArgumentParser:
    parser = _Parser(PROGRAM, description=DESCRIPTION)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, summary in COMMANDS.items():
        module = importlib.import_module(f"fisheye_ep_calib.commands.{name.replace('-', '_')}")
        command = commands.add_parser(
            name,
            help=summary,
            description=getattr(module, "DESCRIPTION", summary),
            epilog=getattr(module, "EPILOG", None),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 0 done, 1 could not, 2 wrong usage or input, 130 Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that knows no θ, a file name that is no text
    logging.basicConfig(format="%(levelname)s: %(message)s", stream=sys.stderr)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C: what was found is kept
    try:
        parsed = build_parser().parse_args(arguments)
        return parsed.run(parsed)
    except CalibrationError as error:
        return _fail(str(error), error.exit_code)
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _fail(f"{error.filename or ''}: {error.strerror or error}".lstrip(": "), 1)
    except MemoryError:
        return _fail("out of memory", 1)


def _fail(message: str, code: int) -> int:
    print(f"{PROGRAM}: error: {message}", file=sys.stderr)
    return code


def calibrate_bag_main() -> int:
    """``ros2 run fisheye_ep_calib calibrate_bag``: the command calibrate, without what ROS appends."""
    given = sys.argv[1:]
    if "--ros-args" in given:
        given = given[: given.index("--ros-args")]
    return main(["calibrate", *given])
