"""From a recording to observations: which images to look at, looking in parallel, and what was seen."""

from fisheye_ep_calib.collection.collector import Collector
from fisheye_ep_calib.collection.results import DetectionRun, FrameResult
from fisheye_ep_calib.planning.image_choice import FrameChoice

__all__ = ["Collector", "DetectionRun", "FrameChoice", "FrameResult"]
