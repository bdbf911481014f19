"""From a fisheye image to one with a single viewpoint, the pupil's shift corrected for a distance or by depth."""

from fisheye_ep_calib.rectification.maps import SURFACES, Maps, surface_maps
from fisheye_ep_calib.rectification.projections import PROJECTIONS
from fisheye_ep_calib.rectification.rectifier import INTERPOLATIONS, Rectifier, rectify
from fisheye_ep_calib.rectification.view import View, field_of_view, make_view, rectified_camera_info

__all__ = [
    "INTERPOLATIONS",
    "PROJECTIONS",
    "SURFACES",
    "Maps",
    "Rectifier",
    "View",
    "field_of_view",
    "make_view",
    "rectified_camera_info",
    "rectify",
    "surface_maps",
]
