"""The mission's side of the ports: machines, the planner service, and who is told what. Untrusted as a whole."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Final

from soter.apps.surveillance import Targets
from soter.clock import Clock
from soter.config import Mission
from soter.machine import Event, MachineError, MachineRef, Runtime
from soter.rta import ControlReport, Report
from soter.runner.metrics import Metrics
from soter.stack.assembly import HOME_CLEARANCE_M
from soter.stack.events import Disengaged, GoalEnded, PathPlanned, Reengaged
from soter.stack.kit import RobotKit, RobotPort
from soter.stack.path_guard import PathGuard
from soter.stack.planners import PlanRequest, PlanService
from soter.stack.task_planner import TaskPlanner, Tasks
from soter.stack.terrain import Terrain
from soter.workspace import Workspace

logger = logging.getLogger(__name__)

ARRIVAL_M: Final = 0.10
TASK_PLANNER: Final = "TaskPlanner"


class MissionSide:
    """Runs the machines between the ticks and carries what the ports and the planner report to them.

    Args:
        mission: what to do.
        clock: fleet time.
        plans: the planner's service.
    """

    def __init__(self, mission: Mission, clock: Clock, plans: PlanService) -> None:
        self._mission: Final = mission
        self._clock: Final = clock
        self._plans: Final = plans
        self.runtime: Final = Runtime(now=clock.now, on_failure=self._failed)
        self.failures: dict[int | None, str] = {}
        """What failed, by robot; None for the task planner, on which all robots depend."""
        self._listeners: dict[tuple[int, type[Event]], list[MachineRef]] = {}
        self._owners: dict[str, int] = {}
        self._waiting: dict[int, tuple[PlanRequest, MachineRef]] = {}
        self._guards: dict[int, PathGuard] = {}
        self._ports: Mapping[int, RobotPort] = {}

    def start(self, workspace: Workspace, terrain: Terrain, ports: Mapping[int, RobotPort], disc_m: float,
              metrics: Metrics) -> None:  # fmt: skip
        """Create the task planner; it creates the rest."""
        body_radius_m, path = terrain.body_radius_m, self._mission.rta.path
        self._ports = ports
        if self._mission.rta.enabled and path.enabled:
            for robot_id in ports:
                self._guards[robot_id] = PathGuard(
                    terrain, path.delta_s, path.phi_safe_m, path.phi_safer_m, HOME_CLEARANCE_M
                )
        targets = Targets(workspace, body_radius_m, self._mission.targets, self._mission.seed)
        kits = {
            robot_id: RobotKit(
                robot_id, port, {other: peer for other, peer in ports.items() if other != robot_id},
                self._submit, self._subscribe, self._mission.seed, disc_m, self._mission.target_timeout_s, ARRIVAL_M,
            )
            for robot_id, port in ports.items()
        }  # fmt: skip
        tasks = Tasks(kits, targets.next, metrics.on_target, metrics.on_ended)
        self.runtime.create(TaskPlanner, tasks, name=TASK_PLANNER)
        # Before the first tick, so that no machine misses the first report of a port.
        self.runtime.run()

    def hear(self, report: Report) -> None:
        """Pass on what a port reports. Called in the supervisor's thread; only posts."""
        event: Event
        if isinstance(report, ControlReport):
            event = Reengaged() if report.engaged else Disengaged(report.module, report.cause)
        else:
            event = GoalEnded(report.goal_id, report.status)
        for machine in self._listeners.get((report.robot_id, type(event)), ()):
            self.runtime.post(machine, event)

    def run(self, now_s: float) -> None:
        """Deliver the plans whose time has come and let the machines do what they can do now."""
        if self._waiting:
            for plan in self._plans.due(now_s):
                request, machine = self._waiting.pop(plan.request_id)
                guard, state = self._guards.get(request.robot_id), self._ports[request.robot_id].state
                if guard is not None and state is not None:
                    plan = guard.judge(state, now_s, request, plan)
                self.runtime.post(machine, PathPlanned(plan.request_id, plan.path, plan.reason, plan.reaches_goal))
        self.runtime.run()

    @property
    def paths_replaced(self) -> int:
        """Paths of the untrusted planner that were not used."""
        return sum(guard.replaced for guard in self._guards.values())

    def close(self) -> None:
        """End the planner's processes and close the machines."""
        self._plans.close()
        self.runtime.close()

    def _submit(self, request: PlanRequest, reply_to: MachineRef) -> None:
        self._plans.submit(request, self._clock.now())
        self._waiting[request.request_id] = (request, reply_to)

    def _subscribe(self, robot_id: int, machine: MachineRef, events: tuple[type[Event], ...]) -> None:
        self._owners[machine.name] = robot_id
        for event in events:
            self._listeners.setdefault((robot_id, event), []).append(machine)

    def _failed(self, failure: MachineError) -> None:
        """One robot's machine costs that robot its AC; the task planner's failure costs all of them theirs."""
        logger.error("a machine of the mission failed: %s", failure)
        self.failures.setdefault(self._owners.get(failure.machine), str(failure))
