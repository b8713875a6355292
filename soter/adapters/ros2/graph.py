"""SOTER's part of the ROS graph: a context, an executor in a thread, and checks of other nodes."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import nullcontext
from typing import Any, Final

import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from rclpy.context import Context
from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible

from soter.adapters.ros2.executor import GuardedNode, executor_in, spin
from soter.adapters.ros2.simulator import loopback

KINDS: Final = {False: "geometry_msgs/msg/Twist", True: "geometry_msgs/msg/TwistStamped"}
"""The type of a velocity, by whether it is stamped."""


def velocity_type(*, stamped: bool) -> Any:
    """Return the class of velocity messages."""
    return TwistStamped if stamped else Twist


def make_velocity(forward_m_s: float, turn_rad_s: float, stamp: Any, *, stamped: bool) -> Any:
    """Return a velocity as a message; `stamp` is a builtin_interfaces/Time, used only if `stamped`."""
    message = velocity_type(stamped=stamped)()
    twist = message.twist if stamped else message
    twist.linear.x, twist.angular.z = forward_m_s, turn_rad_s
    if stamped:
        message.header.stamp = stamp
    return message


_PATIENT: Final[dict[str, Any]] = {"depth": 1, "deadline": Infinite, "liveliness_lease_duration": Infinite}

SENSOR: Final = QoSProfile(**_PATIENT, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For subscriptions: matches publishers of every kind, and keeps only the latest message."""

COMMAND: Final = QoSProfile(**_PATIENT, reliability=ReliabilityPolicy.RELIABLE)
"""For publishers: matches subscribers of every kind, and keeps only the latest message."""

LATCHED: Final = QoSProfile(
    **_PATIENT, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
"""For messages that later subscribers must get too."""

NODE_NAME: Final = "soter"

_UNNAMED: Final = "_NODE_NAME_UNKNOWN_"
_END_TIMEOUT_S: Final = 5.0


class Graph:
    """A ROS context with its nodes and its executor, apart from code that calls `rclpy.init` itself.

    Callbacks of its nodes run in one background thread, one after another. Nodes publish from any thread.

    Args:
        domain_id: the ROS domain; None for that of the environment.
        use_sim_time: whether its nodes follow `/clock`.
        on_loopback: whether DDS stays on this host.
    """

    def __init__(self, domain_id: int | None, *, use_sim_time: bool, on_loopback: bool) -> None:
        self._use_sim_time: Final = use_sim_time
        self._context: Final = Context()
        self._nodes: Final[list[Node]] = []
        self._on_loopback: Final = on_loopback
        with self._bound():
            rclpy.init(context=self._context, domain_id=domain_id)
        self._executor: Final = executor_in(self._context)
        self._closed = False
        self._thread: Final = threading.Thread(target=self._run, name="ros2", daemon=True)
        self._thread.start()

    def node(self, namespace: str) -> GuardedNode:
        """Return a new node for one robot, with its callbacks running."""
        with self._bound():
            node = GuardedNode(
                NODE_NAME, context=self._context, namespace=namespace, use_global_arguments=False,
                enable_rosout=False, start_parameter_services=False,
                parameter_overrides=[Parameter("use_sim_time", value=self._use_sim_time)],
            )  # fmt: skip
        self._nodes.append(node)
        self._executor.add_node(node)
        return node

    def close(self) -> None:
        """End everything: the executor, its thread, the nodes, the context. Idempotent."""
        if self._closed:
            return
        self._closed = True
        # The thread ends first: it would count a shutdown during a spin as a failed message. The task wakes it up.
        self._executor.create_task(lambda: None)
        self._thread.join(_END_TIMEOUT_S)
        self._executor.shutdown()
        while self._nodes:
            self._nodes.pop().destroy_node()
        self._context.try_shutdown()

    def _bound(self) -> Any:
        return loopback() if self._on_loopback else nullcontext()

    def _run(self) -> None:
        spin(self._executor, lambda: self._closed or not self._context.ok())


def heard_wrongly(node: Node, topic: str, type_name: str, profile: QoSProfile) -> list[str]:
    """Return what is wrong with the publishers of a topic that is subscribed to here, one line each, by name."""
    return _wrong(node.get_publishers_info_by_topic(topic), topic, type_name, "publishes", profile, hears=True)


def said_wrongly(node: Node, topic: str, type_name: str, profile: QoSProfile) -> list[str]:
    """Return what is wrong with the subscribers of a topic that is published here, one line each, by name."""
    return _wrong(node.get_subscriptions_info_by_topic(topic), topic, type_name, "subscribes to", profile, hears=False)


def publishers(node: Node, topic: str, nameless: bool = True) -> list[str]:
    """Return the names of all nodes that publish a topic; if not `nameless`, only of those with a known name."""
    names = {_name(each) for each in node.get_publishers_info_by_topic(topic)}
    return sorted(name for name in names if nameless or _UNNAMED not in name)


def all_named(node: Node, *topics: str) -> bool:
    """Return whether the names of all publishers of these topics are known; a node is found before its name."""
    return not any(_UNNAMED in name for topic in topics for name in publishers(node, topic))


def _name(info: Any) -> str:
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _wrong(
    found: Sequence[Any], topic: str, type_name: str, verb: str, profile: QoSProfile, *, hears: bool
) -> list[str]:
    if not found:
        return [f"no node {verb} {topic}"]
    problems = []
    for info in found:
        theirs = info.qos_profile
        if info.topic_type != type_name:
            problems.append(f"{_name(info)} {verb} {topic} as {info.topic_type}, SOTER as {type_name}")
            continue
        fits, reason = qos_check_compatible(theirs, profile) if hears else qos_check_compatible(profile, theirs)
        if fits == QoSCompatibility.ERROR:
            problems.append(f"{_name(info)} {verb} {topic} with a quality of service that does not match: {reason}")
    return problems
