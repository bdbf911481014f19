"""Lenses: how far from the image centre a ray of incidence angle θ lands, r(θ), for unit focal length.

A new lens is one module with an object of the ``Lens`` protocol and one line in ``LENSES``.
"""

from fisheye_ep_calib.camera.lenses.double_sphere import DOUBLE_SPHERE
from fisheye_ep_calib.camera.lenses.kannala_brandt import KANNALA_BRANDT, KANNALA_BRANDT_6
from fisheye_ep_calib.camera.lenses.lens import Lens, solve_angle

LENSES: dict[str, Lens] = {lens.name: lens for lens in (KANNALA_BRANDT, KANNALA_BRANDT_6, DOUBLE_SPHERE)}

__all__ = ["LENSES", "Lens", "solve_angle"]
