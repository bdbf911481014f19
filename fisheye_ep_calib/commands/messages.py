"""What the engine says, in the words of the command line: on stderr, and with options in place of parameters."""

from __future__ import annotations

import argparse
import logging
import re
import sys

from fisheye_ep_calib.plain_text import one_line

# Parameters of functions that options do not have the name of.
_OPTIONS = {"topics": "--topic NAME=TOPIC", "target": "--target TARGET.yaml"}


class _Stderr(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        print(self.format(record), file=sys.stderr)

    def format(self, record: logging.LogRecord) -> str:
        label = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        return f"{label}{one_line(record.getMessage())}"


_stderr = _Stderr()


def show_messages() -> None:
    """Have what the package logs on stderr, from information on."""
    logger = logging.getLogger("fisheye_ep_calib")
    logger.setLevel(logging.INFO)
    logger.addHandler(_stderr)  # once, however often it is added


def with_options(message: str, arguments: argparse.Namespace | None) -> str:
    """A message in which parameters, which it names in backticks, are the options that set them."""

    def option(match: re.Match[str]) -> str:
        name = match[1]
        if name == "every" and getattr(arguments, "all", False):
            return "--all"
        return _OPTIONS.get(name, f"--{name.replace('_', '-')}")

    if hasattr(arguments, "max_moments"):
        message = message.replace("`max_views`, `every`", "`max_moments`")
    return re.sub(r"`([a-z][a-z_]*)`", option, message)
