"""The rectifier's parameters, and how they become its settings."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.outside import expanded
from fisheye_ep_calib.rectification import INTERPOLATIONS, PROJECTIONS, SURFACES, Rectifier, make_view
from fisheye_ep_calib.rectification.rectifier import NEAREST_DEPTH
from fisheye_ep_calib.ros.parameter_table import Entry, ParameterTable
from fisheye_ep_calib.storage.camera_file import read_camera_file

ENTRIES = (
    Entry("camera_file", "", "Camera file (YAML) of the camera that sends the images."),
    Entry("topic", "image_raw", "Image topic, without the transport's suffix."),
    Entry("transport", "raw", "sensor_msgs/Image or CompressedImage.", choices=("raw", "compressed")),
    Entry("output", "", "Namespace of image_rect and its camera_info; default 'rectified' beside the image topic."),
    Entry("distance", 0.0, "Metres from the lens at which the image is right; 0: infinity.", 0.0, 1e6, live=True),
    Entry("surface", "", "What is there: a plane across the view's axis, or a sphere.", choices=("", *SURFACES)),
    Entry("svp", False, "Rectify with the single-viewpoint camera of CameraInfo instead, to compare."),
    Entry("depth_topic", "", "Depth images (32FC1 or 16UC1) in the rectified image's geometry; '': none."),
    Entry("nearest_depth", NEAREST_DEPTH, "Metres; nearer points of a depth image are taken to be there.", 1e-3, 1e3),
    Entry("depth_age", 0.5, "Seconds between an image and the depth image used for it, at most.", 0.0, 3600.0),
    Entry("projection", "perspective", "Kind of the rectified image.", choices=tuple(PROJECTIONS)),
    Entry("fov", 0.0, "Horizontal field of view, degrees; 0: the camera's, at most 100 in perspective.", 0.0, 360.0),
    Entry("width", 0, "Width of the rectified image, pixels; 0: keeps the resolution.", 0, 16384),
    Entry("height", 0, "Height of the rectified image, pixels; 0: keeps the resolution.", 0, 16384),
    Entry("yaw", 0.0, "Look to the right, degrees.", -180.0, 180.0),
    Entry("pitch", 0.0, "Look up, degrees.", -90.0, 90.0),
    Entry("frame_id", "", "Frame of the rectified image; default the image's, or one of its own for a turned view."),
    Entry("interpolation", "linear", "How samples are interpolated.", choices=tuple(INTERPOLATIONS)),
)


@dataclass(frozen=True)
class RectifierSettings:
    """image_topic: with the transport's suffix. output: namespace of the results. depth_age: seconds."""

    rectifier: Rectifier
    image_topic: str
    compressed: bool
    output: str
    depth_topic: str
    depth_age: float
    frame_id: str


def declare(table: ParameterTable) -> RectifierSettings:
    """Declare every parameter and read the settings. Raises InputError in one line."""
    table.declare(ENTRIES)
    topic, compressed = table.image_topic("topic")
    compressed = compressed or table["transport"] == "compressed"
    beside = topic[: topic.rfind("/") + 1]
    return RectifierSettings(
        rectifier=_rectifier(table),
        image_topic=f"{topic}/compressed" if compressed else topic,
        compressed=compressed,
        output=table["output"].rstrip("/") or f"{beside}rectified",
        depth_topic=table["depth_topic"],
        depth_age=table["depth_age"],
        frame_id=table["frame_id"],
    )


def distance(table: ParameterTable) -> float:
    """Metres; the parameter may change while the node runs."""
    return table["distance"] or math.inf


def _rectifier(table: ParameterTable) -> Rectifier:
    if not table["camera_file"]:
        raise InputError("parameter camera_file: give the camera's YAML, as the calibrator wrote it")
    if bool(table["width"]) != bool(table["height"]):
        raise InputError("parameters width and height: give both or neither")
    try:
        file = read_camera_file(expanded(table["camera_file"]))
    except InputError as error:
        raise InputError(f"parameter camera_file: {error}") from None
    camera = file.stand_in if table["svp"] else file.camera
    view = make_view(
        camera,
        table["projection"],
        math.radians(table["fov"]) if table["fov"] else None,
        (table["width"], table["height"]) if table["width"] else None,
        math.radians(table["yaw"]),
        math.radians(table["pitch"]),
    )
    return Rectifier(camera, view, table["surface"] or None, table["interpolation"], table["nearest_depth"])
