"""Reading the .npz of somebody else: bounded, nothing unpickled, and every fault in one line."""

from __future__ import annotations

import io
import math
import os
import zipfile
from collections.abc import Sequence
from os import PathLike

import numpy as np

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.outside import checked_path, open_outside
from fisheye_ep_calib.plain_text import one_line

# Of all arrays, unpacked. Far above any calibration (a million sightings take 40 MB), far below a machine's memory.
_MOST_BYTES = 2**27
_MOST_HEADER_BYTES = 2**16
_MOST_AXES = 2
_KINDS = "biufUS"
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_npz(
    path: str | PathLike[str], required: Sequence[str], optional: Sequence[str], kind: str
) -> dict[str, np.ndarray]:
    """The known keys of the file: numbers and texts of one or two axes, 128 MiB of them at most.

    kind: what the file should be, for the error. Raises InputError.
    """
    path = checked_path(path, "path")
    shown = one_line(path)
    if not os.path.exists(path):  # of a name that no file can have, too
        raise InputError(f"{shown} does not exist")
    if not os.path.isfile(path):
        raise InputError(f"{shown} is not a file")
    arrays: dict[str, np.ndarray] = {}
    room = _MOST_BYTES
    try:
        with open_outside(path) as file, zipfile.ZipFile(file) as archive:
            names = set(archive.namelist())
            for key in (*required, *optional):
                if f"{key}.npy" in names:
                    arrays[key] = _array(archive, key, room)
                    room -= arrays[key].nbytes
    except InputError as error:
        raise InputError(f"{shown}: {error}") from None
    except zipfile.BadZipFile:
        raise InputError(f"{shown} is not an .npz file, or is cut short") from None
    except Exception as error:  # damaged archives lead zipfile to every error there is
        raise InputError(f"{shown} cannot be read: {one_line(first_line(error), 200)}") from None
    missing = [key for key in required if key not in arrays]
    if missing:
        raise InputError(f"{shown} has no {', '.join(missing)}; {kind} needs {', '.join(required)}")
    return arrays


def _array(archive: zipfile.ZipFile, key: str, room: int) -> np.ndarray:
    """One member; ``room``: bytes that it may unpack to. Raises InputError, and what zipfile raises."""
    member = archive.getinfo(f"{key}.npy")
    if member.compress_type not in _METHODS:
        raise InputError(f"{key} is packed in a way that numpy does not write (zip method {member.compress_type})")
    with archive.open(member) as packed:
        start = packed.read(_MOST_HEADER_BYTES)
        try:
            shape, fortran_order, dtype, begin = _header(start)
            count = _checked_count(shape, dtype, room)
        except Exception as error:  # the header is Python, which damage turns into anything
            raise InputError(f"{key} cannot be read: {one_line(first_line(error), 200)}") from None
        content = start[begin:] + packed.read(max(0, begin + count * dtype.itemsize - len(start)))
        rest = packed.read(1)  # the checksum is looked at where the member ends
    if len(content) != count * dtype.itemsize or rest:
        wrong = "less" if rest else "more"
        raise InputError(f"{key} cannot be read: its header promises {shape}, {wrong} than the file holds")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran_order else "C")


def _header(start: bytes) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Shape, order, type and where the data begins, of the array file that begins so. Raises ValueError."""
    file = io.BytesIO(start)
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return (*np.lib.format.read_array_header_1_0(file), file.tell())
    if version == (2, 0):
        return (*np.lib.format.read_array_header_2_0(file), file.tell())
    raise ValueError(f"its format is {version}")


def _checked_count(shape: tuple[int, ...], dtype: np.dtype, room: int) -> int:
    """How many items there are, once they are known to be plain, and no more than there is room for."""
    if dtype.hasobject:
        raise ValueError("it holds Python objects, which are not unpickled (allow_pickle=False)")
    if dtype.kind not in _KINDS or dtype.itemsize == 0:
        raise ValueError(f"it holds {dtype}, neither numbers nor texts")
    if len(shape) > _MOST_AXES or any(not 0 <= length <= room for length in shape):
        raise ValueError(f"its header promises {shape}, more than is read")
    count = math.prod(int(length) for length in shape)
    if count * dtype.itemsize > room:
        raise ValueError(f"its header promises {shape}, more than is read")
    return count
