"""Serialized image messages, of ROS 2 (CDR) and ROS 1, to objects.

Both image types have kept their fields since ROS 1, so the definitions a bag carries or lacks do not matter.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.plain_text import one_line

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

Message: TypeAlias = Any  # rosbags and rclpy each make the classes of messages from their definitions

_OTHER_TYPES = {  # that ROS itself does not have
    "foxglove_msgs/msg/CompressedVideo": "builtin_interfaces/Time timestamp\nstring frame_id\n"
    "uint8[] data\nstring format",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "std_msgs/Header header\nint32 width\nint32 height\n"
    "string encoding\nuint64 pts\nuint8 flags\nbool is_bigendian\nuint8[] data",
}


@lru_cache(maxsize=2)
def _typestore(encoding: str) -> Typestore:
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ModuleNotFoundError:
        raise InputError("reading bags needs the Python package rosbags: pip install rosbags") from None
    store = get_typestore(Stores.ROS2_JAZZY if encoding == "cdr" else Stores.ROS1_NOETIC)
    for type_name, definition in _OTHER_TYPES.items():
        store.register(get_types_from_msg(definition, type_name))
    return store


def deserialize(content: bytes, type_name: str, encoding: str) -> Message:
    """A message of ``type_name`` from its bytes; encoding "cdr" or "ros1". Raises InputError.

    By the package rosbags, or where that is missing by ROS itself.
    """
    try:
        store = _typestore(encoding)
    except InputError:
        if encoding != "cdr" or type_name in _OTHER_TYPES or not _has_ros():
            raise
        return _deserialize_by_ros(content, type_name)
    read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    try:
        return read(content, type_name)
    except Exception as error:  # generated code over damaged bytes fails in every way there is
        raise InputError(f"the message is damaged ({first_line(error)})") from None


def _has_ros() -> bool:
    try:
        importlib.import_module("rclpy.serialization")
    except ImportError:
        return False
    return True


def _deserialize_by_ros(content: bytes, type_name: str) -> Message:
    """By rclpy, with the class of the message that ROS has installed."""
    package, _, name = type_name.partition("/msg/")
    try:
        kind = getattr(importlib.import_module(f"{package}.msg"), name)
        return importlib.import_module("rclpy.serialization").deserialize_message(content, kind)
    except Exception as error:  # C++ over damaged bytes
        raise InputError(f"the message is damaged ({one_line(first_line(error), 200)})") from None
