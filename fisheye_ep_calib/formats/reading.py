"""A camera out of another program's file, whatever it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.camera.limits import refuse_absurd
from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.formats import FORMATS, Format
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera
from fisheye_ep_calib.plain_text import one_line, shown

_MOST_CAMERAS = 64
_MARGIN = 0.03  # rad beyond the image's corners, for poses that are still on their way


def recognised(text: str) -> Format | None:
    """The format of a file's text, or None: then it may be a file of this package's."""
    for format in FORMATS.values():
        if format.recognises is not None and format.recognises(text):
            return format
    return None


def read_foreign(text: str, format: Format, chosen: str = "") -> ForeignCamera:
    """The one camera of a text, or the one of this name. Its theta_max is what the image's corners see.

    Raises InputError.
    """
    cameras = foreign_cameras(text, format)
    if not chosen and len(cameras) == 1:
        return cameras[0]
    named = [foreign for foreign in cameras if foreign.name == chosen]
    if not named:
        names = ", ".join(one_line(foreign.name, 60) for foreign in cameras)
        told = f"no camera is called {shown(chosen)}" if chosen else "several cameras are in it"
        raise InputError(f"{told}: add one of {names} to the file's name, as in FILE:{one_line(cameras[0].name, 60)}")
    return named[0]


def foreign_cameras(text: str, format: Format) -> list[ForeignCamera]:
    """All cameras of a text. Raises InputError."""
    with _as_input_error(format):
        if format.read is None:
            raise InputError("it is written, not read")
        cameras = format.read(text)
        if not 0 < len(cameras) <= _MOST_CAMERAS:
            raise InputError(f"{len(cameras)} cameras are in it")
        for foreign in cameras:
            refuse_absurd(foreign.camera)
        return [replace(foreign, camera=_within_image(foreign.camera)) for foreign in cameras]


@contextmanager
def _as_input_error(format: Format) -> Iterator[None]:
    """Whatever a stranger's file does to its reader is told in one line."""
    try:
        yield
    except InputError as error:
        raise InputError(f"as {format.summary}: {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, IndexError, RecursionError) as error:
        what = f"{shown(error.args[0])} is missing" if isinstance(error, KeyError) else one_line(first_line(error), 200)
        raise InputError(f"as {format.summary}: {what}") from None


def _within_image(camera: FisheyeCamera) -> FisheyeCamera:
    """The camera up to what its image shows: what its calibration saw is not known."""
    width, height = camera.image_size
    u, v = np.linspace(-0.5, width - 0.5, 25), np.linspace(-0.5, height - 0.5, 25)
    edge = np.concatenate([np.stack(np.broadcast_arrays(u, end), axis=-1) for end in (v[0], v[-1])])
    sides = np.concatenate([np.stack(np.broadcast_arrays(end, v), axis=-1) for end in (u[0], u[-1])])
    _, directions, valid = camera.unproject(np.concatenate([edge, sides]))
    if not valid.all():
        return replace(camera, theta_max=camera.theta_limit) if camera.theta_limit > 0 else camera
    angle = float(np.arccos(np.clip(directions[:, 2], -1, 1)).max())
    return replace(camera, theta_max=min(angle + _MARGIN, camera.theta_limit))


def stand_in_of(camera: FisheyeCamera) -> FisheyeCamera:
    """The camera that a reader of CameraInfo gets: a Kannala–Brandt one without extras, by fit where it is another."""
    if camera.lens == "kannala_brandt" and not camera.extras and not camera.coefficients:
        return camera
    from fisheye_ep_calib.calibration.assessing.stand_in import single_viewpoint

    return single_viewpoint(camera).camera


def origin(foreign: ForeignCamera, format: Format) -> str:
    """Where a camera comes from, in words."""
    turned = float(np.degrees(np.arccos(np.clip(foreign.file_from_camera[2, 2], -1, 1))))
    frame = f"; its optical axis is turned by {turned:.3f}° in the file's frame" if turned > 1e-9 else ""
    return f"{format.summary}: {one_line(foreign.model, 60)}{frame}"
