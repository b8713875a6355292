"""The port that takes faults for simulated robots: who knows its key is heard, and nothing else does any harm."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator

import pytest

from soter.sdk.program import Faults
from soter_sim.faults import FaultPort


class Clocked:
    """Notes what happens to it."""

    def __init__(self) -> None:
        self.stepped_s, self.stopped, self.restarts = 0.0, False, 0

    def step_clock(self, seconds: float) -> None:
        self.stepped_s += seconds

    def stop_clock(self) -> None:
        self.stopped = True

    def restart(self) -> None:
        self.restarts += 1


@pytest.fixture
def robots() -> dict[int, Clocked]:
    return {1: Clocked(), 2: Clocked()}


@pytest.fixture
def port(robots: dict[int, Clocked]) -> Iterator[FaultPort]:
    port = FaultPort(robots)
    yield port
    port.close()


def test_each_fault_befalls_the_robot_that_it_is_meant_for(robots: dict[int, Clocked], port: FaultPort) -> None:
    faults = Faults(port.control)
    faults.step_clock(1, -30.0)
    faults.stop_clock(2)
    faults.restart(2)
    port.take()
    assert (robots[1].stepped_s, robots[1].stopped, robots[1].restarts) == (-30.0, False, 0)
    assert (robots[2].stepped_s, robots[2].stopped, robots[2].restarts) == (0.0, True, 1)


@pytest.mark.parametrize(
    "changes",
    [
        {"key": "another"},
        {"key": None},
        {"robot": 3},
        {"robot": [1]},
        {"step_clock_s": "soon"},
        {"step_clock_s": "nan"},
    ],
)
def test_who_has_another_key_or_makes_no_sense_changes_nothing(
    robots: dict[int, Clocked], port: FaultPort, changes: dict[str, object]
) -> None:
    told = port.control
    asked = json.dumps({"key": told["key"], "robot": 1, "restart": True, **changes}).encode()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for message in (b"", b"[", b"[]", b"\xff", b"[" * 900, asked):
            out.sendto(message, ("127.0.0.1", told["port"]))
    Faults(told).stop_clock(2)
    port.take()
    assert (robots[1].stepped_s, robots[1].restarts) == (0.0, 0)
    assert robots[2].stopped, "what comes behind it is taken"
