"""From a recording to observations: which images to look at, looking in parallel, and what was seen."""

from fisheye_ep_calib.collection.choice import FrameChoice
from fisheye_ep_calib.collection.collector import Collector
from fisheye_ep_calib.collection.results import DetectionRun, FrameResult

__all__ = ["Collector", "DetectionRun", "FrameChoice", "FrameResult"]
