"""Real processes for tests: programs that are started and watched, and a ROS node of the test itself."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Whoever subscribes later still gets the last message.
LATCHED = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE = 120.0  # seconds; only a failing test on a slow machine waits that long


def wait_for(condition: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    """The condition's first true value."""
    give_up = time.monotonic() + patience
    while time.monotonic() < give_up:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"waited {patience:.0f} s in vain for {what}")


def at_this_load(seconds: float) -> float:
    """So many seconds of a machine with a core to spare: as many times longer as programs now share a core."""
    wanting = float(Path("/proc/loadavg").read_text().split()[3].partition("/")[0])
    return seconds * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1), wanting / (os.cpu_count() or 1))


def kept(output: str) -> int:
    """The number of the last view that was reported as kept, or taken up."""
    numbers = re.findall(r"view (\d+) kept|going on with (\d+) views", output)
    return max((int(one or other) for one, other in numbers), default=0)


class Program:
    """A process whose output is collected."""

    def __init__(self, command: list[str], **environment: str) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONFAULTHANDLER": "1", **environment},
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def output(self) -> str:
        return "".join(self.lines)

    def said(self, text: str) -> bool:
        return text in self.output

    def wait_to_say(self, text: str) -> None:
        try:
            wait_for(lambda: self.said(text) or self.process.poll() is not None, repr(text))
        except AssertionError as error:
            self.process.send_signal(signal.SIGABRT)  # it says what each of its threads is doing
            raise AssertionError(f"{error}\n{self.wait()}") from None
        if self.process.poll() is not None:
            self._reader.join(5)  # what it said last may still be on its way here
        assert self.said(text), f"ended without saying {text!r}:\n{self.output}"

    def wait(self) -> str:
        """All it said until its end."""
        self.process.wait(PATIENCE)
        self._reader.join(5)
        return self.output

    def interrupt(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send a signal; exit code and seconds until the end."""
        began = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(PATIENCE)
        self._reader.join(5)
        return code, time.monotonic() - began

    def end(self) -> None:
        """Kill it if it still runs; pytest shows its output beside a failed test."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join(5)
        print(self.output)

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as stream:
            for line in stream:
                self.lines.append(line)


class Probe:
    """A ROS node of the test itself, in the domain under test."""

    def __init__(self, domain: int) -> None:
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self.node = rclpy.create_node("probe", context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        with contextlib.suppress(rclpy.executors.ExternalShutdownException):
            self._executor.spin()

    def collect(self, kind: Any, topic: str, quality: Any, limit: int = 2**31) -> list[Any]:
        """A list that fills with the topic's messages, the newest last."""
        received: list[Any] = []

        def receive(message: Any) -> None:
            received.append(message)
            del received[:-limit]

        self.node.create_subscription(kind, topic, receive, quality)
        return received

    def call(self, kind: Any, service: str, request: Any = None) -> Any:
        client = self.node.create_client(kind, service)
        wait_for(client.service_is_ready, f"service {service}")
        # Fast DDS drops an answer that is ready before the server has found where the client listens: ask again then.
        futures: list[Any] = []

        def answered() -> Any:
            if time.monotonic() > began + 20 * len(futures):
                futures.append(client.call_async(request or kind.Request()))
            return [future for future in futures if future.done()]

        began = time.monotonic()
        done = wait_for(answered, f"an answer of {service}")
        self.node.destroy_client(client)
        return done[0].result()

    def close(self) -> None:
        self._context.try_shutdown()
        self._thread.join(5)
        self._executor.shutdown()
        self.node.destroy_node()
