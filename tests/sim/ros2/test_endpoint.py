"""The simulated base: what it says, what it does with velocities, and when it stops."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from soter.adapters.velocity_controlled.motion import seconds
from soter.adapters.velocity_controlled.robot import wait_for
from soter.sdk import RuleLimits
from soter.sdk.wire import describe
from tests.adapters.velocity_controlled.base import says_where_it_stands, stops_by_itself
from tests.adapters.velocity_controlled.driving import ROOM, SPECS
from tests.adapters.velocity_controlled.processes import end_with_their_parent

pytestmark = pytest.mark.rclpy


class Client:
    """Whoever drives the base: hears everything, says velocities."""

    def __init__(self, domain_id: int) -> None:
        from geometry_msgs.msg import Twist
        from nav_msgs.msg import Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import BatteryState

        from soter.adapters.ros2.graph import SENSOR, Graph

        self.graph = Graph(domain_id, use_sim_time=False, on_loopback=True)
        node = self.graph.node("/client")
        self.odometry: list[Any] = []
        self.clock: list[Any] = []
        self.battery: list[Any] = []
        node.create_subscription(Odometry, "/robot1/odom", self.odometry.append, SENSOR)
        node.create_subscription(Clock, "/clock", self.clock.append, SENSOR)
        node.create_subscription(BatteryState, "/robot1/battery_state", self.battery.append, SENSOR)
        self._velocity = node.create_publisher(Twist, "/robot1/cmd_vel", 1)

    def say(self, speed_m_s: float) -> None:
        from geometry_msgs.msg import Twist, Vector3

        self._velocity.publish(Twist(linear=Vector3(x=speed_m_s)))

    def wait_for(self, holds: Callable[[], bool], timeout_s: float = 30.0) -> bool:
        return wait_for(holds, timeout_s)

    @property
    def speed_m_s(self) -> float:
        return float(self.odometry[-1].twist.twist.linear.x) if self.odometry else math.nan


@pytest.fixture
def domain_id() -> Iterator[int]:
    from soter.adapters.ros2.simulator import Domain

    domain = Domain()
    yield domain.id
    domain.close()


@pytest.fixture
def face(domain_id: int) -> Iterator[subprocess.Popen[bytes]]:
    """The face alone, without a mux in front of it."""
    from soter.adapters.ros2.simulator import environment

    process = subprocess.Popen(
        [sys.executable, "-m", "soter_sim.ros2", "--namespaces", "1=/robot1", "--parent", str(os.getpid())],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**environment(), "ROS_DOMAIN_ID": str(domain_id), "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    with process:
        assert process.stdin is not None
        process.stdin.write(describe(ROOM.with_robots(1), SPECS[:1], RuleLimits()))
        process.stdin.close()
        yield process
        process.terminate()


@pytest.fixture
def client(domain_id: int, face: subprocess.Popen[bytes]) -> Iterator[Client]:
    client = Client(domain_id)
    assert client.wait_for(lambda: len(client.odometry) > 5 and len(client.clock) > 5 and bool(client.battery))
    yield client
    client.graph.close()


def test_it_says_where_it_is_at_its_rates(client: Client) -> None:
    assert client.wait_for(lambda: len(client.odometry) >= 45)
    says_where_it_stands(client.odometry, client.battery[-1].percentage)
    stamps_s = [seconds(each.clock) for each in client.clock]
    assert stamps_s == sorted(stamps_s)
    assert stamps_s[0] >= 1000.0


def test_without_new_velocities_it_stops(client: Client) -> None:
    def driven() -> bool:
        client.say(0.2)
        return client.speed_m_s > 0.19

    stops_by_itself(client.odometry, lambda: client.wait_for(driven))


def test_nan_stops_it_and_nothing_makes_it_faster_than_it_is(client: Client) -> None:
    def at(speed_m_s: float, seen_m_s: float) -> bool:
        def seen() -> bool:
            client.say(speed_m_s)
            return client.speed_m_s == pytest.approx(seen_m_s)

        return client.wait_for(seen)

    assert at(9.0, 0.22)
    assert at(math.nan, 0.0)
    assert at(-9.0, -0.22)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_when_it_is_told_to(client: Client, face: subprocess.Popen[bytes], number: int) -> None:
    face.send_signal(number)
    assert face.wait(5.0) == 0


def test_it_ends_with_its_parent() -> None:
    from soter.adapters.ros2.simulator import environment

    end_with_their_parent("soter.adapters.ros2.simulator.Ros2Simulator", environment())
