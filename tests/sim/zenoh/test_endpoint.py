"""The simulated base on keys: what it says, what it does with velocities, and when it stops."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
import zenoh

from soter.adapters.velocity_controlled.motion import seconds
from soter.adapters.zenoh.messages import BatteryState, Odometry, RosClock, String, Twist, Vector3
from soter.adapters.zenoh.session import SessionOptions
from soter.adapters.zenoh.talk import Ear, Voice
from soter.sdk import RuleLimits
from soter.sdk.program import Faults
from soter.sdk.wire import describe
from tests.adapters.velocity_controlled.base import says_where_it_stands, stops_by_itself
from tests.adapters.velocity_controlled.driving import ROOM, SPECS
from tests.adapters.velocity_controlled.processes import end_with_their_parent
from tests.adapters.zenoh.sessions import opened
from tests.waiting import eventually


def start(*options: str) -> subprocess.Popen[bytes]:
    """The face alone, without a mux in front of it."""
    process = subprocess.Popen(
        [sys.executable, "-m", "soter_sim.zenoh", "--namespaces", "1=robot1", "--parent", str(os.getpid()), *options],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert process.stdin is not None
    # One that refuses does not read it.
    with suppress(BrokenPipeError):
        process.stdin.write(describe(ROOM.with_robots(1), SPECS[:1], RuleLimits()))
        process.stdin.close()
    return process


class Client:
    """Whoever drives the base: hears everything, says velocities."""

    def __init__(self, session: zenoh.Session, faults: Faults) -> None:
        self.faults = faults
        self.odometry: list[Odometry] = []
        self.clock: list[float] = []
        self.battery: list[BatteryState] = []
        Ear(session, "robot1/odom", Odometry, self.odometry.append)
        Ear(session, "robot1/battery_state", BatteryState, self.battery.append)
        Ear(session, "robot1/clock", RosClock, lambda message: self.clock.append(seconds(message.clock)))
        self.velocity = Voice(session, "robot1/cmd_vel")

    def reaches(self, speed_m_s: float, seen_m_s: float) -> bool:
        """Whether it goes as fast as this in the end, if told again and again."""

        def seen() -> bool:
            self.velocity.say(Twist(Vector3(x=speed_m_s)))
            return self.speed_m_s == pytest.approx(seen_m_s)

        return eventually(seen)

    @property
    def speed_m_s(self) -> float:
        return self.odometry[-1].twist.twist.linear.x if self.odometry else math.nan


@pytest.fixture
def face() -> Iterator[subprocess.Popen[bytes]]:
    with start() as process:
        yield process
        process.kill()


@pytest.fixture
def client(face: subprocess.Popen[bytes]) -> Iterator[Client]:
    assert face.stdout is not None
    told: dict[str, Any] = json.loads(face.stdout.readline())
    assert all(each.startswith("tcp/127.0.0.1:") for each in told["endpoints"])
    with opened(SessionOptions(connect=tuple(told["endpoints"]))) as (session,):
        client = Client(session, Faults(told["control"]))
        assert eventually(lambda: len(client.odometry) > 5 and len(client.clock) > 5 and bool(client.battery))
        yield client


def test_it_says_where_it_is_at_its_rates_and_does_what_it_is_told(client: Client) -> None:
    assert eventually(lambda: len(client.odometry) >= 30)
    says_where_it_stands(client.odometry, client.battery[-1].percentage)
    assert client.clock == sorted(client.clock)
    assert client.clock[0] >= 1000.0
    # NaN stops it, and nothing makes it faster than it is.
    assert client.reaches(9.0, 0.22)
    assert client.reaches(math.nan, 0.0)
    stops_by_itself(client.odometry, lambda: client.reaches(-9.0, -0.22))


def test_its_clock_can_be_stopped_and_the_world_goes_on(client: Client) -> None:
    client.faults.stop_clock(1)
    assert eventually(lambda: len(client.clock) > 5 and len({*client.clock[-5:]}) == 1)
    began_m = client.odometry[-1].pose.pose.position.x
    assert client.reaches(0.2, 0.2)
    assert eventually(lambda: client.odometry[-1].pose.pose.position.x != began_m)
    assert seconds(client.odometry[-1].header.stamp) == client.clock[-1]


def test_a_base_that_restarts_stops_where_it_is_and_its_clock_begins_anew(client: Client) -> None:
    assert client.reaches(0.2, 0.2)
    stamp_s = seconds(client.odometry[-1].header.stamp)
    client.faults.restart(1)
    assert eventually(lambda: client.speed_m_s == 0.0)
    assert client.clock[-1] == pytest.approx(seconds(client.odometry[-1].header.stamp), abs=0.2)
    assert client.clock[-1] < stamp_s
    assert client.odometry[-1].pose.pose.position.x > SPECS[0].x_m


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_ends_when_it_is_told_to(client: Client, face: subprocess.Popen[bytes], number: int) -> None:
    # What is no velocity does not hurt it.
    client.velocity.say_bytes(b"\x00\x01")
    client.velocity.say(String("go"))
    face.send_signal(number)
    assert face.wait(5.0) == 0
    assert face.stderr is not None
    said = face.stderr.read().decode()
    assert "Traceback" not in said


def test_it_ends_with_its_parent() -> None:
    end_with_their_parent("soter.adapters.zenoh.simulator.ZenohSimulator", os.environ)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--speedup", "0"], "argument --speedup: it is 0, allowed: finite and above 0"),
        (["--listen", "tcp/0.0.0.0:0"], "session.listen: it is ['tcp/0.0.0.0:0'], allowed: 127.0.0.1"),
    ],
)
def test_bad_options_end_it(options: list[str], complaint: str) -> None:
    with start(*options) as process:
        assert process.wait(30.0) == 2
        assert process.stderr is not None
        assert complaint in process.stderr.read().decode()
