"""OpenVINS's kalibr_imucam_chain.yaml, read by cv::FileStorage: each camera in the frame of the IMU.

T_imu_cam is the IMU from the camera. No IMU is known here: the reference camera's frame stands in its place.
(OpenVINS, ov_core/utils/opencv_yaml_parse.h; docs, "Sensor calibration".)
"""

from __future__ import annotations

from collections.abc import Sequence

import yaml

from fisheye_ep_calib.formats.format import Format, Named, Written
from fisheye_ep_calib.formats.kalibr import camera_keys
from fisheye_ep_calib.formats.placed_camera import PlacedCamera, floats, statement


class _Dumper(yaml.SafeDumper):
    """Lists further in than their key: OpenCV's parser wants it."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)


NO_IMU = "no IMU is known: T_imu_cam is from camera to reference camera; put the IMU's pose in"


def write(cameras: Sequence[PlacedCamera], _named: Named) -> Written:
    """Kannala–Brandt cameras with one viewpoint."""
    central = [placed.central().camera for placed in cameras]
    words = (*statement(cameras, central), NO_IMU)
    content = {}
    for number, (placed, camera) in enumerate(zip(cameras, central, strict=True)):
        content[f"cam{number}"] = {
            "T_imu_cam": [floats(row) for row in placed.reference_from_camera],
            "cam_overlaps": sorted(placed.overlaps),
            **camera_keys(placed, camera),
            "timeshift_cam_imu": 0.0,
        }
    head = "%YAML:1.0\n" + "".join(f"# {line}\n" for line in words)
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=200)
    return Written({"": head + text}, words)


OPENVINS = Format("openvins", "OpenVINS's kalibr_imucam_chain.yaml", write)
