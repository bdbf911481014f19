"""What tells a file from another, at a bounded cost."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import open_outside, read_outside

_WHOLE = 64 << 20  # bytes: a larger file is told by its size, its time of change, its first and its last part
_PART = 1 << 20
_MANY = 16  # files, of which the content would take too long


def fingerprint(path: str | os.PathLike[str]) -> str | None:
    """ "sha256:…" of a file's content, or "partial-sha256:…" of a large one; a folder's is of its files.

    partial-sha256 covers size, time of change (ns) and the first and last MiB. Of a folder it is taken over the
    name, size and time of change of each file in it. None where there is no such file.
    """
    path = Path(path)
    try:
        if path.is_dir():
            digest = hashlib.sha256()
            for file in sorted(entry for entry in path.rglob("*") if entry.is_file()):
                status = file.stat()
                digest.update(os.fsencode(file.relative_to(path)))
                digest.update(f"\0{status.st_size} {status.st_mtime_ns}\0".encode())
            return f"partial-sha256:{digest.hexdigest()}"
        if path.stat().st_size > _WHOLE:
            return f"partial-sha256:{hashlib.sha256(_partial(path)).hexdigest()}"
        return f"sha256:{hashlib.sha256(read_outside(path, _WHOLE)).hexdigest()}"
    except (OSError, InputError):
        return None


def fingerprint_of_all(paths: Sequence[str | os.PathLike[str]]) -> str | None:
    """``fingerprint`` of one path; of several that of theirs, in their order, partial where one of them is or they are
    many. None where one is not there.
    """
    if len(paths) == 1:
        return fingerprint(paths[0])
    try:
        many = len(paths) > _MANY
        told = [_status_of(Path(path)) if many else fingerprint(path) for path in paths]
    except OSError:
        return None
    if not told or None in told:
        return None
    whole = all(str(hash_text).startswith("sha256:") for hash_text in told)
    return f"{'' if whole else 'partial-'}sha256:{hashlib.sha256(chr(10).join(map(str, told)).encode()).hexdigest()}"


def _status_of(path: Path) -> str:
    status = path.stat()
    return f"{path.name} {status.st_size} {status.st_mtime_ns}"


def _partial(path: Path) -> bytes:
    status = path.stat()
    digest = hashlib.sha256(f"{status.st_size} {status.st_mtime_ns}".encode())
    with open_outside(path) as file:
        digest.update(file.read(_PART))
        file.seek(max(status.st_size - _PART, 0))
        digest.update(file.read(_PART))
    return digest.digest()
