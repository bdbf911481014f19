"""The even pupil: E(θ) = e1 θ² + e2 θ⁴ + …; axial symmetry makes the pupil shift of a real lens even in θ."""

from fisheye_ep_calib.camera.pupils.family import PowerPupil

EVEN = PowerPupil(first_power=2, default_terms=2, max_terms=4)
