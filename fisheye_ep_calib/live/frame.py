"""One camera frame on its way to a worker, and what the worker finds in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from fisheye_ep_calib.calibration import Observations
from fisheye_ep_calib.calibration.assessing.evaluation import where_to_look_again
from fisheye_ep_calib.camera import FisheyeCamera
from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.live.overlay import OverlayRequest, Pictures, draw_pictures
from fisheye_ep_calib.planning.steering import steer
from fisheye_ep_calib.planning.view_selection import view_signature
from fisheye_ep_calib.storage.grey_levels import to_eight_bits, to_levels
from fisheye_ep_calib.storage.images import grey_image, grey_of_compressed
from fisheye_ep_calib.target import Detection, Detector, Target
from fisheye_ep_calib.target.second_look import look_again
from fisheye_ep_calib.target.sharpness import edge_blur

LIGHT_CELLS = 64
_OTHERS_PIXELS = 1e6  # of an image in which other boards are looked for
_LEAST_FOUND_AGAIN = 0.8  # of the points of the first look


@dataclass(frozen=True)
class RawFrame:
    """The fields of an image message that decoding needs, undecoded and unchecked: the worker checks them.

    name: what the view is called in the observation file. The other fields are those of sensor_msgs/Image;
    a compressed frame has ``data`` alone.
    """

    name: str
    data: Any
    compressed: bool = False
    height: int = 0
    width: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    step: int = 0

    @staticmethod
    def from_message(message: Any, name: str) -> RawFrame:
        """From a sensor_msgs Image, or a CompressedImage, which has no encoding."""
        if not hasattr(message, "encoding"):
            return RawFrame(name, message.data, compressed=True)
        return RawFrame(
            name,
            message.data,
            height=message.height,
            width=message.width,
            encoding=message.encoding,
            is_bigendian=message.is_bigendian,
            step=message.step,
        )


@dataclass(frozen=True)
class Sighting:
    """What was found in one frame: its name, its size (width, height) and the target's features.

    pictures: what a person looks at, where that was asked for. light (rows, columns) uint8: the image in a few cells.
    blur: σ of the edges about the features, pixels; NaN where none were found. other_board: a sentence on
    another board that is seen, empty where none is; None where none was looked for.
    """

    name: str
    image_size: tuple[int, int]
    detection: Detection
    pictures: Pictures | None = None
    light: np.ndarray | None = None
    blur: float = float("nan")
    other_board: str | None = None


def detect_in_frame(
    frame: RawFrame,
    target: Target,
    camera: FisheyeCamera | None = None,
    overlay: OverlayRequest | None = None,
    others: bool = False,
) -> Sighting:
    """Decode a frame and find the target in it, a second time where the camera, if one is known, says that it is.

    The second time it is measured in the frame's own depth. others: look for another board where it is not found.

    Raises InputError for a frame that cannot be decoded.
    """
    grey = grey_of_compressed(frame) if frame.compressed else grey_image(frame)
    image = to_eight_bits(grey)
    height, width = image.shape
    detector = target.detector()
    detection = detector.detect(image)
    if camera is not None and camera.image_size == (width, height):
        detection = second_look(detector, to_levels(grey), detection, target, camera)
    pictures = _pictures(image, detection, overlay, target) if overlay else None
    blur, other = blur_about(image, detection.pixels), other_board(image, target, detection) if others else None
    return Sighting(frame.name, (width, height), detection, pictures, light_of(image), blur, other)


def other_board(image: np.ndarray, target: Target, detection: Detection) -> str | None:
    """A sentence on another board that a grey image shows; empty for none, None where the target itself was found."""
    from fisheye_ep_calib.target.what_else import what_else  # loads every detector

    reason = detection.reason
    if len(detection) or reason.startswith("blurred"):  # where all is blurred, squares look like discs
        return None
    if " seen" in reason and ("target file" in reason or "not of" in reason):
        return reason  # the detector knows already
    scale = min(1.0, np.sqrt(_OTHERS_PIXELS / image.size))  # it takes up to 2 s a megapixel
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    other = what_else(cv2.resize(image, size, interpolation=cv2.INTER_AREA) if scale < 1 else image, target)
    return f"{other} is seen, not the target" if other else ""


def _pictures(image: np.ndarray, detection: Detection, request: OverlayRequest, target: Target) -> Pictures:
    now, steering = None, None
    if request.signature is not None and len(detection):
        size = image.shape[1], image.shape[0]
        now = view_signature(target.object_points[detection.point_index], detection.pixels, size)
    if request.signature is not None and now is not None:
        steering = steer(now, request.signature)
    return draw_pictures(image, detection, request, steering)


def light_of(image: np.ndarray) -> np.ndarray:
    """A grey image (h, w) uint8 in LIGHT_CELLS cells along its longer side."""
    scale = LIGHT_CELLS / max(image.shape)
    size = tuple(max(1, round(scale * length)) for length in image.shape[::-1])
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def blur_about(image: np.ndarray, pixels: np.ndarray) -> float:
    """σ of the blur of the edges in the part of an image that holds pixels (n, 2); NaN where there are none."""
    if len(pixels) == 0:
        return float("nan")
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    high = np.ceil(pixels.max(axis=0)).astype(int) + 1
    part = image[low[1] : high[1], low[0] : high[0]]
    return edge_blur(part) if min(part.shape) > 8 else float("nan")


def second_look(
    detector: Detector, image: np.ndarray, first: Detection, target: Target, camera: FisheyeCamera
) -> Detection:
    """Find the target again where the camera, and the pose from what was found first, say that it is.

    What was found first where most of it is not found again: the camera is another one, then.
    """
    if len(first) == 0:
        return first
    observations = Observations.create(
        target.object_points,
        np.zeros(len(first), dtype=int),
        first.point_index,
        first.pixels,
        camera.image_size,
        disc_radius=target.disc_radius,
        board=target.shape,
    )
    try:
        guide, poses = where_to_look_again(camera, observations)
    except CalibrationError:
        return first
    again = look_again(detector, image, guide, poses[0], first)
    found_again = np.isin(first.point_index, again.point_index).mean()
    return again if found_again > _LEAST_FOUND_AGAIN else first
