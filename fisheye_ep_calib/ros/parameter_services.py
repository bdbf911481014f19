"""A node's services for its parameters: anybody may call them with anything, is answered, and does not end the node."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.plain_text import one_line, shown

_LONGEST = 300  # characters of a refusal, which repeats what was sent
_QUIET_SECONDS = 1.0  # after a refusal, in which others are answered and not told


def guard_services(node: Node) -> None:
    """Of the services that the node has by now: what rclpy raises over a call is its answer, and a line in the log."""
    for service in node.services:
        service.callback = _guarded(node, service.callback)


def _guarded(node: Node, callback: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def answer(request: Any, response: Any) -> Any:
        names = [parameter.name for parameter in getattr(request, "parameters", ())]
        try:
            if "" in names:  # rclpy takes it and says that all is well
                raise InputError("a parameter has no name")
            answered = callback(request, response)
        except Exception as error:  # of rclpy, over a type that there is not, for one
            answered = _refusal(type(response)(), len(names), first_line(error))
        results = [*getattr(answered, "results", ()), *([answered.result] if hasattr(answered, "result") else ())]
        refused = [(n, result) for n, result in enumerate(results) if getattr(result, "successful", True) is False]
        for number, result in refused:
            result.reason = _reason(node, names if len(results) < len(names) else names[number : number + 1], result)
        if refused:
            text = f"parameters stay as they are: {refused[0][1].reason}"
            node.get_logger().warning(text, throttle_duration_sec=_QUIET_SECONDS)
        return answered

    return answer


def _refusal(response: Any, count: int, reason: str) -> Any:
    """An answer that refuses ``count`` parameters where there is a way to say so, an empty one otherwise."""
    if hasattr(response, "results"):
        response.results = [SetParametersResult(successful=False, reason=reason) for _ in range(count)]
    elif hasattr(response, "result"):
        response.result = SetParametersResult(successful=False, reason=reason)
    return response


def _reason(node: Node, names: Sequence[str], result: SetParametersResult) -> str:
    """Why these parameters are not changed, in a line that names the one it is about; rclpy does so now and then."""
    unknown = next((name for name in names if not node.has_parameter(name)), None)
    if unknown is not None:
        return one_line(f"{shown(unknown)} is no parameter of this node", _LONGEST)
    reason = result.reason.replace("Type.", "")
    if "read-only" in reason:
        reason = f"{reason} It is given when the node is started."
    named = any(name in reason for name in names)
    return one_line(reason if named or not names else f"{names[0]}: {reason}", _LONGEST)
