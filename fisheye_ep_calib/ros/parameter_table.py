"""A table of ROS parameters: declared, described, bounded and checked in one place."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from fisheye_ep_calib.errors import InputError, first_line
from fisheye_ep_calib.plain_text import shown
from fisheye_ep_calib.ros.parameter_services import guard_services


@dataclass(frozen=True)
class Entry:
    """One parameter; its type is its default's. low, high: the range of a number. choices: of a text.

    live: whether it may be changed while the node runs.
    """

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    live: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """What ``ros2 param describe`` tells."""
        descriptor = ParameterDescriptor(
            name=self.name,
            description=self.description,
            additional_constraints=f"one of: {', '.join(self.choices)}" if self.choices else "",
            read_only=not self.live,
            # A double written as `1` arrives as an integer, which a declared type would refuse.
            dynamic_typing=isinstance(self.default, float),
        )
        if isinstance(self.default, float):
            low, high = self._bounds()
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif isinstance(self.default, int) and not isinstance(self.default, bool):
            low, high = self._bounds()
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        return descriptor

    def complaint(self, value: Any) -> str:
        """Why the value cannot be taken, or an empty text."""
        if isinstance(self.default, float):
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                return f"must be a number, not {shown(value)}"
            low, high = self._bounds()
            if not low <= value <= high:
                return f"must lie between {low:g} and {high:g}, not {value:g}"
        if self.choices and value not in self.choices:
            return f"must be one of {', '.join(self.choices)}, not {shown(value)}"
        return ""

    def _bounds(self) -> tuple[float, float]:
        low = -(2.0**31) if self.low is None else self.low
        high = 2.0**31 if self.high is None else self.high
        return float(low), float(high)


OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")  # parameters that rclpy declares
_QUALITIES = "qos_overrides."  # what parameters that change a topic's quality of service begin with


def node_with_what_was_given(name: str, kind: type[Node] = Node) -> Node:
    """A node on which every parameter that was given at the start is declared, known or not, for a ParameterTable.

    kind: its class. Raises InputError.
    """
    try:
        node = kind(name, automatically_declare_parameters_from_overrides=True)
    except ValueError as error:  # of an empty list, which has no type; rclpy does not say whose
        raise InputError(f"a parameter has no value: give it one, or leave it out ({first_line(error)})") from None
    guard_services(node)
    return node


class ParameterTable:
    """Entries declared on a node; reads are of the entry's own type."""

    def __init__(self, node: Node) -> None:
        """node: made by ``node_with_what_was_given``."""
        self._node = node
        self._entries: dict[str, Entry] = {}
        self._given = frozenset(node.get_parameters_by_prefix(""))
        node.add_on_set_parameters_callback(self._check)

    def declare(self, entries: Iterable[Entry], prefix: str = "") -> None:
        """Declare entries, under ``prefix.`` if given. Raises InputError in one line for a value out of bounds."""
        for entry in entries:
            name = f"{prefix}.{entry.name}" if prefix else entry.name
            self._entries[name] = entry
            if name in self._given:  # now with its description and its bounds
                self._node.undeclare_parameter(name)
            try:
                self._node.declare_parameter(name, entry.default, entry.descriptor())
            except ParameterException as error:
                raise InputError(_reason(name, error)) from None

    def __getitem__(self, name: str) -> Any:
        value = self._node.get_parameter(name).value
        default = self._entries[name].default
        if isinstance(default, float):
            return float(value)
        return list(value) if isinstance(default, list) else value

    def image_topic(self, name: str, default: str = "") -> tuple[str, bool]:
        """The topic of images that a parameter names, and whether they are compressed. Raises InputError.

        As image_transport has it: the name without its transport is resolved and remapped, and what belongs to it, the
        transport or camera_info, comes beside what that gives.
        """
        given = str(self[name]) or default
        base = given.removesuffix("/compressed").rstrip("/")
        if not base:
            raise InputError(f"parameter {name}: {given!r} is no image topic")
        try:
            resolved = str(self._node.resolve_topic_name(base))
        except ValueError as error:
            raise InputError(f"parameter {name}: {given!r} is no image topic: {first_line(error)}") from None
        compressed = any(name.endswith("/compressed") for name in (given.rstrip("/"), resolved))
        return resolved.removesuffix("/compressed"), compressed

    def is_live(self, name: str) -> bool:
        """Whether this is a parameter of the table that may change while the node runs."""
        return name in self._entries and self._entries[name].live

    def warn_of_unknown(self) -> None:
        """Tell of names that were given at the start and mean nothing: misspelt, most likely."""
        for name in sorted(self._given - self._entries.keys() - set(OF_EVERY_NODE)):
            if name.startswith(_QUALITIES):
                continue
            self._node.undeclare_parameter(name)
            self._node.get_logger().warning(f"parameter {name} is not known and has no effect")

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            entry = self._entries.get(parameter.name)
            complaint = entry.complaint(parameter.value) if entry else ""
            if complaint:
                return SetParametersResult(successful=False, reason=f"{parameter.name} {complaint}")
        return SetParametersResult(successful=True)


def _reason(name: str, error: ParameterException) -> str:
    """The sentence in an rclpy exception, which ends with the parameter's name."""
    text = str(error).partition("Reason: ")[2] or str(error)
    return f"parameter {name}: {text.removesuffix(f': {name}').removeprefix(f'{name} ')}"
