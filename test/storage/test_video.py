"""Images recorded as video: read where PyAV is there, named for what they are where it is not."""

from __future__ import annotations

import pickle
import sys
from fractions import Fraction

import numpy as np
import pytest
from bag_writers import START_NS, images, messages, write_mcap
from mcap.writer import CompressionType, Writer

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.storage.messages import _typestore
from fisheye_ep_calib.storage.recording import choose_topics, open_recording
from fisheye_ep_calib.storage.sources.base import COMPRESSED_IMAGE
from fisheye_ep_calib.storage.video import FFMPEG_PACKET, FOXGLOVE_VIDEO, what_to_do

av = pytest.importorskip("av")
COUNT = 24


def smooth(number: int) -> np.ndarray:
    v, u = np.mgrid[:96, :128]
    return (120 + 60 * np.sin((u + 3 * number) / 20) + 40 * np.cos(v / 15)).astype(np.uint8)


def packets(codec: str, **options: str) -> list[bytes]:
    """One packet a picture, a key frame every eight."""
    encoder = av.VideoCodecContext.create(codec, "w")
    encoder.width, encoder.height, encoder.pix_fmt = 128, 96, "yuv420p"
    encoder.time_base, encoder.gop_size = Fraction(1, 30), 8
    encoder.options = {"crf": "10", **options}
    found = []
    for number in range(COUNT):
        frame = av.VideoFrame.from_ndarray(smooth(number), format="gray").reformat(format="yuv420p")
        frame.pts = number
        found += [bytes(packet) for packet in encoder.encode(frame)]
    return found + [bytes(packet) for packet in encoder.encode(None)]


H264 = packets("libx264", tune="zerolatency")
H265 = packets("libx265", tune="zerolatency", **{"x265-params": "log-level=none:keyint=8"})


def write(path, kind: str, codec: str, data: list[bytes], topic: str = "/cam/video"):
    store = _typestore("cdr")
    types = store.types
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b"#"))
        for number, packet in enumerate(data):
            stamp = START_NS + number * 10**8
            time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            header = types["std_msgs/msg/Header"](time, "cam")
            content = np.frombuffer(packet, np.uint8)
            message = {
                FOXGLOVE_VIDEO: lambda t=time, c=content: types[FOXGLOVE_VIDEO](t, "cam", c, codec),
                FFMPEG_PACKET: lambda h=header, c=content: types[FFMPEG_PACKET](h, 128, 96, codec, 0, 0, False, c),
                COMPRESSED_IMAGE: lambda h=header, c=content: types[COMPRESSED_IMAGE](h, codec, c),
            }[kind]()
            writer.add_message(channel, stamp, bytes(store.serialize_cdr(message, kind)), stamp)
        writer.finish()
    return path


def assert_pictures(recording, order) -> None:
    for number in order:
        found = recording.frame("/cam/video", number).image()
        assert found.shape == (96, 128) and np.abs(found.astype(int) - smooth(number)).mean() < 3


@pytest.mark.parametrize(
    "kind, codec, data",
    [
        (FOXGLOVE_VIDEO, "h264", H264),
        (FOXGLOVE_VIDEO, "h265", H265),
        (FFMPEG_PACKET, "libx264", H264),
        (FFMPEG_PACKET, "hevc_nvenc", H265),
        (COMPRESSED_IMAGE, "h264", H264),
    ],
)
def test_frames_in_any_order(tmp_path, kind, codec, data) -> None:
    with open_recording(write(tmp_path / "a.mcap", kind, codec, data)) as recording:
        assert_pictures(recording, range(COUNT))
        assert_pictures(recording, [23, 3, 4, 9, 8, 0, 17])
        assert recording.frame("/cam/video", 2).taken_ns == START_NS + 2 * 10**8
        picture = pickle.loads(pickle.dumps(recording)).frame("/cam/video", 12).picture()
        assert picture.encoding == "bgr8" and picture.samples.shape == (96, 128, 3)


def test_damage_costs_what_builds_on_it_and_no_more(tmp_path) -> None:
    data = [*H264]
    data[8] = data[8][:40]
    lost = 0
    with open_recording(write(tmp_path / "a.mcap", FOXGLOVE_VIDEO, "h264", data)) as recording:
        assert_pictures(recording, [*range(8), *range(16, 24)])
        for number in range(8, 16):
            try:
                recording.frame("/cam/video", number).image()
            except InputError as error:
                assert "\n" not in str(error)
                lost += 1
    assert lost >= 1


def test_a_recording_that_begins_between_key_frames(tmp_path) -> None:
    with open_recording(write(tmp_path / "a.mcap", FOXGLOVE_VIDEO, "h264", H264[3:])) as recording:
        with pytest.raises(InputError, match="what it builds on is missing|damaged"):
            recording.frame("/cam/video", 1).image()
        assert np.abs(recording.frame("/cam/video", 6).image().astype(int) - smooth(9)).mean() < 3


def test_garbage_is_one_line(tmp_path) -> None:
    data = [bytes(np.random.default_rng(i).integers(0, 256, 300, dtype=np.uint8)) for i in range(4)]
    for kind, codec in ((FOXGLOVE_VIDEO, "h264"), (FFMPEG_PACKET, "what"), (FOXGLOVE_VIDEO, "av1")):
        with open_recording(write(tmp_path / "a.mcap", kind, codec, data)) as recording:
            for number in (2, 0):
                with pytest.raises(InputError) as raised:
                    recording.frame("/cam/video", number).image()
                assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "kind, said",
    [
        (FOXGLOVE_VIDEO, "-p in_transport:=foxglove"),
        (FFMPEG_PACKET, "-r in/ffmpeg:=/cam/video"),
        (COMPRESSED_IMAGE, "record them as raw or JPEG"),
    ],
)
def test_without_the_package_it_is_named(tmp_path, monkeypatch, kind, said) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with open_recording(write(tmp_path / "a.mcap", kind, "h264", H264)) as recording:
        with pytest.raises(InputError) as raised:
            recording.frame("/cam/video", 2).image()
    assert said in str(raised.value) and "H.264 video" in str(raised.value)
    assert "fisheye_ep_calib[video]" in str(raised.value) and "\n" not in str(raised.value)


def test_names_from_outside_stay_names() -> None:
    assert "$(" not in what_to_do("h264", FFMPEG_PACKET, "/cam;$(rm x)")


def test_images_are_preferred_to_the_video_beside_them(tmp_path) -> None:
    write(tmp_path / "a.mcap", FOXGLOVE_VIDEO, "h264", H264)
    write_mcap(tmp_path / "b.mcap", messages(images(3)))
    with open_recording([tmp_path / "a.mcap", tmp_path / "b.mcap"]) as recording:
        assert choose_topics(recording) == ("/camera/image_raw",)
        assert choose_topics(recording, ["/cam/video"]) == ("/cam/video",)
