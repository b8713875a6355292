"""The safety side of a mission in closed loop with the kinematic backend, and any AC behind the ports."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from soter.adapters.pybullet import KinematicBackend, KinematicConfig, SimulatedFleet
from soter.config import MissionFile, load_mission
from soter.geometry.workspace import Workspace
from soter.rta import Report, SwitchRecord
from soter.sdk import Controller, RobotSpec, RobotState, TruthReport, Waypoint
from soter.stack.assembly import SafetySide, assemble
from soter.stack.kit import RobotPort

MISSION = Path(__file__).parents[2] / "examples" / "surveillance.toml"
TICK_S = 0.05
STARTED_S = 3.0
"""By then every module has been given its robot for the first time."""

AC = Callable[[float, Mapping[int, RobotPort]], None]
"""An advanced controller: called once a tick with the time and the ports of all robots."""


class Loop:
    """One closed loop.

    Args:
        ac: drives all robots.
        charges: of the robots at the start.
        workspace: where; None for the mission's own.
        overrides: of the mission's keys, with two underscores for every dot.

    Attributes:
        reports: what the ports have reported.
        switches: what the supervisors have recorded.
        safety: the safety side.
    """

    def __init__(
        self,
        ac: AC,
        charges: tuple[float, ...] = (1.0, 1.0),
        workspace: Workspace | None = None,
        **overrides: Any,
    ) -> None:
        overrides = {"backend": "kinematic", **{key.replace("__", "."): value for key, value in overrides.items()}}
        self.mission: MissionFile = load_mission(MISSION, overrides)
        self.workspace = workspace or self.mission.read_workspace()
        self.reports: list[Report] = []
        self.switches: list[SwitchRecord] = []
        battery = self.mission.battery
        specs = [
            RobotSpec(
                place.id, place.x_m, place.y_m, place.heading_rad, charge, battery.drive_s, battery.idle_s,
                battery.charge_s,
            )
            for place, charge in zip(self.workspace.robots, charges, strict=True)
        ]  # fmt: skip
        config = KinematicConfig(workspace=self.workspace)
        self.fleet: SimulatedFleet = KinematicBackend().open(config, specs)
        for robot in self.fleet.robots:
            robot.init(1.0)
        self.safety: SafetySide = assemble(
            self.mission, self.workspace, self.fleet.robots, self.reports.append, [self]
        )  # fmt: skip
        self.ports = self.safety.ports
        self._ac = ac
        self._tick = 0

    def on_switch(self, record: SwitchRecord, robot: object) -> None:
        self.switches.append(record)

    def run(self, duration_s: float) -> TruthReport:
        """Run on for a while; return what has really happened since the start."""
        clock = self.fleet.clock
        for _ in range(round(duration_s / TICK_S)):
            now_s = self._tick * TICK_S
            self.safety.supervisor.tick(now_s)
            self._ac(now_s, self.ports)
            self._tick += 1
            clock.sleep_until(self._tick * TICK_S)
        assert self.fleet.truth is not None
        return self.fleet.truth.report()

    def disengagements(self, module: str) -> int:
        return sum(s.before is None and s.after is not None and s.module == module for s in self.switches)

    def in_sc(self, robot_id: int, module: str) -> bool:
        """Return whether a module of a robot is in SC, whichever module drives."""
        modules = self.safety.supervisor.robots[robot_id].modules
        return any(each.name == module and each.mode is Controller.SC for each in modules)

    def until_charged(self, limit_s: float, *robot_ids: int) -> None:
        """Run until some robots, by default all, have had to charge and have; their charge is watched all along."""
        watched = robot_ids or tuple(self.ports)
        begun_s = self._tick * TICK_S
        low: set[int] = set()
        charged: set[int] = set()
        while len(charged) < len(watched):
            self.run(1.0)
            assert self._tick * TICK_S - begun_s < limit_s, {
                n: (where(p), self.charge(n)) for n, p in self.ports.items()
            }
            for robot_id in watched:
                assert self.charge(robot_id) > 0.0
                if self._tick * TICK_S > STARTED_S and self.in_sc(robot_id, "battery"):
                    low.add(robot_id)
                elif robot_id in low:
                    charged.add(robot_id)

    def charge(self, robot_id: int) -> float:
        """Return the charge that a robot reports."""
        state: RobotState | None = self.ports[robot_id].state
        assert state is not None
        assert state.battery is not None
        return state.battery


def where(port: RobotPort) -> tuple[float, float]:
    """Return where a robot was at the last tick."""
    state: RobotState | None = port.state
    assert state is not None
    return state.x_m, state.y_m


def goto(port: RobotPort, x_m: float, y_m: float) -> None:
    """Ask for a place and mean it: arrival is no reason to stop asking."""
    port.goto(Waypoint(x_m, y_m, radius_m=1e-3))
