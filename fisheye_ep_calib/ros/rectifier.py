"""The rectifier executable."""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.ros.rectifier_node import RectifierNode


def main(arguments: list[str] | None = None) -> int:
    """Run the node until it is interrupted; 2 where it was given something that cannot be used."""
    rectifier = None
    try:
        rclpy.init(args=arguments)
        rectifier = RectifierNode()
        executor = SingleThreadedExecutor()
        executor.add_node(rectifier.node)
        executor.spin()
    except CalibrationError as error:
        print(f"rectifier: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if rectifier is not None:
            rectifier.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
