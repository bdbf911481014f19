"""The rectifier among real processes: what it publishes is what the core computes, whatever it is sent."""

from __future__ import annotations

import array
import signal
import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from live_processes import at_this_load, wait_for
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from fisheye_ep_calib.rectification import Rectifier, make_view, rectified_camera_info
from fisheye_ep_calib.storage.camera_file import load_camera, read_camera_file

pytestmark = pytest.mark.live

RELIABLE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
WIDTH, HEIGHT = 320, 240


@pytest.fixture
def camera_file(tmp_path: Path) -> Path:
    path = tmp_path / "front.yaml"
    content = {
        "camera_name": "front",
        "image_width": WIDTH,
        "image_height": HEIGHT,
        "distortion_model": "equidistant",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [91.0, 0, 161.0, 0, 91.0, 118.0, 0, 0, 1]},
        "distortion_coefficients": {"rows": 1, "cols": 4, "data": [0.01, 0.0, 0.0, 0.0]},
        "entrance_pupil": {
            "schema": 1,
            "model": "ep_even",
            "intrinsics": {"fx": 90.0, "fy": 91.0, "skew": 0.1, "cx": 161.3, "cy": 118.2},
            "radial": [0.01, -0.002, 0.0, 0.0],
            "coefficients": [-0.004, -0.0006],
            "theta_max": 1.7,
        },
    }
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture
def start_rectifier(start, camera_file):
    """Starts the node with parameters given as ``name: value``."""

    def begin(*arguments: str, **parameters):
        command = [sys.executable, "-m", "fisheye_ep_calib.ros.rectifier", "--ros-args", *arguments]
        for name, value in {"camera_file": camera_file, "topic": "/front/image_raw", **parameters}.items():
            command += ["-p", f"{name}:={value}"]
        return start(*command)

    return begin


def picture(seed: int = 0) -> np.ndarray:
    """A smooth random image (h, w, 3) uint8."""
    coarse = np.random.default_rng(seed).integers(0, 255, (24, 32, 3), np.uint8)
    return cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def message(samples: np.ndarray, encoding: str, seconds: float = 5.0) -> Image:
    data = array.array("B", np.ascontiguousarray(samples).tobytes())
    height, width = samples.shape[:2]
    image = Image(height=height, width=width, encoding=encoding, step=len(data) // height, data=data)
    stamp(image, seconds)
    return image


def stamp(message, seconds: float) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = int(seconds), round(seconds % 1 * 1e9)
    message.header.frame_id = "front_optical"


def content(image: Image) -> np.ndarray:
    kind = np.uint16 if "16" in image.encoding else np.uint8
    return np.frombuffer(image.data, kind).reshape(image.height, image.width, -1).squeeze()


def keep_sending(publisher, sent, received, condition):
    """Send until something received from now on meets a condition, which is returned."""
    received.clear()

    def met():
        publisher.publish(sent)
        return next((one for one in reversed(received) if condition(one)), None)

    return wait_for(met, "a rectified image")


def test_rectified_images_and_their_camera_info(start_rectifier, probe, camera_file) -> None:
    rectifier = start_rectifier(distance="1")  # an integer for a double
    images = probe.collect(Image, "/front/rectified/image_rect", RELIABLE, limit=20)
    infos = probe.collect(CameraInfo, "/front/rectified/camera_info", RELIABLE, limit=20)
    source = probe.node.create_publisher(Image, "/front/image_raw", RELIABLE)
    rectifier.wait_to_say("receiving /front/image_raw (reliable)")
    camera = load_camera(camera_file)
    core = Rectifier(camera, make_view(camera))
    image = keep_sending(source, message(picture(), "rgb8"), images, lambda image: True)
    assert image.encoding == "rgb8" and image.header.frame_id == "front_optical" and image.header.stamp.sec == 5
    assert (content(image) == core.rectify(picture(), 1.0)).all()

    info = wait_for(lambda: infos and infos[-1], "CameraInfo")
    plain = rectified_camera_info(core.view)
    assert info.header == image.header and info.distortion_model == "plumb_bob"
    assert (info.width, info.height) == (image.width, image.height) == core.view.size
    assert list(info.p) == list(plain.p) and list(info.k) == list(plain.k) and not any(info.d)

    nearer = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.1)
    request = SetParameters.Request(parameters=[Parameter(name="distance", value=nearer)])
    assert probe.call(SetParameters, "/rectifier/set_parameters", request).results[0].successful
    expected = core.rectify(picture(1), 0.1)
    assert (expected != core.rectify(picture(1), 1.0)).any()
    keep_sending(source, message(picture(1), "bgr8"), images, lambda image: (content(image) == expected).all())

    code, seconds = rectifier.interrupt()
    assert code == 0 and seconds < at_this_load(2.0)
    assert "Traceback" not in rectifier.output and "0 could not be" in rectifier.output


def test_depth_images_move_each_pixel(start_rectifier, probe, camera_file) -> None:
    rectifier = start_rectifier(depth_topic="/depth", width=200, height=150)
    images = probe.collect(Image, "/front/rectified/image_rect", RELIABLE, limit=20)
    source = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    depths = probe.node.create_publisher(Image, "/depth", RELIABLE)
    camera = load_camera(camera_file)
    core = Rectifier(camera, make_view(camera, size=(200, 150)))
    grey = picture()[..., 0]

    def matches(expected: np.ndarray):
        return lambda image: np.abs(content(image).astype(int) - expected).mean() < 0.05

    keep_sending(source, message(grey, "mono8"), images, matches(core.rectify(grey)))
    rectifier.wait_to_say("no depth image for this time")
    wait_for(depths.get_subscription_count, "the depth subscription")
    depth = np.full((150, 200), 80, np.uint16)
    depth[:, :60] = 0
    depths.publish(message(depth, "16UC1", seconds=5.2))
    expected = core.rectify(grey, depth=depth / 1000.0)
    assert not matches(core.rectify(grey))(message(expected, "mono8"))
    keep_sending(source, message(grey, "mono8"), images, matches(expected))
    again = message(grey, "mono8")
    wait_for(lambda: source.publish(again) or rectifier.said("depth images are used"), "it to say so")
    depths.publish(message(depth, "64FC1", seconds=5.2))
    keep_sending(source, message(grey, "mono8"), images, matches(core.rectify(grey)))
    rectifier.wait_to_say("a depth image is 32FC1 or 16UC1")
    depths.publish(message(np.full((150, 200), 0.08, np.float32), "32FC1", seconds=9.0))  # too late for the image
    keep_sending(source, message(grey, "mono8"), images, matches(core.rectify(grey)))
    assert rectifier.interrupt(signal.SIGTERM)[0] == 0


def test_compressed_images_another_projection_and_a_frame_of_its_own(start_rectifier, probe, camera_file) -> None:
    rectifier = start_rectifier(
        "-r", "__ns:=/robot", transport="compressed", projection="cylindrical", yaw="90.0", output="flat", svp="true"
    )
    images = probe.collect(Image, "/robot/flat/image_rect", BEST_EFFORT, limit=20)
    infos = probe.collect(CameraInfo, "/robot/flat/camera_info", BEST_EFFORT, limit=20)
    source = probe.node.create_publisher(CompressedImage, "/front/image_raw/compressed", BEST_EFFORT)
    sent = CompressedImage(format="png", data=array.array("B", cv2.imencode(".png", picture())[1].tobytes()))
    stamp(sent, 7.5)
    image = keep_sending(source, sent, images, lambda image: True)
    assert image.encoding == "bgr8" and image.header.frame_id == "front_optical_rectified"
    assert image.header.stamp.nanosec == 500_000_000
    camera = read_camera_file(camera_file).stand_in
    view = make_view(camera, "cylindrical", yaw=np.pi / 2)
    assert (content(image) == Rectifier(camera, view).rectify(picture())).all()
    info = wait_for(lambda: infos and infos[-1], "CameraInfo")
    assert not any(info.k) and not any(info.p)  # nobody may take it for a pinhole's
    rectifier.wait_to_say("--frame-id front_optical --child-frame-id front_optical_rectified")
    rectifier.wait_to_say("--qy 0.707106781")
    assert rectifier.interrupt()[0] == 0


def png_bomb(side: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(10**7))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def hostile(compressed: bool) -> list:
    if compressed:
        contents = (b"", b"garbage" * 1000, b"\xff\xd8\xff\xe0" + bytes(range(256)) * 20 + b"\xff\xd9", png_bomb(30000))
        return [CompressedImage(format="jpeg", data=array.array("B", content)) for content in contents]
    shapes = [(2048, 2048, 2048), (0, 0, 0), (10, 10, 2**31), (2**32 - 1, 2**32 - 1, 2**32 - 1), (1, 1, 1)]
    fields = [(*shape, "mono8") for shape in shapes] + [(10, 10, 10, ""), (10, 10, 10, "../../x")]
    data = array.array("B", bytes(100))
    made = [Image(height=h, width=w, step=step, encoding=name, data=data) for h, w, step, name in fields]
    return [*made, message(np.zeros((10, 10), np.uint8), "mono8")]  # of another size


@pytest.mark.parametrize("compressed", [False, True])
def test_hostile_messages_are_told_once_and_survived(start_rectifier, probe, compressed) -> None:
    rectifier = start_rectifier(transport="compressed" if compressed else "raw", depth_topic="/depth")
    images = probe.collect(Image, "/front/rectified/image_rect", RELIABLE, limit=20)
    kind, topic = (CompressedImage, "/front/image_raw/compressed") if compressed else (Image, "/front/image_raw")
    source = probe.node.create_publisher(kind, topic, QoSProfile(depth=50))
    depths = probe.node.create_publisher(Image, "/depth", QoSProfile(depth=50))
    wait_for(lambda: source.get_subscription_count() and depths.get_subscription_count(), "the node's subscriptions")
    for bad in hostile(compressed):
        stamp(bad, 3.0)
        source.publish(bad)
        rectifier.wait_to_say("an image cannot be rectified")
        for bad_depth in hostile(False):
            stamp(bad_depth, 5.0)
            depths.publish(bad_depth)
    good = message(picture(), "bgr8")
    if compressed:
        good = CompressedImage(format="png", data=array.array("B", cv2.imencode(".png", picture())[1].tobytes()))
        stamp(good, 5.0)
    for _ in range(3):
        keep_sending(source, good, images, lambda image: image.header.stamp.sec == 5)
        source.publish(hostile(compressed)[0])
    keep_sending(source, good, images, lambda image: image.header.stamp.sec == 5)
    assert not rectifier.said("images can be rectified again")
    wait_for(lambda: source.publish(good) or rectifier.said("images can be rectified again"), "the end of it")
    assert rectifier.output.count("an image cannot be rectified") == 1
    assert rectifier.interrupt()[0] == 0
    assert "Traceback" not in rectifier.output


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"camera_file": "''"}, "camera_file"),
        ({"camera_file": "/nowhere.yaml"}, "/nowhere.yaml"),
        ({"projection": "fisheye"}, "perspective, cylindrical, equirectangular"),
        ({"fov": "180.0"}, "parameter fov of a perspective view must lie above 0° and up to 170°"),
        ({"width": "100"}, "give both or neither"),
        ({"distance": "-1.0"}, "distance"),
        ({"topic": "/"}, "no image topic"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_parameters_that_cannot_be_used_are_refused_in_one_line(start_rectifier, parameters, complaint) -> None:
    rectifier = start_rectifier(**parameters)
    assert rectifier.process.wait(60) == 2
    rectifier.end()
    (line,) = rectifier.lines
    assert line.startswith("rectifier: ") and complaint in line


@pytest.mark.slow
def test_large_images_at_10_hz(start_rectifier, start_publisher, probe, large, camera_file) -> None:
    content = yaml.safe_load(camera_file.read_text())
    content |= {"image_width": 2048, "image_height": 2048}
    content["entrance_pupil"]["intrinsics"] = {"fx": 592.0, "fy": 592.0, "skew": 0.0, "cx": 1013.0, "cy": 1025.0}
    camera_file.write_text(yaml.safe_dump(content))
    rectifier = start_rectifier(distance="0.12", width=1280, height=1024)
    images = probe.collect(Image, "/front/rectified/image_rect", RELIABLE)
    wait_for(lambda: rectifier.said("publishing"), "the node")
    wait_for(lambda: probe.node.count_publishers("/front/rectified/image_rect"), "probe and node to have met")
    publisher = start_publisher(large, 10, "/front/image_raw", "--frames", 100)
    published = int(publisher.wait().split()[-1])
    print(f"{len(images)} of {published} images rectified")
    assert len(images) >= 0.9 * published
