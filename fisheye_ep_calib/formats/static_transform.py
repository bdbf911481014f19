"""A rig as commands for tf2_ros's static_transform_publisher, one a camera, with the reference camera as the parent.

Frames are called NAME_optical_frame: x right, y down, z forward (REP 103). The transform given is the parent from the
child, as tf has it. (tf2_ros, static_transform_broadcaster_program.cpp.)
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, floats, rotation_quaternion


def frame_of(camera: str) -> str:
    """What a camera's frame is called in tf where no image tells."""
    return f"{camera}_optical_frame"


def several(cameras: Sequence[PlacedCamera]) -> Sequence[PlacedCamera]:
    """Raises InputError where one camera alone has no place."""
    if len(cameras) < 2:
        raise InputError("one camera alone has no place: give the file of a rig")
    return cameras


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """A shell script; its lines run until they are ended."""
    parent = several(cameras)[0].name
    words = (f"frames NAME_optical_frame: x right, y down, z forward; the parent is {frame_of(parent)}",)
    lines = ["#!/bin/sh", *(f"# {line}" for line in words)]
    for placed in cameras[1:]:
        values = [*floats(placed.reference_from_camera[:3, 3]), *rotation_quaternion(placed.reference_from_camera)]
        named = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), values, strict=True)
        numbers = [f"--{name} {value!r}" for name, value in named]
        frames = f"--frame-id {shlex.quote(frame_of(parent))} --child-frame-id {shlex.quote(frame_of(placed.name))}"
        lines.append(f"ros2 run tf2_ros static_transform_publisher {' '.join(numbers)} {frames} &")
    return Written({"": "\n".join([*lines, "wait", ""])}, words)


STATIC_TRANSFORM = Format(
    "static_transform", "a script of tf2_ros's static_transform_publisher, of a rig", write, places_only=True
)
