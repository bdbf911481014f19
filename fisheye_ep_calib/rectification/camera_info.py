"""CameraInfo of a rectified image."""

from __future__ import annotations

from fisheye_ep_calib.rectification.projections import PROJECTIONS
from fisheye_ep_calib.rectification.view import View
from fisheye_ep_calib.storage.camera_info import PlainCameraInfo


def rectified_camera_info(view: View) -> PlainCameraInfo:
    """A plain pinhole without distortion for a perspective view.

    For the others the projection's name and zeros, which say "uncalibrated": no CameraInfo describes them, and what
    takes them for a pinhole's must not find numbers to do so with.
    """
    width, height = view.size
    unturned = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    if not PROJECTIONS[view.projection].pinhole:
        return PlainCameraInfo(width, height, view.projection, (), (0.0,) * 9, unturned, (0.0,) * 12)
    focal, (cx, cy) = view.focal, view.centre
    return PlainCameraInfo(
        width,
        height,
        "plumb_bob",
        (0.0,) * 5,
        (focal, 0.0, cx, 0.0, focal, cy, 0.0, 0.0, 1.0),
        unturned,
        (focal, 0.0, cx, 0.0, 0.0, focal, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
    )
