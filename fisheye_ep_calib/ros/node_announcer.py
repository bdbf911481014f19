"""A node's log, as an Announcer."""

from __future__ import annotations

from rclpy.node import Node

from fisheye_ep_calib.live.announcer import Announcer
from fisheye_ep_calib.ros.parameter_names import with_parameters


def announcer_of(node: Node) -> Announcer:
    """Passes texts on to the node's log, in its words."""
    logger = node.get_logger()

    def info(text: str) -> None:
        logger.info(with_parameters(text))

    def warning(text: str) -> None:
        logger.warning(with_parameters(text))

    return Announcer(info, warning)
