"""Lenses: how far from the image centre a ray of incidence angle θ lands, r(θ), for unit focal length.

A new lens is one module with an object of the ``Lens`` protocol and one line in ``LENSES``. Those of other people's
cameras, which a calibration here holds and does not estimate, are in ``HELD_LENSES``.
"""

from collections import ChainMap

from fisheye_ep_calib.camera.lenses.cahvore import CAHVORE
from fisheye_ep_calib.camera.lenses.double_sphere import DOUBLE_SPHERE
from fisheye_ep_calib.camera.lenses.kannala_brandt import KANNALA_BRANDT, KANNALA_BRANDT_6
from fisheye_ep_calib.camera.lenses.lens import Lens, solve_angle
from fisheye_ep_calib.camera.lenses.perspective import PERSPECTIVE

LENSES: dict[str, Lens] = {lens.name: lens for lens in (KANNALA_BRANDT, KANNALA_BRANDT_6, DOUBLE_SPHERE)}
HELD_LENSES: dict[str, Lens] = {lens.name: lens for lens in (PERSPECTIVE, CAHVORE)}
KNOWN_LENSES = ChainMap(LENSES, HELD_LENSES)  # all that a camera may have

__all__ = ["HELD_LENSES", "KNOWN_LENSES", "LENSES", "Lens", "solve_angle"]
