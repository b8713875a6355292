"""Harness of the conformance kit for this adapter: fresh simulated robots, and ways to break the link to them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from soter.adapters.ros2.backend import Ros2Backend
from soter.adapters.ros2.graph import COMMAND, LATCHED, SENSOR, Graph
from soter.adapters.ros2.options import Ros2Config, Ros2RobotOptions
from soter.adapters.ros2.simulator import Domain, Ros2Simulator
from soter.adapters.velocity_controlled.harness import (
    VelocityControlledHarness,
    VelocityControlledRelay,
)
from soter.conformance import WIDE_ROOMS, in_wide_rooms
from soter.conformance.harness import LIMITS, Harness, Killable, Switchable
from soter.conformance.impaired import Line
from soter.onboard.wire import CMD_VEL, CMD_VEL_AC, CMD_VEL_SC, GATE, ORDER
from soter.sdk import Fleet, RobotSpec, Waypoint

FAR: Final = "/far"
"""Prefix of a robot's namespace on SOTER's side of the relay."""


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


class Ros2Relay(VelocityControlledRelay):
    """Passes messages on, both ways.

    Args:
        domain_id: the ROS domain.
        namespaces: by robot id, the real namespace, which SOTER finds under `FAR`.
    """

    def __init__(self, domain_id: int, namespaces: dict[int, str]) -> None:
        super().__init__()
        self._graph: Final = Graph(domain_id, use_sim_time=False, on_loopback=True)
        self._namespaces: Final = namespaces
        self._node: Final = self._graph.node("/relay")
        for robot_id, namespace in namespaces.items():
            for topic in _TOPICS:
                self._connect(robot_id, self._node, namespace, topic)

    def intrude(self, robot_id: int, seconds: float, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        # A node that publishes counts as one that may move the robot: at the end it leaves.
        said = [
            self._node.create_publisher(Twist, f"{side}{self._namespaces[robot_id]}/{CMD_VEL}", COMMAND)
            for side in ("", FAR)
        ]

        def drive(message: bytes) -> None:
            for each in said:
                each.publish(message)

        def leave(_: bytes) -> None:
            for each in said:
                self._node.destroy_publisher(each)

        twist = Twist(linear=Vector3(x=speed_m_s), angular=Vector3(z=yaw_rate_rad_s))
        self.repeat(Line(robot_id, drive), serialize_message(twist), seconds)
        self.say(Line(robot_id, leave), b"", after_s=seconds)

    def close(self) -> None:
        super().close()
        self._graph.close()

    def _connect(self, robot_id: int, node: Any, namespace: str, topic: _Topic) -> None:
        real, far = f"{namespace}/{topic.name}", f"{FAR}{namespace}/{topic.name}"
        heard, said = (far, real) if topic.to_robot else (real, far)
        line = Line(robot_id, node.create_publisher(topic.kind, said, topic.said).publish)
        node.create_subscription(topic.kind, heard, lambda message: self.pass_on(line, message), topic.heard, raw=True)


class Ros2Harness(VelocityControlledHarness):
    """Opens simulated robots behind a relay, in a ROS domain of their own, new ones for every fleet."""

    name = "ros2"
    connect_timeout_s = 20.0
    # Topics have types: nothing that makes no sense gets through.
    garble = Harness.garble

    def __init__(self) -> None:
        super().__init__()
        self._held: Domain | None = None

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        self.relay = Ros2Relay(simulator.domain_id, simulator.namespaces)
        self._seen_by_soter = simulator.domain_id, simulator.truth, FAR, simulator.namespaces
        self.fleet = self.second()
        return self.fleet

    def second(self) -> Fleet:
        return _fleet(*self._seen_by_soter, self.asked(len(self._seen_by_soter[-1])))

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        argument = json.dumps([simulator.domain_id, simulator.truth, simulator.namespaces])
        return self.driven(f"{__name__}:open_given", argument, target)

    def switchable(self) -> Switchable:
        """Return a fleet of one fresh robot without a relay and without ground truth, to be switched off and on."""
        # No other program may get its domain while its own is off.
        self._held = domain = Domain()
        self.fleet = _fleet(domain.id, None, "", self._start(1, domain.id).namespaces, self.asked(1))
        return Switchable(self.fleet, self._end, lambda: self._start(1, domain.id))

    def killable(self) -> Killable:
        """Return a fleet of one robot that the backend simulates itself, and the call that kills its base."""
        self.fleet = fleet = Ros2Backend().open(Ros2Config(workspace=WIDE_ROOMS, limits=LIMITS), self.specs(1))
        assert isinstance(fleet.simulator, Ros2Simulator)
        return Killable(fleet, fleet.simulator.world.kill)

    def close(self) -> None:
        super().close()
        if self._held is not None:
            self._held.close()

    def _end(self) -> None:
        # Killed, they are gone at once; each that tells the others that it goes takes 0.4 s.
        if isinstance(self.simulator, Ros2Simulator):
            for process in (*self.simulator.muxes.values(), self.simulator.world):
                process.kill()
                process.wait()
        super()._end()

    def _start(self, robots: int, domain_id: int | None = None) -> Ros2Simulator:
        simulator = Ros2Simulator(WIDE_ROOMS, self.specs(robots), domain_id=domain_id, limits=LIMITS)
        self._watch(simulator)
        return simulator


def open_given(argument: str) -> Fleet:
    """Open the first robot at an address that is given as JSON; called in the kit's driver process."""
    domain_id, truth, namespaces = json.loads(argument)
    return _fleet(domain_id, truth, "", {int(number): name for number, name in namespaces.items()}, in_wide_rooms(1))


def _fleet(
    domain_id: int, truth: str | None, before: str, namespaces: dict[int, str], robots: Sequence[RobotSpec]
) -> Fleet:
    config = Ros2Config(
        workspace=WIDE_ROOMS,
        robots={robot_id: Ros2RobotOptions(namespace=before + name) for robot_id, name in namespaces.items()},
        domain_id=domain_id,
        truth=truth,
        use_sim_time=True,
        loopback=True,
    )
    return Ros2Backend().open(config, robots)
