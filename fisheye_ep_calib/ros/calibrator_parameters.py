"""The calibrator's parameters, and how they become its settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from fisheye_ep_calib.calibration.options import AUTO, Options
from fisheye_ep_calib.camera import PUPIL_FAMILIES
from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.live.outcome import Outcome, outcome_of_file
from fisheye_ep_calib.live.settings import CameraSettings, Limits, RigSettings, Settings, Tuning
from fisheye_ep_calib.outside import expanded
from fisheye_ep_calib.planning.view_selection import Novelty
from fisheye_ep_calib.ros.parameter_table import Entry, ParameterTable
from fisheye_ep_calib.storage.rig_file import CAMCHAIN, RIG
from fisheye_ep_calib.target import Target, load_target
from fisheye_ep_calib.web.settings import WebSettings

MODELS = (AUTO, *PUPIL_FAMILIES)
SWITCHES = ("flex", "rolling_shutter", "lens_field", "force")  # of the calibration, by the names that it has for them
CAMERA_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
RESERVED_NAMES = tuple(Path(name).stem for name in (RIG, CAMCHAIN))  # a camera of that name would share the file

NODE = (
    Entry("cameras", ["camera"], "Names of the cameras; each has parameters of its own under its name."),
    Entry("target", "", "Target file (YAML) that every camera sees unless it names its own."),
    Entry("model", AUTO, "Camera model to fit unless a camera names its own.", choices=MODELS),
    Entry("board_shape", "", "Shape of the target: flat, bow, free, auto, or a file that has it; empty: by the model."),
    Entry("flex", False, "Estimate a board that bends and stretches from view to view."),
    Entry("rolling_shutter", False, "Estimate a motion while the shutter rolls, in every view."),
    Entry("lens_field", False, "Estimate a smooth field that is not symmetric about the lens's axis."),
    Entry("force", False, "Take a camera that is refused for what its views leave open, marked as refused."),
    Entry("output_directory", "calibration", "Folder for <camera>.yaml and <camera>.npz."),
    Entry("resume", True, "Go on with the views of an earlier run; false sets them aside."),
    Entry("keep_images", False, "Store the images of kept views as PNG, in images/<camera> of the output_directory."),
    Entry("check", False, "Hold cameras against their camera_file by what they see of the target; calibrate nothing."),
    Entry("rig", False, "Find where the cameras are to each other; the first one is the reference."),
    Entry("rig_tolerance", 0.01, "Seconds within which images of two cameras are of the same time.", 0.0, 10.0),
    Entry("rig_views", 40, "Common views of two cameras that are kept even if one camera needs no more.", 3, 10000),
    Entry("rig_tf", False, "Publish on /tf_static where the rig's cameras are; not where a robot's URDF does."),
    Entry("workers", 2, "Processes that detect and calibrate, for all cameras together.", 1, 64),
    Entry("auto_calibrate", True, "Calibrate without being asked, once there are views enough.", live=True),
    Entry("minimum_views", 10, "Views from which on auto_calibrate calibrates.", 3, 10000, live=True),
    Entry(
        "goal_mm",
        0.0,
        "Standard deviation of E(60 deg), mm, at which it is enough; 0: 1.3 times that of 40 guided views.",
        0.0,
        1e3,
        live=True,
    ),
    Entry("show_refused", False, "Draw what looked like a feature and was none.", live=True),
    Entry("web", True, "Serve a page to look at while moving the target, http://localhost:8123."),
    Entry("web_address", "127.0.0.1", "Where to serve it; beyond this machine it asks for a token, told in the log."),
    Entry("web_port", 8123, "Its port; the next free one where it is taken, any where it is 0.", 0, 65535),
    Entry("maximum_views", 150, "No more views are kept than these.", 3, 10000, live=True),
    Entry("novelty.position", 0.08, "New: the board moved this fraction of the image.", 0.0, 1.0, live=True),
    Entry("novelty.size", 0.3, "New: its size changed by 2 to this power.", 0.0, 10.0, live=True),
    Entry("novelty.tilt", 0.3, "New: its foreshortening changed by 2 to this power.", 0.0, 10.0, live=True),
)
CAMERA = (
    Entry("topic", "", "Image topic, without the transport's suffix; default /<camera>/image_raw."),
    Entry("transport", "raw", "sensor_msgs/Image or CompressedImage.", choices=("raw", "compressed")),
    Entry("target", "", "Target file (YAML) of this camera."),
    Entry("model", "", "Camera model to fit.", choices=("", *MODELS)),
    Entry("camera_file", "", "An existing camera YAML to publish; without a target that is all there is to do."),
    Entry("camera_info_topic", "", "Where to publish CameraInfo; default beside the image topic."),
    Entry("set_camera_info", "", "The driver's service for ~/commit; default beside the image topic."),
)


def declare(table: ParameterTable) -> Settings:
    """Declare every parameter and read the settings. Raises InputError in one line."""
    table.declare(NODE)
    names = _camera_names(table["cameras"])
    for name in names:
        table.declare(CAMERA, prefix=name)
    cameras = tuple(_camera(table, name) for name in names)
    if table["check"]:
        _refuse_to_check(table, cameras)
    return Settings(
        cameras=cameras,
        output_directory=expanded(table["output_directory"]),
        resume=table["resume"],
        workers=table["workers"],
        rig=_rig(table, cameras) if table["rig"] else None,
        keep_images=table["keep_images"],
        check=table["check"],
    )


def tuning(table: ParameterTable) -> Tuning:
    """What may change while the node runs."""
    novelty = Novelty(table["novelty.position"], table["novelty.size"], table["novelty.tilt"])
    limits = Limits(novelty, table["maximum_views"])
    return Tuning(
        auto_calibrate=table["auto_calibrate"],
        minimum_views=table["minimum_views"],
        goal_mm=table["goal_mm"],
        limits=limits,
        show_refused=table["show_refused"],
    )


def web(table: ParameterTable) -> WebSettings | None:
    """Where to serve the page; None where it is not wanted."""
    return WebSettings(table["web_address"], table["web_port"]) if table["web"] else None


def _refuse_to_check(table: ParameterTable, cameras: tuple[CameraSettings, ...]) -> None:
    """What cannot be checked."""
    if table["rig"]:
        raise InputError("parameter check: cameras are checked each by itself; leave out rig")
    for camera in cameras:
        if camera.initial is None:
            raise InputError(f"parameter {camera.name}.camera_file: say which calibration is to be checked")
        if camera.target is None:
            raise InputError(f"parameter {camera.name}.target: say which target file (YAML) the camera sees")


def _rig(table: ParameterTable, cameras: tuple[CameraSettings, ...]) -> RigSettings:
    seeing = [(camera.name, camera.target) for camera in cameras if camera.target is not None]
    if len(seeing) < 2:
        raise InputError("parameter rig: a rig has two cameras at least that see the target; name them in cameras")
    (first, target), *others = seeing
    for name, other in others:
        if other.disc_radius != target.disc_radius or not np.array_equal(other.object_points, target.object_points):
            raise InputError(f"parameter rig: {first} and {name} must see the same target; give it once, as target")
    for name in (name for name, _ in seeing if name.lower() in RESERVED_NAMES):
        raise InputError(f"parameter cameras: {name!r} is the name of a file of the rig; call the camera otherwise")
    return RigSettings(table["rig_tolerance"], table["rig_views"])


def _camera_names(names: list[str]) -> list[str]:
    if not names:
        raise InputError("parameter cameras: name at least one camera")
    reserved = {entry.name.partition(".")[0] for entry in NODE}
    for name in names:
        if not CAMERA_NAME.fullmatch(name):
            raise InputError(f"parameter cameras: {name!r} must be letters, digits and _, a letter first")
        if name in reserved:
            raise InputError(f"parameter cameras: {name!r} is the name of a parameter; call the camera otherwise")
    if len({name.lower() for name in names}) < len(names):
        raise InputError("parameter cameras: two cameras have the same name")
    return names


def _camera(table: ParameterTable, name: str) -> CameraSettings:
    topic, compressed = table.image_topic(f"{name}.topic", f"/{name}/image_raw")
    compressed = compressed or table[f"{name}.transport"] == "compressed"
    beside = topic[: topic.rfind("/") + 1]
    camera_file = table[f"{name}.camera_file"]
    return CameraSettings(
        name=name,
        topic=topic,
        compressed=compressed,
        target=_target(table, name, needed=not camera_file),
        model=table[f"{name}.model"] or table["model"],
        initial=_initial(name, camera_file),
        camera_info_topic=table[f"{name}.camera_info_topic"] or beside + "camera_info",
        set_camera_info_service=table[f"{name}.set_camera_info"] or beside + "set_camera_info",
        options=_options(table),
    )


def _options(table: ParameterTable) -> dict[str, Any]:
    """Of every calibration; those that are as ``calibrate`` has them by itself are left out."""
    given: dict[str, Any] = {name: True for name in SWITCHES if table[name]}
    if table["board_shape"]:
        given["board_shape"] = table["board_shape"]
    Options.of(**given)
    return given


def _initial(camera: str, path: str) -> Outcome | None:
    if not path:
        return None
    try:
        return outcome_of_file(expanded(path))
    except InputError as error:
        raise InputError(f"parameter {camera}.camera_file: {error}") from None


def _target(table: ParameterTable, camera: str, needed: bool) -> Target | None:
    """A camera's target; a bare name is also looked for among the targets that come with the package."""
    key = f"{camera}.target" if table[f"{camera}.target"] else "target"
    if not table[key] and not needed:
        return None
    if not table[key]:
        raise InputError(f"parameter {camera}.target: say which target file (YAML) the camera sees")
    try:
        return load_target(table[key])
    except InputError as error:
        raise InputError(f"parameter {key}: {error}") from None
