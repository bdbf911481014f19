"""Lens extras: what bends the image plane beyond axial symmetry, applied to (x, y) in this order.

A new extra is one module with an object of the ``LensExtra`` protocol and one line in ``LENS_EXTRAS``.
"""

from fisheye_ep_calib.camera.extras.extra import LensExtra
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.camera.extras.tangential import TANGENTIAL
from fisheye_ep_calib.camera.extras.tilt import TILT

LENS_EXTRAS: dict[str, LensExtra] = {extra.name: extra for extra in (TANGENTIAL, TILT, LENS_FIELD)}

__all__ = ["LENS_EXTRAS", "LensExtra"]
