"""Entrance pupils: E(θ), how far a point is moved along the optical axis before a central lens projects it.

E(θ) is added to the point's z in the camera frame, so the pupil sits at z = −E(θ); real lenses have E < 0.
Every family is linear in its coefficients (metres) and has E(0) = 0; the value at θ = 0 is the pose's t_z.
A new family is one module with an object of the ``PupilFamily`` protocol and one line in ``PUPIL_FAMILIES``.
"""

from fisheye_ep_calib.camera.pupils.central import CENTRAL
from fisheye_ep_calib.camera.pupils.even import EVEN
from fisheye_ep_calib.camera.pupils.family import (
    PupilFamily,
    entrance_pupil,
    entrance_pupil_derivative,
    entrance_pupil_with_derivative,
)
from fisheye_ep_calib.camera.pupils.gennery import GENNERY
from fisheye_ep_calib.camera.pupils.odd import ODD

CENTRAL_MODEL = "kannala"  # what users and files call the pupil that does not move, after the lens

PUPIL_FAMILIES: dict[str, PupilFamily] = {
    CENTRAL_MODEL: CENTRAL,
    "gennery": GENNERY,
    "ep_odd": ODD,
    "ep_even": EVEN,
}

__all__ = [
    "CENTRAL_MODEL",
    "PUPIL_FAMILIES",
    "PupilFamily",
    "entrance_pupil",
    "entrance_pupil_derivative",
    "entrance_pupil_with_derivative",
]
