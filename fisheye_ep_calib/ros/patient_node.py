"""What takes its time, beside the node that receives images: services that wait, drivers, disks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.service import Service
from std_srvs.srv import Trigger

from fisheye_ep_calib.live.answer import Answer
from fisheye_ep_calib.ros.parameter_names import with_parameters
from fisheye_ep_calib.ros.spinning import spin_until

THREADS = 24  # at most: one for each call that waits, one for a driver's answer, one for the timers


class VisibleNode(Node):  # type: ignore[misc]  # rclpy's types are not whole
    """A node whose services are listed as its own by ``ros2 node info``, though another's threads serve some."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.served_elsewhere: list[Service] = []
        super().__init__(*arguments, **options)

    @property
    def services(self) -> Iterator[Service]:
        """Those that the executor of this node serves."""
        return (service for service in super().services if service not in self.served_elsewhere)


class _HiddenNode(Node):  # type: ignore[misc]
    """Its executor serves what the visible node leaves to it, beside its own timers and clients."""

    def __init__(self, visible: VisibleNode) -> None:
        self._visible = visible
        # Names are resolved by the visible node: a remapping of the node's own name must not hit both.
        super().__init__(
            f"_{visible.get_name()}_services",
            namespace=visible.get_namespace(),
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )

    @property
    def services(self) -> Iterator[Service]:
        yield from super().services
        yield from self._visible.served_elsewhere


class PatientNode:
    """A hidden node with threads of its own, which serves what the visible node offers and takes its time.

    rclpy's executor of several threads costs each image half as much again and makes it later, so images stay with
    the visible node and one thread.
    """

    def __init__(self, visible: VisibleNode) -> None:
        self._visible = visible
        self.node = _HiddenNode(visible)
        self._executor = MultiThreadedExecutor(THREADS)
        self.stopping = threading.Event()  # whoever waits here gives up once it is set
        self._thread = threading.Thread(
            target=spin_until, args=(self._executor, self.stopping), daemon=True, name="services"
        )

    def serve(self, name: str, action: Callable[[], Answer], together: bool = False) -> None:
        """A Trigger service ``~/name`` of the visible node; before ``start``.

        together: calls need not wait for each other.
        """

        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            done = action()
            response.success, response.message = done.success, with_parameters(done.text)
            return response

        group = ReentrantCallbackGroup() if together else MutuallyExclusiveCallbackGroup()
        service = self._visible.create_service(Trigger, f"~/{name}", answer, callback_group=group)
        self._visible.served_elsewhere.append(service)

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
