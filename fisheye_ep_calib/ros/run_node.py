"""Runs a node as a program until it is interrupted."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from fisheye_ep_calib.errors import CalibrationError


class NodeOwner(Protocol):
    """What has a node to spin, and ends all that it started when it is closed."""

    node: Node

    def close(self) -> None: ...


def run_node(name: str, make: Callable[[], NodeOwner], arguments: list[str] | None) -> int:
    """The program's exit code: 0 once interrupted, 2 where it was given something that cannot be used."""
    owner = None
    try:
        rclpy.init(args=arguments)
        owner = make()
        executor = SingleThreadedExecutor()
        executor.add_node(owner.node)
        executor.spin()
    except CalibrationError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        if rclpy.ok():
            raise
        # Interrupted while it was starting: whatever needs the context fails then.
    finally:
        if owner is not None:
            owner.close()
        rclpy.try_shutdown()
    return 0
