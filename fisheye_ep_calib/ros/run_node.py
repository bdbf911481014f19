"""Runs a node as a program until it is interrupted."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from fisheye_ep_calib.errors import CalibrationError
from fisheye_ep_calib.plain_text import one_line
from fisheye_ep_calib.ros.parameter_names import with_parameters
from fisheye_ep_calib.ros.spinning import spin_until


class NodeOwner(Protocol):
    """What has a node to spin, and ends all that it started when it is closed."""

    node: Node

    def close(self) -> None: ...


def run_node(name: str, make: Callable[[], NodeOwner], arguments: list[str] | None) -> int:
    """The program's exit code: 0 once interrupted, 2 where it was given something that cannot be used."""
    ended = _Bell()
    # rclpy's own handler shuts the context down beside the threads that use it, and now and then the process crashes.
    ended.ring_at(signal.SIGINT, signal.SIGTERM)
    owner = None
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        owner = make()
        _serve_until(ended, owner.node)
    except CalibrationError as error:
        print(f"{name}: {one_line(with_parameters(str(error)))}", file=sys.stderr)
        return error.exit_code
    finally:
        if owner is not None:
            owner.close()
        rclpy.try_shutdown()
    return 0


class _Bell:
    """Rung from any thread or by a signal, whichever thread the system interrupts for it."""

    def __init__(self) -> None:
        self._listening, self._ringing = os.pipe()
        os.set_blocking(self._ringing, False)

    def ring_at(self, *signals: int) -> None:
        """Only in the main thread."""
        signal.set_wakeup_fd(self._ringing)
        for number in signals:
            signal.signal(number, lambda *_: None)

    def ring(self) -> None:
        os.write(self._ringing, b"\0")

    def wait(self) -> None:
        os.read(self._listening, 1)


def _serve_until(ended: _Bell, node: Node) -> None:
    """Serve the node until the bell rings; raises what a callback raised."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stopping = threading.Event()
    with ThreadPoolExecutor(1, "spin") as pool:
        spinning = pool.submit(spin_until, executor, stopping)
        spinning.add_done_callback(lambda _: ended.ring())
        ended.wait()
        stopping.set()
    executor.shutdown()
    spinning.result()
