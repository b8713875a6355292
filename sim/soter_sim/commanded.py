"""Simulated robots that drive to goals by themselves, each behind a gate, over any wire.

To support a wire, write a subclass of `CommandedEndpoint` and a module that calls `run`:

```
python -m MODULE [WORKSPACE.xml] [--at JSON] [--truth-port PORT] [--parent PID]
```

Without a workspace the world comes as MessagePack on standard input. The first line printed is JSON: `{"robots": {"1":
ADDRESS}, "truth": "127.0.0.1:PORT", "control": {...}}`: the robots' addresses, that of `soter_sim.truth_server`, and
how to reach `soter_sim.faults`. `soter.sdk.wire.Simulator` starts it so. `--at` takes the addresses that an earlier
simulator printed.
"""

from __future__ import annotations

import json
import logging
import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import cos, sin
from pathlib import Path
from typing import Any, Final

from soter.geometry.workspace import Workspace
from soter.geometry.workspace_xml import read_workspace
from soter.onboard.command import Command, Report
from soter.onboard.drive import Drive
from soter.onboard.goal_gate import GoalGate
from soter.onboard.program import Ending
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.faults import FaultPort
from soter_sim.program import make_parser, read_world, serve
from soter_sim.real_time import RealTimeWorld
from soter_sim.world import World

PERIOD_S: Final = 0.02
"""Period in which a robot controls itself and reports."""

LEASE_S: Final = 0.15
"""Default time after a renewal of its lease at which a robot begins to brake at the latest."""

_BOOT_APART_S: Final = 1000.0
"""Difference between the clocks of successive robots, so that one cannot be mistaken for another."""

logger = logging.getLogger(__name__)


class CommandedVehicle:
    """One robot: its gate, its clock and its drive. Making it puts it in control of its body in the world.

    Args:
        world: the robot's world.
        robot_id: its number.
        lease_s: time after a renewal of its lease at which it begins to brake at the latest.

    Attributes:
        gate: decides which commands move it.
    """

    def __init__(self, world: World, robot_id: int, lease_s: float = LEASE_S) -> None:
        # A command that passes the gate is driven for one more period.
        self._lives_s: Final = lease_s - PERIOD_S
        self.gate = GoalGate(self._lives_s)
        self._world: Final = world
        self._id: Final = robot_id
        self._index: Final = world.index(robot_id)
        self._drive: Final = Drive(world.bodies.limits[self._index], world.period_s)
        self._booted_s = -_BOOT_APART_S * robot_id
        self._stopped_s = math.inf
        world.set_control(robot_id, self._control)

    def take(self, command: Command) -> None:
        """Pass a command to the gate."""
        now_s = self._world.now_s
        self.gate.obey(command, self._clock_s(now_s), now_s)

    def report(self) -> Report:
        """Return its report."""
        bodies, i, now_s = self._world.bodies, self._index, self._world.now_s
        clock_s, goal = self._clock_s(now_s), self.gate.command
        return Report(
            robot=self._id,
            clock=self.gate.clock(clock_s, now_s),
            stamp_s=clock_s,
            x_m=bodies.x[i],
            y_m=bodies.y[i],
            heading_rad=bodies.heading[i],
            vx_m_s=bodies.v[i] * cos(bodies.heading[i]),
            vy_m_s=bodies.v[i] * sin(bodies.heading[i]),
            yaw_rate_rad_s=bodies.yaw_rate[i],
            battery=bodies.charge[i],
            gate=self.gate.report(now_s),
            goal=None if goal is None else goal.id,
        )

    def step_clock(self, seconds: float) -> None:
        """Set the robot's clock forward, or back if negative."""
        self._booted_s -= seconds

    def stop_clock(self) -> None:
        """Let the robot's clock stand still from now on."""
        self._stopped_s = self._world.now_s

    def restart(self) -> None:
        """Reboot the robot's computer: it forgets all commands, and its clock begins at 0."""
        self.gate, self._booted_s = GoalGate(self._lives_s), self._world.now_s

    def _clock_s(self, world_s: float) -> float:
        return min(world_s, self._stopped_s) - self._booted_s

    def _control(
        self, now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, float]:
        return self._drive.command(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, self.gate.passing(now_s))


class CommandedEndpoint(RealTimeWorld):
    """A world in real time, and its robots' ends of a wire.

    A subclass waits for messages in `_wait`, hands them to `take` in `_hear`, and sends in `_say`.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        limits: what the mission promises.
        truth_port: port that serves the truth; 0 for any free one.

    Attributes:
        vehicles: the robots, by number.
        faults: takes faults for them.
    """

    def __init__(
        self, workspace: Workspace, robots: Sequence[RobotSpec], limits: RuleLimits, truth_port: int = 0
    ) -> None:
        super().__init__(workspace, robots, limits, PERIOD_S, truth_port)
        self.vehicles: Final = {
            spec.id: CommandedVehicle(self.world, spec.id, LEASE_S if spec.promised is None else spec.promised.lease_s)
            for spec in robots
        }
        self.faults: Final = FaultPort(self.vehicles)

    @property
    @abstractmethod
    def addresses(self) -> Mapping[int, Any]:
        """By robot, the address that its adapter is configured with."""

    @abstractmethod
    def _say(self, robot_id: int, message: bytes) -> None:
        """Send a robot's message to its listeners; never wait."""

    def _encode(self, report: Report) -> bytes:
        """Return this wire's encoding of a report."""
        return report.encode()

    def _decode(self, message: bytes) -> Command:
        """Return the command in a message; raise ValueError if it is invalid."""
        return Command.decode(message)

    def take(self, robot_id: int, message: bytes) -> None:
        """Take a message for a robot; an invalid one is dropped."""
        try:
            command = self._decode(message)
        except ValueError as failure:
            logger.warning("robot %d: dropped a message that makes no sense: %s", robot_id, failure)
            return
        self.vehicles[robot_id].take(command)

    def close(self) -> None:
        self.faults.close()
        super().close()

    def _tell(self, before: int, steps: int) -> None:
        self.faults.take()
        for robot_id, vehicle in self.vehicles.items():
            self._say(robot_id, self._encode(vehicle.report()))


Make = Callable[[Workspace, Sequence[RobotSpec], RuleLimits, int, Mapping[int, Any]], CommandedEndpoint]
"""Makes the endpoint of a world: workspace, robots, limits, truth port, and by robot its earlier address."""


def run(module: str, what: str, make: Make) -> None:
    """Run the program of simulated robots until interrupted or, with `--parent PID`, until that process is gone.

    Args:
        module: the module that Python runs.
        what: the robots' name in messages.
        make: makes the endpoint, such as its class.
    """
    parser = make_parser(module, what)
    parser.add_argument("workspace", nargs="?", type=Path, help="an XML file, for robots that start where it says")
    parser.add_argument("--at", type=json.loads, default={}, metavar="JSON", help="by robot, the address to have again")
    given = parser.parse_args()
    if given.workspace is None:
        workspace, robots, limits = read_world()
    else:
        workspace, limits = read_workspace(given.workspace), RuleLimits()
        robots = [RobotSpec(each.id, each.x_m, each.y_m, each.heading_rad) for each in workspace.robots]
    ended = Ending(given.parent)
    endpoint = make(workspace, robots, limits, given.truth_port, {int(number): at for number, at in given.at.items()})
    serve(endpoint, ended, robots=dict(endpoint.addresses), control=endpoint.faults.control)
