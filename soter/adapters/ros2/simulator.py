"""Starts and ends simulated robots: a world and, for each robot, a mux, in processes of their own.

Nothing is received from or sent to other hosts: DDS is kept on 127.0.0.1.
"""

from __future__ import annotations

import os
import random
import socket
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from soter.adapters.velocity_controlled.robot import VelocityControlledRobot
from soter.adapters.velocity_controlled.simulator import VelocityControlledSimulator
from soter.errors import RobotUnavailable
from soter.geometry.workspace import Workspace
from soter.sdk import RobotSpec, RuleLimits, program

_PROFILE: Final = Path(__file__).with_name("loopback.xml")

SETTINGS: Final[Mapping[str, str]] = {
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(_PROFILE),
    "FASTDDS_DEFAULT_PROFILES_FILE": str(_PROFILE),
    # ROS would otherwise add peers and interfaces of its own.
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
}
"""Environment that keeps ROS 2 programs on this host; `ROS_LOCALHOST_ONLY` must not be set."""

# Deprecated; DDS binds every interface in spite of it.
_UNSET: Final = "ROS_LOCALHOST_ONLY"


def environment() -> dict[str, str]:
    """Return the environment of a program whose participants are to stay on this host."""
    return {name: value for name, value in os.environ.items() if name != _UNSET} | {**SETTINGS}


@contextmanager
def loopback() -> Iterator[None]:
    """Keep participants that are made in this context on this host.

    Fast DDS reads the profile when a process makes its first participant: a process that has used the network before
    goes on doing so.
    """
    before = {name: os.environ.get(name) for name in (*SETTINGS, _UNSET)}
    os.environ.update(SETTINGS)
    os.environ.pop(_UNSET, None)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


# Ports of DDS are 7400 + 250 * domain and up; in higher domains they collide with Linux's ephemeral ports.
_DOMAINS: Final = range(1, 101)
_PORT: Final = 7400
_PORTS_PER_DOMAIN: Final = 250
_NEVER_USED: Final = 5
_FIRST_PARTICIPANT: Final = 10


class Domain:
    """A ROS domain that no program on this host uses, drawn at random, and held so that no other `Domain` gets it.

    Raises:
        RobotUnavailable: every domain is in use.
    """

    def __init__(self) -> None:
        for number in random.sample(_DOMAINS, len(_DOMAINS)):
            held = _held(number)
            if held is not None:
                break
        else:
            raise RobotUnavailable(f"every ROS domain from {_DOMAINS[0]} to {_DOMAINS[-1]} is in use on this host")
        self.id: Final = number
        self._held: Final = held

    def close(self) -> None:
        """Release the domain. Idempotent."""
        self._held.close()


def _held(domain_id: int) -> socket.socket | None:
    """Return a socket that holds a domain for this process, or None if the domain is in use."""
    port = _PORT + _PORTS_PER_DOMAIN * domain_id
    held = _bound(port + _NEVER_USED)
    if held is None:
        return None
    participant = _bound(port + _FIRST_PARTICIPANT)
    if participant is None:
        held.close()
        return None
    participant.close()
    return held


def _bound(port: int) -> socket.socket | None:
    """Return a socket bound to a port of this host, or None if the port is in use."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        found.bind(("127.0.0.1", port))
    except OSError:
        found.close()
        return None
    return found


_APART_S: Final = 0.2
"""Time between the ends of two participants: Fast DDS waits for ever if it hears of another one as it ends."""


class Ros2Simulator(VelocityControlledSimulator):
    """ROS 2 robots simulated in real time, each with its mux. On this host only.

    Args:
        workspace: fence, boxes, chargers.
        robots: the robots.
        stamped: whether velocities are TwistStamped.
        domain_id: the ROS domain; None for one that is free on this host.
        truth_port: the port of the ground truth; 0 for any free port.
        limits: the mission's limits, by which the ground truth is judged.

    Raises:
        RobotUnavailable: the simulation does not start.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        *,
        stamped: bool = False,
        domain_id: int | None = None,
        truth_port: int = 0,
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
    ) -> None:
        self._domain: Domain | None = None
        if domain_id is None:
            self._domain = Domain()
            domain_id = self._domain.id
        self.domain_id: Final = domain_id
        self._stamped: Final = stamped
        super().__init__(
            "soter_sim.ros2", "/", robots, {**environment(), "ROS_DOMAIN_ID": str(domain_id)},
            "--truth-port", str(truth_port), *(["--stamped"] if stamped else []),
        )  # fmt: skip
        # Before the world is handed over, because muxes take long to start.
        for robot_id in self.namespaces:
            self.start_mux(robot_id)
        self._hand_over(workspace, limits)

    def start_mux(self, robot_id: int) -> None:
        stamped, promised = "true" if self._stamped else "false", self.promised(robot_id)
        self.muxes[robot_id] = self._start(
            "soter.adapters.ros2.mux", "--robot", self.namespaces[robot_id], "--ros-args",
            "-r", f"/clock:={self.namespaces[robot_id]}/clock",
            "-p", "use_sim_time:=true", "-p", f"stamped:={stamped}",
            "-p", f"lease_s:={VelocityControlledRobot.counted_s(promised)!r}",
            "-p", f"v_max_m_s:={promised.v_max_m_s!r}", "-p", f"yaw_rate_max_rad_s:={promised.yaw_rate_max_rad_s!r}",
            pipes=False,
        )  # fmt: skip

    def close(self) -> None:
        for process in (*self.muxes.values(), self.world):
            if process.poll() is None:
                time.sleep(_APART_S)
                program.end([process])
        super().close()
        if self._domain is not None:
            self._domain.close()
