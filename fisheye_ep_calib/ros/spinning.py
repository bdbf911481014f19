"""Serves nodes on threads that end when they are told to."""

from __future__ import annotations

import threading

from rclpy.executors import Executor

LOOK = 0.2  # seconds between looks whether to end, where nothing else wakes the thread


def spin_until(executor: Executor, stopping: threading.Event) -> None:
    """Serve until stopping is set; raises what a callback raised.

    Only then may the executor be shut down: that takes away what its thread waits on.
    """
    while not stopping.is_set():
        executor.spin_once(LOOK)
