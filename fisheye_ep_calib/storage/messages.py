"""Serialized image messages, of ROS 2 (CDR) and ROS 1, to objects.

Both image types have kept their fields since ROS 1, so the definitions a bag carries or lacks do not matter.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

from fisheye_ep_calib.errors import InputError, first_line

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
    """A message of ``type_name`` from its bytes; encoding "cdr" or "ros1". Raises InputError."""
    store = _typestore(encoding)
    read = store.deserialize_cdr if encoding == "cdr" else store.deserialize_ros1
    try:
        return read(content, type_name)
    except Exception as error:  # generated code over damaged bytes fails in every way there is
        raise InputError(f"the message is damaged ({first_line(error)})") from None
