"""Images in a tar archive, such as the ``calibrationdata.tar.gz`` of camera_calibration, unpacked to a folder.

Members are regular files with an image's ending. They are written under names made of theirs, below the folder given;
links, devices and whatever leads out of the folder are never made.
"""

from __future__ import annotations

import io
import lzma
import os
import re
import shutil
import tarfile
import zlib
from pathlib import Path, PurePosixPath

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.outside import open_outside
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.storage.budget import Budget, Spent
from fisheye_ep_calib.storage.compression import SPARE_BYTES, UnpackedStream
from fisheye_ep_calib.storage.sources.image_files import MAX_FILE_BYTES, SUFFIXES

ENDINGS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tbz2", ".tar.xz", ".txz")
_MOST_MEMBERS = 200_000
_MOST_HEADER_BYTES = 2**16  # of a long name or extended attributes, which are read into memory
_DEEPEST = 6
_LONGEST = 100  # characters of a name
_BLOCK = 2**18
_DAMAGE = (Spent, tarfile.TarError, EOFError, zlib.error, lzma.LZMAError, OSError, ValueError, RecursionError)


class _BoundedMember(tarfile.TarInfo):
    """A member whose header may not ask for memory without end."""

    @classmethod
    def frombuf(cls, buf: bytes | bytearray, encoding: str, errors: str) -> _BoundedMember:
        member = super().frombuf(buf, encoding, errors)
        extended = (tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE, *tarfile.GNU_TYPES)
        if member.type in extended and member.type != tarfile.GNUTYPE_SPARSE and member.size > _MOST_HEADER_BYTES:
            raise tarfile.ReadError("a header is too long")
        return member


def is_archive(path: Path) -> bool:
    return path.name.lower().endswith(ENDINGS)


def archive_stem(path: Path) -> str:
    """calibrationdata, of calibrationdata.tar.gz."""
    ending = max((suffix for suffix in ENDINGS if path.name.lower().endswith(suffix)), key=len, default="")
    return path.name[: len(path.name) - len(ending)] or "images"


def unpack_images(archive: Path, folder: Path, problems: list[str], budget: Budget) -> None:
    """Write the images of a tar archive to an empty folder, which is made. problems: what of them is lost, in words.

    Raises InputError where it holds none, is no archive, or the disk would fill up.
    """
    folder.mkdir()
    budget.grow(archive.stat().st_size)
    room = shutil.disk_usage(folder).free - SPARE_BYTES
    count = members = 0
    try:
        with (
            open_outside(archive) as packed,
            io.BufferedReader(UnpackedStream(packed, budget), _BLOCK) as unpacked,
            tarfile.open(fileobj=unpacked, mode="r|", tarinfo=_BoundedMember) as content,
        ):
            for member in content:
                members += 1
                room -= max(member.size, 0) + 512
                budget.take(max(member.size, 0) if member.issparse() else 0)  # its gaps are in no byte of the archive
                if room < 0 or members > _MOST_MEMBERS:
                    raise InputError(f"{archive}: no room to unpack it in {folder.parent}; set TMPDIR to a larger disk")
                place = _place(member.name)
                if member.isreg() and place is not None and 0 <= member.size <= MAX_FILE_BYTES:
                    count += _write(content, member, folder / place)
                    budget.enter()
    except _DAMAGE as error:
        if count == 0:
            problem = one_line(first_line(error), 200)
            raise InputError(f"{archive} is not a tar archive, or is damaged ({problem})") from None
        reason = str(error) if isinstance(error, Spent) else "cut short or damaged"
        problems.append(f"{archive}: {reason}; the {count} images before that are used")
    if count == 0:
        raise InputError(f"{archive} holds no images")


def _place(name: str) -> Path | None:
    """Where below the folder to write a member; None where it is no image, or hidden, or too deep."""
    parts = [part for part in PurePosixPath(name).parts if part not in ("/", ".", "..")]
    if not parts or len(parts) > _DEEPEST or any(part.startswith(".") for part in parts):
        return None
    if PurePosixPath(parts[-1]).suffix.lower() not in SUFFIXES:
        return None
    return Path(*(re.sub(r"[^\w. ()+=,@-]", "_", part)[-_LONGEST:] for part in parts))


def _write(content: tarfile.TarFile, member: tarfile.TarInfo, path: Path) -> bool:
    """Copy a member's bytes to a new file; False where one of that name is there already."""
    path.parent.mkdir(parents=True, exist_ok=True)
    source = content.extractfile(member)
    if source is None or os.path.lexists(path):
        return False
    with source, open(path, "xb") as file:
        shutil.copyfileobj(source, file, _BLOCK)
    return True
