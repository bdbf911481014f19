"""Cameras in other people's formats, out and in.

A new format is one module with a ``Format`` and one line in ``FORMATS``; the order is that in which a file is asked
what it is.
"""

from fisheye_ep_calib.formats.basalt import BASALT
from fisheye_ep_calib.formats.camera_info import CAMERA_INFO
from fisheye_ep_calib.formats.colmap import COLMAP
from fisheye_ep_calib.formats.foreign_camera import ForeignCamera
from fisheye_ep_calib.formats.format import Format, Written
from fisheye_ep_calib.formats.kalibr import KALIBR
from fisheye_ep_calib.formats.mrcal import MRCAL
from fisheye_ep_calib.formats.nerfstudio import NERFSTUDIO
from fisheye_ep_calib.formats.opencv import OPENCV
from fisheye_ep_calib.formats.openvins import OPENVINS
from fisheye_ep_calib.formats.orbslam3 import ORBSLAM3
from fisheye_ep_calib.formats.placed_camera import PlacedCamera
from fisheye_ep_calib.formats.static_transform import STATIC_TRANSFORM
from fisheye_ep_calib.formats.urdf import URDF
from fisheye_ep_calib.formats.vins import VINS

FORMATS: dict[str, Format] = {
    format.name: format
    for format in (
        CAMERA_INFO,
        KALIBR,
        OPENVINS,
        BASALT,
        ORBSLAM3,
        VINS,
        COLMAP,
        NERFSTUDIO,
        OPENCV,
        MRCAL,
        STATIC_TRANSFORM,
        URDF,
    )
}

__all__ = ["FORMATS", "ForeignCamera", "Format", "PlacedCamera", "Written"]
