"""What a format of another program is here: how it is written, how it is known again, and how it is read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fisheye_ep_calib.formats.foreign_camera import ForeignCamera
from fisheye_ep_calib.formats.placed_camera import PlacedCamera

Named = Callable[[str], str]  # what is added to the output's name, "" for the output itself, to a file's name


class Written(NamedTuple):
    """files: text by what is added to the output's name before its ending, or in place of it where it has its own.

    words: what the files say of themselves, a line each.
    """

    files: dict[str, str]
    words: tuple[str, ...]


@dataclass(frozen=True)
class Format:
    """name: as in ``export --to``. summary: what it is, in a few words. most_cameras: that it can hold. places_only: it
    says where cameras are, and nothing of what they are.

    write: from cameras, the reference first, to texts; and how the files will be called.
    recognises: whether a text is of this format, by its content. read: the cameras of such a text; raises InputError,
    KeyError, TypeError or ValueError where it is not what it seemed.
    A format of one direction leaves the other's functions out.
    """

    name: str
    summary: str
    write: Callable[[Sequence[PlacedCamera], Named], Written] | None = None
    recognises: Callable[[str], bool] | None = None
    read: Callable[[str], list[ForeignCamera]] | None = None
    most_cameras: int | None = None
    places_only: bool = False
