# PYTHON_ARGCOMPLETE_OK
"""The command ``fisheye_ep_calib``: turns errors into one line and an exit code.

It imports next to nothing before ``main`` is in charge, which an interruption may reach at any time.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import warnings

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.plain_text import one_line, plain_streams

TYPE_CHECKING = False  # typing's own would have to be imported
if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence
    from types import FrameType

PROGRAM = "fisheye_ep_calib"
_INTERRUPTED = 130
_OBJECTS = (
    50_000  # made before cycles are looked for: after every 700, as Python does, costs a few percent of a command
)
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code: 0 done, 1 could not, 2 wrong usage or input, 130 Ctrl-C."""
    with plain_streams():
        return _main(arguments)


def _main(arguments: Sequence[str] | None) -> int:
    parsed = None
    try:
        words = sys.argv[1:] if arguments is None else list(arguments)
        if "_ARGCOMPLETE" in os.environ:  # a shell asks, by argcomplete, what may come next
            return _complete()
        if arguments is None:  # the process is this command's own
            _calculate_in_one_thread()
            if not sys.warnoptions:  # NumPy's words on a number out of bounds are not for the user of a command
                warnings.filterwarnings("ignore", category=RuntimeWarning)
            gc.set_threshold(_OBJECTS)
        parser = _parser(words)
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):
                stream.reconfigure(errors="backslashreplace")  # a terminal that knows no θ, a file name that is no text
        parsed = parser.parse_args(words)
        code: int = parsed.run(parsed)
        return code
    except CalibrationError as error:
        return _fail(_in_options(str(error), parsed), error.exit_code)
    except KeyboardInterrupt:
        return _fail("interrupted", _INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _fail(f"{error.filename or ''}: {error.strerror or error}".lstrip(": "), 1)
    except MemoryError:
        return _fail("out of memory", 1)


def _calculate_in_one_thread() -> None:
    """Unless the user has said how many: before NumPy is loaded, which then reads it.

    Matrices are small here, so that further threads wait for each other and take processor time for it; and sums of one
    thread have one order on all machines.
    """
    if not any(name in os.environ for name in _THREADS):
        os.environ.update(dict.fromkeys(_THREADS, "1"))


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """The command line's, with every import that these words take; and signals as the commands want them."""
    in_charge = threading.current_thread() is threading.main_thread()
    if in_charge:
        signal.signal(signal.SIGTERM, _end_at_once)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, _end_at_once)
    try:
        from fisheye_ep_calib.commands.messages import show_messages
        from fisheye_ep_calib.commands.parser import build_parser

        show_messages()
        return build_parser(PROGRAM, words)
    finally:
        if in_charge:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends like Ctrl-C: what was found is kept
            if signal.getsignal(signal.SIGINT) is _end_at_once:
                signal.signal(signal.SIGINT, signal.default_int_handler)


def _complete() -> int:
    """Answer the shell as argcomplete's protocol has it; nothing where argcomplete is not installed."""
    try:
        import argcomplete
    except ImportError:
        return 1
    from fisheye_ep_calib.commands.parser import build_parser

    typed = os.environ.get("COMP_LINE", "").split()[1:]
    argcomplete.autocomplete(build_parser(PROGRAM, typed))  # ends the process
    return 0


def _end_at_once(_signal: int, _frame: FrameType | None) -> None:
    """While modules are imported: they would swallow an exception, or make another one of it."""
    os.write(2, f"{PROGRAM}: error: interrupted\n".encode())
    os._exit(_INTERRUPTED)


def _in_options(message: str, arguments: argparse.Namespace | None) -> str:
    """Errors name the parameters of functions; here they are options."""
    from fisheye_ep_calib.commands.messages import with_options

    return with_options(message, arguments)


def _fail(message: str, code: int) -> int:
    print(f"{PROGRAM}: error: {one_line(message)}", file=sys.stderr)
    return code


def calibrate_bag_main() -> int:
    """``ros2 run fisheye_ep_calib calibrate_bag``: the command calibrate, without what ROS appends."""
    given = sys.argv[1:]
    if "--ros-args" in given:
        given = given[: given.index("--ros-args")]
    return main(["calibrate", *given])
