"""The paper's pupil: E(θ) = e1 θ³ + e2 θ⁵ + e3 θ⁷ + e4 θ⁹ (Fasogbon and Aksu).

A symmetric lens has an even E(θ), so this family misses the θ² near the axis.
"""

from fisheye_ep_calib.camera.pupils.family import PowerPupil

ODD = PowerPupil(first_power=3, default_terms=4, max_terms=4)
