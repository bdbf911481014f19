"""What a target is: its geometry, its detector, its print."""

from fisheye_ep_calib.target.base import Artwork, Target
from fisheye_ep_calib.target.detection import Detection, Detector
from fisheye_ep_calib.target.registry import load_target, parse_target

__all__ = ["Artwork", "Detection", "Detector", "Target", "load_target", "parse_target"]
