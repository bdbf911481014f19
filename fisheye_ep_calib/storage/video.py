"""Images that were recorded as video: which codec a message holds, and frames decoded one after another.

A frame of video is the difference to frames before it. To decode one, its packets are fed from the last key frame on;
who asks for one frame after another pays for each once. Decoding needs PyAV, the extra ``video``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.storage.image_header import MAX_PIXELS_OF_FEW_BYTES, check_size
from fisheye_ep_calib.storage.messages import Message

if TYPE_CHECKING:
    from av.video.codeccontext import VideoCodecContext
    from av.video.frame import VideoFrame

FOXGLOVE_VIDEO = "foxglove_msgs/msg/CompressedVideo"
FFMPEG_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
VIDEO_TYPES = (FOXGLOVE_VIDEO, FFMPEG_PACKET)
_TRANSPORTS = {FOXGLOVE_VIDEO: "foxglove", FFMPEG_PACKET: "ffmpeg"}

_CODECS = (("264", "h264"), ("265", "hevc"), ("hevc", "hevc"), ("vp9", "vp9"), ("vp8", "vp8"), ("av1", "av1"))
_NAMES = {"h264": "H.264", "hevc": "H.265", "vp9": "VP9", "vp8": "VP8", "av1": "AV1"}
_UNIT_START = re.compile(rb"\x00\x00\x01(.)", re.DOTALL)
_KEY_UNITS = {"h264": {5}, "hevc": {16, 17, 18, 19, 20, 21}}
_SEARCHED = 2**16  # bytes of a packet in which a key frame's unit must begin
_MOST_BACK = 3000  # packets between key frames
_MOST_DELAY = 32  # packets that a decoder holds back


class Packet(NamedTuple):
    """codec: as FFmpeg calls it."""

    codec: str
    data: bytes
    key: bool


def packet_of(message: Message, type_name: str) -> Packet | None:
    """The packet of video in a message; None where it is a CompressedImage of a picture. Raises InputError."""
    encoding = str(message.encoding if type_name == FFMPEG_PACKET else message.format).lower()
    codec = next((codec for word, codec in _CODECS if word in encoding), None)
    if codec is None:
        if type_name not in VIDEO_TYPES:
            return None
        raise InputError(f"the video's codec {shown(encoding[:20])} is not known")
    data = bytes(message.data)
    return Packet(codec, data, _is_key(data, codec))


def _is_key(data: bytes, codec: str) -> bool:
    """Whether decoding can begin here: an IDR or random-access unit among those of the packet (Annex B)."""
    if codec not in _KEY_UNITS:
        return False
    kinds = (match[1][0] for match in _UNIT_START.finditer(data[:_SEARCHED]))
    return any((kind >> 1 & 0x3F if codec == "hevc" else kind & 0x1F) in _KEY_UNITS[codec] for kind in kinds)


def what_to_do(codec: str, type_name: str, topic: str) -> str:
    """That the images are video, and the command that turns them into images."""
    transport = _TRANSPORTS.get(type_name)
    base = re.sub(r"[^\w/]", "_", topic)
    told = (
        f"the images of {base} are {_NAMES.get(codec, codec)} video, which is read with PyAV: "
        "pip install 'fisheye_ep_calib[video]'; or "
    )
    if transport is None:
        return f"{told}record them as raw or JPEG images"
    return (
        f"{told}turn them into images, while the bag is played and {base}/raw recorded: ros2 run image_transport "
        f"republish --ros-args -p in_transport:={transport} -p out_transport:=raw -r in/{transport}:={base} "
        f"-r out:={base}/raw"
    )


class VideoDecoder:
    """Decodes the frames of one topic. read: a packet by its number; count: how many there are."""

    def __init__(self, read: Callable[[int], Packet], count: int, topic: str, type_name: str) -> None:
        self._read = read
        self._count = count
        self._topic = topic
        self._type = type_name
        self._context: VideoCodecContext | None = None
        self._fed = 0  # the next packet to feed
        self._frames: dict[int, VideoFrame] = {}

    def frame(self, number: int) -> VideoFrame:
        """The frame of that packet. Raises InputError where it cannot be decoded."""
        if number in self._frames:
            return self._frames[number]
        start = self._start(number)
        if start is not None:
            self._restart(start)
        last = min(self._count, number + _MOST_DELAY)
        while number not in self._frames and self._fed < last:
            self._feed(self._read(self._fed), self._fed)
            self._fed += 1
        if number not in self._frames and self._fed >= self._count:
            self._feed(None, 0)
        if number not in self._frames:
            raise InputError("the frame of video cannot be decoded: what it builds on is missing")
        return self._frames[number]

    def _start(self, number: int) -> int | None:
        """The packet to begin with; None to go on with the one after the last that was fed."""
        going_on = self._context is not None and self._fed <= number
        for packet in range(number, max(self._fed if going_on else 0, number - _MOST_BACK) - 1, -1):
            if self._read(packet).key:
                return None if going_on and packet == self._fed else packet
        return None if going_on else max(0, number - _MOST_BACK)

    def _restart(self, number: int) -> None:
        packet = self._read(number)
        try:
            import av
        except ModuleNotFoundError:
            raise InputError(what_to_do(packet.codec, self._type, self._topic)) from None
        context = cast("VideoCodecContext", av.CodecContext.create(packet.codec, "r"))
        context.options = {"max_pixels": str(MAX_PIXELS_OF_FEW_BYTES)}
        context.thread_count = 1
        self._context = context
        self._fed = number
        self._frames = {}

    def _feed(self, packet: Packet | None, number: int) -> None:
        import av

        assert self._context is not None
        try:
            if packet is None:
                frames = self._context.decode(None)
            else:
                content = av.Packet(packet.data)
                content.pts = content.dts = number
                frames = self._context.decode(content)
        except (av.FFmpegError, EOFError, ValueError) as error:
            if packet is None:
                return
            raise InputError(f"the frame of video is damaged ({first_line(error)})") from None
        finally:
            if packet is None:
                self._context = None
        for frame in frames:
            if frame.pts is not None and not frame.is_corrupt:
                self._frames[int(frame.pts)] = frame
        for old in sorted(self._frames)[: -2 * _MOST_DELAY]:
            del self._frames[old]


def grey_of(frame: VideoFrame) -> np.ndarray:
    """(h, w) uint8, full range."""
    check_size(frame.width, frame.height, frame.width * frame.height)
    return np.ascontiguousarray(frame.to_ndarray(format="gray"))


def colours_of(frame: VideoFrame) -> np.ndarray:
    """(h, w, 3) uint8, blue green red."""
    check_size(frame.width, frame.height, frame.width * frame.height)
    return np.ascontiguousarray(frame.to_ndarray(format="bgr24"))
