"""The one error hierarchy: the command line and the nodes turn each into one clear line."""

from fisheye_ep_calib.plain_text import one_line


class CalibrationError(Exception):
    """A calibration that could not be made; the message says why and what to do next. Exit code 1.

    The message is one line of bounded length, whatever name or value from outside it repeats.
    """

    exit_code = 1

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(message))


class Interrupted(CalibrationError):
    """The user ended the work; the message says what is kept. Exit code 130, as shells have it."""

    exit_code = 130


class InputError(CalibrationError):
    """Input that cannot be used: wrong arguments, an unreadable bag, file or message. Exit code 2."""

    exit_code = 2


def first_line(error: BaseException) -> str:
    """What another program's error says, in one line; its type where it says nothing."""
    return (str(error).splitlines() or [type(error).__name__])[0]
