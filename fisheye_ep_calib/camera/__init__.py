"""What a camera is: lens r(θ), its extras, entrance pupil E(θ), and the camera made of them."""

from fisheye_ep_calib.camera.extras import KNOWN_EXTRAS, LENS_EXTRAS
from fisheye_ep_calib.camera.fisheye import FAR, FisheyeCamera
from fisheye_ep_calib.camera.lenses import KNOWN_LENSES, LENSES
from fisheye_ep_calib.camera.pupils import PUPIL_FAMILIES

__all__ = ["FAR", "KNOWN_EXTRAS", "KNOWN_LENSES", "LENSES", "LENS_EXTRAS", "PUPIL_FAMILIES", "FisheyeCamera"]
