"""A scene with known truth: a camera, a target and poses become images, observations and bags."""

from fisheye_ep_calib.simulation.rendering import Imaging, render

__all__ = ["Imaging", "render"]
