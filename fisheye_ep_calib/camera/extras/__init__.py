"""Lens extras: what bends the image plane beyond axial symmetry, applied to (x, y) in this order.

A new extra is one module with an object of the ``LensExtra`` protocol and one line in ``LENS_EXTRAS``. Those of other
people's cameras, which a calibration here holds and does not estimate, are in ``HELD_EXTRAS``; they come first.
"""

from collections import ChainMap

from fisheye_ep_calib.camera.extras.brown_conrady import BROWN_CONRADY
from fisheye_ep_calib.camera.extras.extra import LensExtra
from fisheye_ep_calib.camera.extras.lens_field import LENS_FIELD
from fisheye_ep_calib.camera.extras.tangential import TANGENTIAL
from fisheye_ep_calib.camera.extras.tilt import TILT

LENS_EXTRAS: dict[str, LensExtra] = {extra.name: extra for extra in (TANGENTIAL, TILT, LENS_FIELD)}
HELD_EXTRAS: dict[str, LensExtra] = {BROWN_CONRADY.name: BROWN_CONRADY}
KNOWN_EXTRAS = ChainMap(LENS_EXTRAS, HELD_EXTRAS)  # all that a camera may have

__all__ = ["HELD_EXTRAS", "KNOWN_EXTRAS", "LENS_EXTRAS", "LensExtra"]
