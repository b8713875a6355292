"""A bad link, for tests: a relay between SOTER and its robots that delays, loses, repeats and swaps messages."""

from __future__ import annotations

import heapq
import random
import threading
import time
from collections.abc import Iterable
from itertools import count
from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from soter.adapters.ros2.graph import COMMAND, LATCHED, SENSOR, Graph
from soter.mux.wire import CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER

FAR: Final = "/far"
"""What stands before a robot's namespace on SOTER's side of the relay."""


class _Topic(NamedTuple):
    name: str
    kind: Any
    heard: QoSProfile
    said: QoSProfile
    to_robot: bool


_TOPICS: Final = (
    _Topic("odom", Odometry, SENSOR, COMMAND, to_robot=False),
    _Topic("battery_state", BatteryState, SENSOR, COMMAND, to_robot=False),
    _Topic(GATE, String, LATCHED, LATCHED, to_robot=False),
    _Topic(ORDER, String, LATCHED, LATCHED, to_robot=True),
    _Topic(CMD_VEL_AC, Twist, SENSOR, COMMAND, to_robot=True),
    _Topic(CMD_VEL_SC, Twist, SENSOR, COMMAND, to_robot=True),
)


class Relay:
    """Passes messages on, both ways, without looking into them.

    Args:
        domain_id: of ROS.
        namespaces: by robot, where it really is; SOTER finds it under `FAR`.

    Attributes:
        delay_s: every message is delivered so much later.
        loss: this share of all messages is lost.
        duplicate: this share is delivered twice.
        reorder: this share is delivered after the one that followed.
        cut: robots whose messages are all lost.
    """

    def __init__(self, domain_id: int, namespaces: dict[int, str]) -> None:
        self.delay_s = self.loss = self.duplicate = self.reorder = 0.0
        self.cut: frozenset[int] = frozenset()
        self._random: Final = random.Random(0)
        self._due: Final[list[tuple[float, int, Any, bytes]]] = []
        self._numbers: Final = count()
        self._changed: Final = threading.Condition()
        self._done = False
        self._graph: Final = Graph(domain_id, use_sim_time=False, on_loopback=True)
        self._thread: Final = threading.Thread(target=self._deliver, name="relay", daemon=True)
        self._thread.start()
        node = self._graph.node("/relay")
        self._lines: Final = [
            _Line(self, robot_id, node, name, topic) for robot_id, name in namespaces.items() for topic in _TOPICS
        ]

    def close(self) -> None:
        """End the threads. Idempotent."""
        with self._changed:
            self._done = True
            self._changed.notify()
        self._thread.join()
        self._graph.close()

    def pass_on(self, line: _Line, message: bytes) -> None:
        """Deliver a message that has arrived, as it is to be. Called by the graph's thread."""
        chance = self._random.random
        if line.robot_id in self.cut or chance() < self.loss:
            return
        messages = [message] * (2 if chance() < self.duplicate else 1)
        if chance() < self.reorder and line.held is None:
            line.held = message
            return
        if line.held is not None:
            messages.append(line.held)
            line.held = None
        self._send(line, messages)

    def _send(self, line: _Line, messages: Iterable[bytes]) -> None:
        at_s = time.monotonic() + self.delay_s
        with self._changed:
            for message in messages:
                heapq.heappush(self._due, (at_s, next(self._numbers), line.publisher, message))
            self._changed.notify()

    def _deliver(self) -> None:
        with self._changed:
            while not self._done:
                left_s = self._due[0][0] - time.monotonic() if self._due else None
                if left_s is None or left_s > 0.0:
                    self._changed.wait(left_s)
                    continue
                _, _, publisher, message = heapq.heappop(self._due)
                publisher.publish(message)


class _Line:
    """One topic of one robot."""

    def __init__(self, relay: Relay, robot_id: int, node: Any, namespace: str, topic: _Topic) -> None:
        real, far = f"{namespace}/{topic.name}", f"{FAR}{namespace}/{topic.name}"
        heard, said = (far, real) if topic.to_robot else (real, far)
        self.robot_id: Final = robot_id
        self.held: bytes | None = None
        self.publisher: Final = node.create_publisher(topic.kind, said, topic.said)
        node.create_subscription(topic.kind, heard, lambda message: relay.pass_on(self, message), topic.heard, raw=True)
