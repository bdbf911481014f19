"""Qualities of service that are used in several places."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

# Whoever subscribes later still gets the last message.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)

# One message an image, each kept until it is on its way: with a depth of one, a busy sender loses some to the next.
LATCHED_STREAM = QoSProfile(
    depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE
)


def overridden(node: Node, topic: str, entity: str) -> QoSOverridingOptions | None:
    """What parameters under qos_overrides.TOPIC.ENTITY change; None where there are none.

    topic: resolved. entity: "publisher" or "subscription". Only what was given is declared: the rest follows from who
    else is on the topic.
    """
    given = node.get_parameters_by_prefix(f"qos_overrides.{topic}.{entity}")
    kinds = [QoSPolicyKind[name.upper()] for name in sorted(given) if name.upper() in QoSPolicyKind.__members__]
    return QoSOverridingOptions(kinds) if kinds else None
