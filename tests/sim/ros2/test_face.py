"""The simulated base: what it says, what it does with velocities, and when it stops."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from soter.sdk import RobotSpec
from soter.workspace import Box, RobotPlace, Workspace
from tests.streamed.processes import alive

pytestmark = pytest.mark.rclpy

ROOM = Workspace(8.0, 6.0, (), (RobotPlace(1, 2.0, 2.5, Box(1.9, 2.4, 2.1, 2.6), 0.4),))
SPECS = [RobotSpec(1, 2.0, 2.5, 0.4, 0.8)]


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

    def wait_for(self, holds: Callable[[], bool], timeout_s: float = 10.0) -> bool:
        return self.graph.wait_for(holds, timeout_s)

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
    from pydantic import TypeAdapter

    from soter.adapters.ros2.loopback import environment

    process = subprocess.Popen(
        [sys.executable, "-m", "soter_sim.ros2", "--namespaces", "1=/robot1", "--parent", str(os.getpid())],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**environment(), "ROS_DOMAIN_ID": str(domain_id), "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    with process:
        assert process.stdin is not None
        process.stdin.write(TypeAdapter(tuple[Workspace, list[RobotSpec]]).dump_json((ROOM, SPECS)))
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
    before, began_s = len(client.odometry), time.monotonic()
    assert client.wait_for(lambda: len(client.odometry) >= before + 45)
    assert 0.8 * 30.0 < 45 / (time.monotonic() - began_s) < 1.2 * 30.0
    last = client.odometry[-1]
    position, turned = last.pose.pose.position, last.pose.pose.orientation
    assert (position.x, position.y) == pytest.approx((2.0, 2.5))
    assert 2.0 * math.atan2(turned.z, turned.w) == pytest.approx(0.4)
    assert (last.header.frame_id, last.child_frame_id) == ("robot1/odom", "robot1/base_link")
    assert 0.79 < client.battery[-1].percentage <= 1.0, "it stands on its charger"
    stamps = [each.clock.sec + 1e-9 * each.clock.nanosec for each in client.clock]
    assert stamps == sorted(stamps)
    assert stamps[0] >= 1000.0


def test_without_new_velocities_it_stops(client: Client) -> None:
    def driven() -> bool:
        client.say(0.2)
        return client.speed_m_s > 0.19

    assert client.wait_for(driven)
    silent_s = time.monotonic()
    assert client.wait_for(lambda: client.speed_m_s == 0.0, 2.0)
    # The time-out, braking, and what a busy host adds.
    assert 0.1 < time.monotonic() - silent_s < 0.2 + 0.2 + 0.3


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


def test_it_ends_with_its_parent(domain_id: int) -> None:
    from soter.adapters.ros2.loopback import environment

    program = (
        "import json, os, subprocess, sys, time\n"
        "from soter.adapters.ros2.simulator import Simulator\n"
        "from tests.sim.ros2.test_face import ROOM, SPECS\n"
        "simulator = Simulator(ROOM, SPECS)\n"
        "print(simulator.world.pid, *(each.pid for each in simulator.muxes.values()), flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    env = {**environment(), "PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60, env=env, check=False)
    assert done.returncode == -signal.SIGKILL
    left = [int(number) for number in done.stdout.split()]
    assert len(left) == 2
    until_s = time.monotonic() + 10.0
    while any(map(alive, left)):
        assert time.monotonic() < until_s
        time.sleep(0.05)
