"""The rectifier executable."""

from __future__ import annotations

import sys

from fisheye_ep_calib.ros.rectifier_node import RectifierNode
from fisheye_ep_calib.ros.run_node import run_node


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is interrupted."""
    return run_node("rectifier", RectifierNode, arguments)


if __name__ == "__main__":
    sys.exit(main())
