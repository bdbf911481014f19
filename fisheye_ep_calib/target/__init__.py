"""What a target is: its geometry, its detector, its print."""

from fisheye_ep_calib.target.base import Artwork, Target
from fisheye_ep_calib.target.detection import Detection, Detector
from fisheye_ep_calib.target.registry import load_target, parse_target
from fisheye_ep_calib.target.shipped import shipped_files

__all__ = ["Artwork", "Detection", "Detector", "Target", "load_target", "parse_target", "shipped_files"]
