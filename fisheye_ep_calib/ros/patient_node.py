"""What takes its time, beside the node that receives images: services that wait, drivers, disks."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger

from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.ros.parameter_names import with_parameters
from fisheye_ep_calib.ros.spinning import spin_until

THREADS = 24  # at most: one for each call that waits, one for a driver's answer, one for the timers


class PatientNode:
    """A hidden node with threads of its own, serving under the visible node's name.

    rclpy's executor of several threads costs each image half as much again and makes it later, so images stay with
    the visible node and one thread.
    """

    def __init__(self, visible: Node) -> None:
        self._visible = visible
        # Names are resolved by the visible node: a remapping of the node's own name must not hit both.
        self.node = Node(
            f"_{visible.get_name()}_services",
            namespace=visible.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = MultiThreadedExecutor(THREADS)
        self.stopping = threading.Event()  # whoever waits here gives up once it is set
        self._thread = threading.Thread(
            target=spin_until, args=(self._executor, self.stopping), daemon=True, name="services"
        )

    def serve(self, name: str, action: Callable[[], Answer], together: bool = False) -> None:
        """A Trigger service ``~/name`` of the visible node. together: calls need not wait for each other."""

        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            done = action()
            response.success, response.message = done.success, with_parameters(done.text)
            return response

        service = self._visible.resolve_service_name(f"~/{name}")
        group = ReentrantCallbackGroup() if together else MutuallyExclusiveCallbackGroup()
        self.node.create_service(Trigger, service, answer, callback_group=group)

    def every(self, seconds: float, action: Callable[[], None]) -> None:
        """Steady time: simulated time may stand still or jump back."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(seconds, action, callback_group=MutuallyExclusiveCallbackGroup(), clock=clock)

    def start(self) -> None:
        self._executor.add_node(self.node)
        self._thread.start()

    def close(self) -> None:
        """Stop serving; an action under way is not waited for."""
        self.stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
