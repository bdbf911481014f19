"""A camera or a rig in another program's format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from fisheye_ep_calib.arguments import positive_length
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.formats import FORMATS, PlacedCamera
from fisheye_ep_calib.outside import checked_path
from fisheye_ep_calib.pipeline.known_camera import AnyCamera, known_camera
from fisheye_ep_calib.pipeline.writing import refuse_existing
from fisheye_ep_calib.storage.atomic import atomic_write


@dataclass(frozen=True)
class Exported:
    """paths: of the files written. words: what they say of themselves, what they lose among it."""

    paths: tuple[Path, ...]
    words: tuple[str, ...]


def writable_formats() -> list[str]:
    """Names of the formats that ``export`` knows."""
    return [name for name, foreign in FORMATS.items() if foreign.write is not None]


def export(
    camera: AnyCamera,
    to: str,
    output: str | PathLike[str],
    *,
    svp_distance: float | None = None,
    overwrite: bool = False,
) -> Exported:
    """Write a camera, or the cameras of a rig file, as another program reads them.

    Args:
        camera: A camera alone, a calibration, a camera file, or the path of a camera or rig file.
        to: A format's name.
        output: The file; formats that want several put a camera's name into its name.
        svp_distance: Metres, for which a camera with one viewpoint is to be right; by default that of the camera file.
        overwrite: Replace files that are there.

    Returns:
        The files, and what the format could not say.

    Raises:
        InputError: The camera or an argument cannot be used.
        CalibrationError: The file cannot be written.
    """
    if to not in writable_formats():
        raise InputError(f"unknown format {to!r}; known: {', '.join(writable_formats())}")
    if svp_distance is not None:
        svp_distance = positive_length(svp_distance, "svp_distance")
    output = checked_path(output, "output")
    cameras, chosen = placed_cameras(camera, svp_distance), FORMATS[to]
    if chosen.most_cameras is not None and len(cameras) > chosen.most_cameras:
        raise InputError(f"{to} holds {chosen.most_cameras} cameras at most, this rig has {len(cameras)}")
    if chosen.write is None:
        raise InputError(f"{to} is read, not written")

    def named(added: str) -> str:
        own = Path(added).suffix in (".json", ".txt")  # an ending that its reader expects
        return f"{output.stem}{added}" if own else f"{output.stem}{added}{output.suffix}"

    written = chosen.write(cameras, named)
    paths = tuple(output.with_name(named(added)) for added in written.files)
    refuse_existing(list(paths), overwrite)
    for path, text in zip(paths, written.files.values(), strict=True):
        atomic_write(path, text.encode())
    return Exported(paths, written.words)


def placed_cameras(camera: AnyCamera, svp_distance: float | None = None) -> Sequence[PlacedCamera]:
    """The cameras of a rig file where they are, the reference first; or one camera."""
    from fisheye_ep_calib.storage.rig_file import is_rig_file  # what calibrates rigs takes long to load

    if isinstance(camera, str | PathLike) and is_rig_file(Path(camera)):
        return _of_rig(Path(camera), svp_distance)
    file = known_camera(camera)
    return [PlacedCamera(file.name, file.camera, svp_distance or file.stand_in_distance)]


def _of_rig(path: Path, svp_distance: float | None) -> list[PlacedCamera]:
    from fisheye_ep_calib.storage.rig_file import load_rig

    rig = load_rig(path)
    names = sorted(rig.reference_from_camera, key=lambda name: name != rig.reference)
    number = {name: index for index, name in enumerate(names)}
    missing = [name for name in names if not rig.camera_files[name]]
    if missing:
        raise InputError(f"{path} names no camera_file for {', '.join(missing)}")
    cameras = []
    for name in names:
        file = known_camera(path.parent / rig.camera_files[name])
        beside = {other for pair in rig.overlaps if name in pair for other in pair if other != name}
        cameras.append(
            PlacedCamera(
                name,
                file.camera,
                svp_distance or file.stand_in_distance,
                np.linalg.inv(rig.reference_from_camera[names[0]]) @ rig.reference_from_camera[name],
                rig.topics.get(name, ""),
                tuple(sorted(number[other] for other in beside if other in number)),
            )
        )
    return cameras
