"""Reading the .npz of somebody else: bounded, nothing unpickled, and every fault in one line."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np

from fisheye_ep_calib.errors import InputError, first_line

# Far above any calibration (a million point measurements take 40 MB), far below what would exhaust a machine.
_MOST_BYTES = 2**29


def read_npz(
    path: str | PathLike[str], required: Sequence[str], optional: Sequence[str], kind: str
) -> dict[str, np.ndarray]:
    """The known keys of the file; nothing larger than its declared size is read.

    kind: what the file should be, for the error. Raises InputError.
    """
    path = Path(path)
    if not path.exists():
        raise InputError(f"{path} does not exist")
    if not path.is_file():
        raise InputError(f"{path} is not a file")
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            for key in (*required, *optional):
                if f"{key}.npy" in names:
                    arrays[key] = _read_array(archive, key)
    except zipfile.BadZipFile:
        raise InputError(f"{path} is not an .npz file, or is cut short") from None
    except (OSError, EOFError, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    missing = [key for key in required if key not in arrays]
    if missing:
        raise InputError(f"{path} has no {', '.join(missing)}; {kind} needs {', '.join(required)}")
    return arrays


def _read_array(archive: zipfile.ZipFile, key: str) -> np.ndarray:
    information = archive.getinfo(f"{key}.npy")
    if information.file_size > _MOST_BYTES:
        raise InputError(f"{archive.filename}: {key} declares {information.file_size} bytes, too many")
    content = archive.read(information)
    try:
        return np.lib.format.read_array(_checked_array(content), allow_pickle=False)
    except (ValueError, TypeError, SyntaxError, MemoryError, EOFError) as error:
        raise InputError(f"{archive.filename}: {key} cannot be read: {first_line(error)}") from None


def _checked_array(content: bytes) -> io.BytesIO:
    """The array's bytes, once its header has been found to promise no more than is there."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is not None:
        shape, _, dtype = read_header(file)
        if not dtype.hasobject and math.prod(int(length) for length in shape) * dtype.itemsize > len(content):
            raise ValueError(f"its header promises {shape}, more than the file holds")
    file.seek(0)
    return file
