"""A node that is never idle, for tests: it sends itself the signal whose number it is given."""

from __future__ import annotations

import os
import sys

from rclpy.node import Node

from fisheye_ep_calib.ros.patient_node import PatientNode
from fisheye_ep_calib.ros.run_node import run_node


class BusyNode:
    def __init__(self) -> None:
        self.node = Node("busy")
        self._patient = PatientNode(self.node)
        self._patient.start()
        self._calls = 0
        self.node.create_timer(0.0005, self._work)

    def _work(self) -> None:
        self._calls += 1
        if self._calls == 20:
            os.kill(os.getpid(), int(sys.argv[1]))
        sum(range(20000))

    def close(self) -> None:
        self._patient.close()
        self.node.destroy_node()


sys.exit(run_node("busy", BusyNode, []))
