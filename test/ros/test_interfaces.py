"""What the node offers to others: drivers, viewers, late subscribers, launch files."""

from __future__ import annotations

import array
import json
import threading
import time
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from live_processes import LATCHED, at_this_load, wait_for
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters, SetParametersAtomically
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from sensor_msgs.srv import SetCameraInfo
from std_msgs.msg import String
from std_srvs.srv import Trigger

pytestmark = pytest.mark.live

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "config" / "targets" / "circle_grid_11x7.yaml"
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
SIZE = (64, 48)


@pytest.fixture
def camera_file(tmp_path: Path) -> Path:
    """A camera YAML as camera_calibration writes it."""
    path = tmp_path / "before.yaml"
    content = {
        "camera_name": "front",
        "image_width": SIZE[0],
        "image_height": SIZE[1],
        "distortion_model": "equidistant",
        "camera_matrix": {"rows": 3, "cols": 3, "data": [20.0, 0, 31.5, 0, 20.0, 23.5, 0, 0, 1]},
        "distortion_coefficients": {"rows": 1, "cols": 4, "data": [0.01, 0.0, 0.0, 0.0]},
    }
    path.write_text(yaml.safe_dump(content))
    return path


def small_image(size: tuple[int, int] = SIZE, seconds: int = 5) -> Image:
    data = array.array("B", bytes(size[0] * size[1]))
    image = Image(width=size[0], height=size[1], step=size[0], encoding="mono8", data=data)
    image.header.stamp.sec = seconds
    image.header.frame_id = "front_optical"
    return image


def test_an_existing_camera_is_published_from_the_start(start_calibrator, probe, camera_file) -> None:
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    latched = probe.collect(String, "/calibrator/front/calibration", LATCHED)
    wait_for(lambda: latched, "the YAML")
    assert latched[0].data == camera_file.read_text()
    infos = probe.collect(CameraInfo, "/front/camera_info", LATCHED)
    images = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    wait_for(images.get_subscription_count, "the node's subscription")
    images.publish(small_image(size=(32, 32), seconds=4))

    def published() -> Any:
        images.publish(small_image())
        return infos

    wait_for(published, "CameraInfo")
    assert {info.header.stamp.sec for info in infos} == {5}  # none for the image of another size
    assert infos[0].header.frame_id == "front_optical"
    assert (infos[0].k[0], infos[0].d[0]) == (20.0, 0.01)
    assert "only published" in probe.call(Trigger, "/calibrator/calibrate").message
    assert calibrator.interrupt()[0] == 0


def test_services_belong_to_the_visible_node(start_calibrator, probe, tmp_path) -> None:
    """As ``ros2 node info`` asks: by the node's name. Whatever else the process has is hidden, and offers nothing."""
    start_calibrator(cameras="[front]", target=TARGET, output_directory=tmp_path, web="false")
    ours = {f"/calibrator/{name}" for name in ("calibrate", "save", "reset", "commit", "front/reset", "front/commit")}

    def offered(node: str) -> set[str]:
        known = dict(probe.node.get_node_names_and_namespaces())
        return (
            {name for name, _ in probe.node.get_service_names_and_types_by_node(node, "/")} if node in known else set()
        )

    wait_for(lambda: ours <= offered("calibrator"), "the services")
    hidden = [name for name in probe.node.get_node_names() if name.startswith("_")]
    assert hidden == ["_calibrator_services"] and not ours & offered(hidden[0])
    assert "no view" in probe.call(Trigger, "/calibrator/calibrate").message


def test_names_are_remapped_as_image_transport_does(start_calibrator, probe, camera_file) -> None:
    """The base topic is remapped; its transport and its camera_info come beside what that gives."""
    start_calibrator("-r", "/front/image_raw:=/real/cam/image", cameras="[front]", front__camera_file=camera_file,
                     front__transport="compressed")  # fmt: skip
    infos = probe.collect(CameraInfo, "/real/cam/camera_info", LATCHED)
    images = probe.node.create_publisher(CompressedImage, "/real/cam/image/compressed", BEST_EFFORT)
    wait_for(images.get_subscription_count, "the node's subscription")

    def published() -> Any:
        images.publish(compressed_image())
        return infos

    wait_for(published, "CameraInfo beside the images")


def compressed_image(size: tuple[int, int] = SIZE) -> CompressedImage:
    content = cv2.imencode(".png", np.zeros(size[::-1], np.uint8))[1].tobytes()
    return CompressedImage(format="png", data=array.array("B", content))


def test_images_of_half_the_size_have_camera_info_for_theirs(start_calibrator, probe, camera_file) -> None:
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    infos = probe.collect(CameraInfo, "/front/camera_info", LATCHED)
    images = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    wait_for(images.get_subscription_count, "the node's subscription")

    def published() -> Any:
        images.publish(small_image(size=(32, 24)))
        return infos

    wait_for(published, "CameraInfo")
    assert (infos[0].width, infos[0].height, infos[0].binning_x) == (32, 24, 0)
    assert np.allclose(infos[0].k, [10, 0, 15.5, 0, 10, 11.5, 0, 0, 1]) and infos[0].d[0] == 0.01
    assert np.allclose(infos[0].p[:3], [10, 0, 15.5])
    told = "32×24 pixels, its camera 64×48: CameraInfo has K and P for their size"
    calibrator.wait_to_say(told)

    def of_width(width: int) -> Any:
        images.publish(small_image(size=(width, width * 3 // 4)))
        return infos[-1].width == width

    for width in (64, 32, 64, 32):
        wait_for(lambda width=width: of_width(width), f"CameraInfo of images {width} pixels wide")
    assert calibrator.output.count(told) == 1


def test_quality_of_service_is_overridden(start_calibrator, probe, camera_file) -> None:
    """As ros2 has it: qos_overrides./topic.subscription.reliability."""
    override = ("-p", "qos_overrides./front/image_raw.subscription.reliability:=best_effort")
    calibrator = start_calibrator(*override, cameras="[front]", front__camera_file=camera_file)
    probe.node.create_publisher(Image, "/front/image_raw", 10)  # reliable
    wait_for(lambda: calibrator.said("receiving /front/image_raw (best effort)"), "the subscription")
    (endpoint,) = probe.node.get_subscriptions_info_by_topic("/front/image_raw")
    assert endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_a_driver_with_camera_info_of_its_own_is_not_contradicted_but_committed_to(
    start_calibrator, probe, camera_file
) -> None:
    given: list[CameraInfo] = []

    def take(request: Any, response: Any) -> Any:
        given.append(request.camera_info)
        response.success, response.status_message = True, "stored"
        return response

    probe.node.create_service(SetCameraInfo, "/front/set_camera_info", take)
    driver = probe.node.create_publisher(CameraInfo, "/front/camera_info", 10)
    calibrator = start_calibrator(
        "-r", "__ns:=/robot", cameras="[front]", front__camera_file=camera_file, front__topic="/front/image_raw"
    )
    images = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    wait_for(images.get_subscription_count, "the node's subscription")
    infos = probe.collect(CameraInfo, "/robot/calibrator/front/camera_info", LATCHED)

    def published() -> Any:
        images.publish(small_image())
        return infos

    wait_for(published, "CameraInfo on the node's own topic")
    calibrator.wait_to_say("has a publisher already")
    answer = probe.call(Trigger, "/robot/calibrator/commit")
    assert answer.success and "stored" in answer.message
    assert given[0].k[0] == 20.0 and given[0].distortion_model == "equidistant"
    assert driver.get_subscription_count() == 0


def test_a_driver_that_starts_later(start_calibrator, probe, camera_file) -> None:
    """Its service is found once it is there, and its CameraInfo is made way for."""
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    images = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    wait_for(images.get_subscription_count, "the node's subscription")
    infos = probe.collect(CameraInfo, "/front/camera_info", LATCHED)

    def published(infos: list) -> Any:
        images.publish(small_image())
        return infos

    wait_for(lambda: published(infos), "CameraInfo beside the images")
    began = time.monotonic()
    answer = probe.call(Trigger, "/calibrator/commit")
    assert time.monotonic() - began < at_this_load(10.0)
    assert not answer.success and "nobody serves /front/set_camera_info" in answer.message
    assert "call ~/commit again" in answer.message

    def refuse(_request: Any, response: Any) -> Any:
        response.success, response.status_message = False, "read-only"
        return response

    service = probe.node.create_service(SetCameraInfo, "/front/set_camera_info", refuse)
    answer = probe.call(Trigger, "/calibrator/commit")
    assert not answer.success and "refused: read-only" in answer.message
    probe.node.destroy_service(service)

    driver = probe.node.create_publisher(CameraInfo, "/front/camera_info", 10)
    own = probe.collect(CameraInfo, "/calibrator/front/camera_info", LATCHED)
    wait_for(lambda: published(own), "CameraInfo on the node's own topic")
    wait_for(lambda: probe.node.count_publishers("/front/camera_info") == 1, "the driver's CameraInfo alone")
    assert driver
    assert calibrator.interrupt()[0] == 0 and calibrator.output.count("has a publisher already") == 1


def test_ended_while_a_driver_is_silent(start_calibrator, probe, camera_file) -> None:
    answering = threading.Event()

    def keep_waiting(_request: Any, response: Any) -> Any:
        answering.wait(20)
        return response

    probe.node.create_service(SetCameraInfo, "/front/set_camera_info", keep_waiting)
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    client = probe.node.create_client(Trigger, "/calibrator/commit")
    wait_for(client.service_is_ready, "the node's service")
    time.sleep(0.5)  # the node has found the driver too
    client.call_async(Trigger.Request())
    time.sleep(0.5)
    code, seconds = calibrator.interrupt()
    answering.set()
    assert code == 0 and seconds < at_this_load(2.0) and "Traceback" not in calibrator.output


def test_compressed_images_overlay_and_diagnostics(
    start_calibrator, start_publisher, probe, rendered, tmp_path
) -> None:
    calibrator = start_calibrator(
        cameras="[front]", target=TARGET, output_directory=tmp_path, front__transport="compressed"
    )
    pictures = probe.collect(Image, "/calibrator/front/annotated", BEST_EFFORT, limit=5)
    diagnostics = probe.collect(DiagnosticArray, "/diagnostics", LATCHED.__class__(depth=10), limit=50)
    statuses = probe.collect(String, "/calibrator/status", LATCHED, limit=50)
    start_publisher(rendered, 5, "--compressed", "--best-effort", "/front/image_raw/compressed")
    calibrator.wait_to_say("receiving /front/image_raw/compressed (best effort)")
    calibrator.wait_to_say("view 2 kept")
    picture = wait_for(lambda: pictures and pictures[-1], "the overlay")
    assert (picture.width, picture.height, picture.encoding) == (1024, 1024, "bgr8")
    colours = np.frombuffer(picture.data, np.uint8).reshape(1024, 1024, 3).astype(int)
    assert (colours.max(axis=2) - colours.min(axis=2)).max() > 50  # something is drawn in colour

    def counted() -> Any:
        cameras = [json.loads(status.data)["cameras"]["front"] for status in statuses[-1:]]
        return next((camera for camera in cameras if camera["views"] >= 2), None)

    camera = wait_for(counted, "the status")
    assert camera["received"] >= camera["searched"] >= camera["found"] >= camera["views"]
    assert camera["level"] == "OK" and camera["next"]
    status = wait_for(lambda: diagnostics and diagnostics[-1].status[0], "diagnostics")
    assert status.name == "calibrator: front" and status.hardware_id == "front"
    assert {"views", "dropped", "next"} <= {value.key for value in status.values}


def test_publishers_come_late_go_and_come_back_with_another_quality(start_calibrator, probe, camera_file) -> None:
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    calibrator.wait_to_say("nobody publishes /front/image_raw")
    first = probe.node.create_publisher(Image, "/front/image_raw", 10)
    calibrator.wait_to_say("(reliable)")
    probe.node.destroy_publisher(first)
    second = probe.node.create_publisher(Image, "/front/image_raw", BEST_EFFORT)
    calibrator.wait_to_say("(best effort)")
    infos = probe.collect(CameraInfo, "/front/camera_info", LATCHED)
    for seconds in (9, 3):  # the clock jumps back
        stamp = seconds

        def arrived(stamp: int = stamp) -> bool:
            second.publish(small_image(seconds=stamp))
            return any(info.header.stamp.sec == stamp for info in infos)

        wait_for(arrived, f"CameraInfo of {seconds} s")
    calibrator.wait_to_say("went back")


def test_a_topic_of_another_type_is_named(start_calibrator, probe, camera_file) -> None:
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    probe.node.create_publisher(CompressedImage, "/front/image_raw", 10)
    calibrator.wait_to_say("carries sensor_msgs/msg/CompressedImage, not sensor_msgs/msg/Image")


def test_parameters_are_described_bounded_and_tuned(start_calibrator, probe, camera_file) -> None:
    start_calibrator(cameras="[front]", front__camera_file=camera_file)
    names = ["novelty.size", "workers", "front.transport", "minimum_views"]
    described = probe.call(
        DescribeParameters, "/calibrator/describe_parameters", DescribeParameters.Request(names=names)
    ).descriptors
    assert all(descriptor.description for descriptor in described)
    assert described[0].floating_point_range[0].to_value == 10.0
    assert described[1].integer_range[0].to_value == 64 and described[1].read_only
    assert described[2].additional_constraints == "one of: raw, compressed"

    def change(name: str, kind: int, **value: Any) -> Any:
        parameter = Parameter(name=name, value=ParameterValue(type=kind, **value))
        request = SetParameters.Request(parameters=[parameter])
        return probe.call(SetParameters, "/calibrator/set_parameters", request).results[0]

    assert change("novelty.size", ParameterType.PARAMETER_INTEGER, integer_value=1).successful
    assert change("minimum_views", ParameterType.PARAMETER_INTEGER, integer_value=7).successful
    refused = change("novelty.size", ParameterType.PARAMETER_INTEGER, integer_value=11)
    assert not refused.successful and "between 0 and 10" in refused.reason
    refused = change("novelty.size", ParameterType.PARAMETER_STRING, string_value="wide")
    assert not refused.successful and "must be a number" in refused.reason
    assert not change("workers", ParameterType.PARAMETER_INTEGER, integer_value=3).successful


HOSTILE_VALUES = [
    ParameterValue(type=ParameterType.PARAMETER_NOT_SET),
    ParameterValue(type=99),  # there is no such type
    ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float("nan")),
    ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=1e308),
    ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=-(2**63)),
    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="\x1b[31m\n&a [*a]" * 100_000),
    ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=["a"] * 10_000),
]


def test_whatever_is_asked_of_parameters_is_refused_with_its_reason(start_calibrator, probe, camera_file) -> None:
    calibrator = start_calibrator(cameras="[front]", front__camera_file=camera_file)
    names = ("minimum_views", "goal_mm", "target", "misspelt\x1b[31m", "")
    for kind, name in product((SetParameters, SetParametersAtomically), names):
        service = "set_parameters" if kind is SetParameters else "set_parameters_atomically"
        for value in HOSTILE_VALUES:
            request = kind.Request(parameters=[Parameter(name=name, value=value)])
            answer = probe.call(kind, f"/calibrator/{service}", request)
            result = answer.results[0] if kind is SetParameters else answer.result
            assert not result.successful and result.reason.isprintable() and len(result.reason) <= 310, name
            assert name.replace("\x1b", "\\x1b") in result.reason and result.reason, name
    calibrator.wait_to_say("parameters stay as they are: ")
    assert "Traceback" not in calibrator.output and max(map(len, calibrator.output.splitlines())) < 500
    assert calibrator.interrupt()[0] == 0
