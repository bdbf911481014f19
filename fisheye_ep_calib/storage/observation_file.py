"""Observation files (.npz): detected points on disk, to calibrate again without the images."""

from __future__ import annotations

import io
import zipfile
import zlib
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.observations import Observations
from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.storage.atomic import atomic_write

METRES_PER_UNIT = {"mm": 1e-3, "m": 1.0}
REQUIRED = ("object_points", "unit", "image_index", "point_index", "pixels", "image_size")
OPTIONAL = ("weights", "image_names", "split", "disc_radius")

# Far above any calibration (a million sightings take 40 MB), far below what would exhaust a machine.
MAX_ARRAY_BYTES = 2**29
MAX_IMAGES = 10**6
MAX_SIDE = 65535


def load_observations(path: str | PathLike) -> Observations:
    """Read an observation file; lengths become metres. Raises InputError with the path and what is wrong."""
    arrays = _read_arrays(Path(path))
    try:
        return _observations(arrays)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def save_observations(path: str | PathLike, observations: Observations) -> None:
    """Write an observation file in metres, whole or not at all."""
    arrays: dict[str, Any] = {
        "object_points": observations.object_points,
        "unit": np.array("m"),
        "image_index": observations.image_index,
        "point_index": observations.point_index,
        "pixels": observations.pixels,
        "image_size": np.array(observations.image_size, dtype=np.int64),
        "weights": observations.weights,
        "image_names": np.array(observations.image_names, dtype=np.str_),
    }
    if observations.split is not None:
        arrays["split"] = np.asarray(observations.split, dtype=np.str_)
    if observations.disc_radius is not None:
        arrays["disc_radius"] = np.array(observations.disc_radius)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    atomic_write(path, buffer.getvalue())


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The known keys of the file; nothing is unpickled, and nothing larger than its declared size is read."""
    if not path.exists():
        raise InputError(f"{path} does not exist")
    if not path.is_file():
        raise InputError(f"{path} is not a file")
    arrays = {}
    try:
        with zipfile.ZipFile(path) as archive:
            names = set(archive.namelist())
            for key in REQUIRED + OPTIONAL:
                if f"{key}.npy" in names:
                    arrays[key] = _read_array(archive, key)
    except zipfile.BadZipFile:
        raise InputError(f"{path} is not an .npz file, or is cut short") from None
    except (OSError, EOFError, zlib.error, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    missing = [key for key in REQUIRED if key not in arrays]
    if missing:
        raise InputError(f"{path} has no {', '.join(missing)}; an observation file needs {', '.join(REQUIRED)}")
    return arrays


def _read_array(archive: zipfile.ZipFile, key: str) -> np.ndarray:
    information = archive.getinfo(f"{key}.npy")
    if information.file_size > MAX_ARRAY_BYTES:
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
        count = 1
        for length in shape:
            count *= int(length)
        if not dtype.hasobject and count * dtype.itemsize > len(content):
            raise ValueError(f"its header promises {shape}, more than the file holds")
    file.seek(0)
    return file


def _observations(arrays: dict[str, np.ndarray]) -> Observations:
    metres = METRES_PER_UNIT.get(_text(arrays["unit"]))
    if metres is None:
        raise InputError(f'unit must be "mm" or "m", not {_text(arrays["unit"])!r}')
    image_index = _whole_numbers(arrays["image_index"], "image_index")
    if image_index.size and image_index.max() >= MAX_IMAGES:
        raise InputError(f"image_index reaches {image_index.max()}; at most {MAX_IMAGES} images are read")
    image_size = _whole_numbers(arrays["image_size"], "image_size")
    if image_size.shape != (2,) or (image_size < 1).any() or (image_size > MAX_SIDE).any():
        raise InputError(f"image_size must be (width, height) within 1..{MAX_SIDE}")
    disc_radius = None
    if "disc_radius" in arrays:
        radius = _real_numbers(arrays["disc_radius"], "disc_radius")
        if radius.size != 1:
            raise InputError("disc_radius must be one number")
        disc_radius = float(radius.reshape(())) * metres
    weights = arrays.get("weights")
    return Observations.create(
        object_points=_real_numbers(arrays["object_points"], "object_points") * metres,
        image_index=image_index,
        point_index=_whole_numbers(arrays["point_index"], "point_index"),
        pixels=_real_numbers(arrays["pixels"], "pixels"),
        image_size=tuple(int(value) for value in image_size),
        weights=None if weights is None else _real_numbers(weights, "weights"),
        image_names=_texts(arrays.get("image_names"), "image_names"),
        split=_texts(arrays.get("split"), "split"),
        disc_radius=disc_radius,
    )


def _text(array: np.ndarray) -> str:
    """A string stored as an array of any shape with one entry; bytes are taken as UTF-8."""
    if array.size != 1 or array.dtype.kind not in "US":
        return f"an array of shape {array.shape} and type {array.dtype}"
    value = array.reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _texts(array: np.ndarray | None, key: str) -> tuple[str, ...] | None:
    if array is None:
        return None
    if array.ndim != 1 or array.dtype.kind not in "USiu":
        raise InputError(f"{key} must be a list of names, one an image")
    names = array.astype(np.str_) if array.dtype.kind in "iu" else array
    return tuple(_text(name) for name in names)


def _real_numbers(array: np.ndarray, key: str) -> np.ndarray:
    if array.dtype.kind not in "iuf":
        raise InputError(f"{key} must hold numbers, not {array.dtype}")
    return array.astype(float)


def _whole_numbers(array: np.ndarray, key: str) -> np.ndarray:
    numbers = _real_numbers(array, key)
    if numbers.size and not (np.isfinite(numbers) & (numbers == np.round(numbers))).all():
        raise InputError(f"{key} must hold whole numbers")
    if numbers.size and np.abs(numbers).max() > 2**53:
        raise InputError(f"{key} holds numbers that are too large")
    return numbers.astype(np.int64)
