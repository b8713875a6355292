"""The mission's side of the ports: machines, the planner service, and the routing of reports. Untrusted."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from typing import Final

from soter.clock import Clock
from soter.config import MissionFile
from soter.errors import ConfigError, SoterError, account_of
from soter.geometry.workspace import Workspace
from soter.isolation.sandbox import denied
from soter.loading import file_of, line_in
from soter.machine import Event, MachineError, MachineRef, Runtime
from soter.missions import ScriptFailed, Stage, make_mission, placed
from soter.record.messages import TransitionEvent
from soter.record.samples import DETAIL_CHARACTERS, in_words
from soter.rta import ControlReport, Report
from soter.runner.boxes import box_of
from soter.runner.mailbox import Mailbox
from soter.runner.mission_host import Scene
from soter.runner.part import Part
from soter.stack.declaration import HOME_CLEARANCE_M
from soter.stack.events import Disengaged, GoalEnded, PathPlanned, Reengaged
from soter.stack.kit import RobotKit, RobotPort
from soter.stack.path_guard import PathGuard
from soter.stack.planners import PlannerSpec, PlanRequest
from soter.stack.planners.service import PlanService
from soter.stack.remote import RemoteTaskPlanner, RemoteTasks

logger = logging.getLogger(__name__)

SAYS: Final = "mission: "
"""Prefix of lines that a mission logs, and of each line that a mission's own process prints."""

_MOST_LINES: Final = 100
"""Most lines that a mission may log in one tick; further ones are only counted."""
_LONGEST_LINE: Final = 4000

TASK_PLANNER: Final = "TaskPlanner"
HERE: Final = "local"


class MachineHost:
    """A `MissionHost` that runs the machines between ticks, and passes them the reports of ports and planner.

    Args:
        mission: the mission.
        workspace: fence, boxes, chargers.
        body_radius_m: body radii of the robots, by id.
        virtual_time: whether plans are delivered at times that do not depend on the host's speed.
        part: this process's part of the mission; None for all of it.

    Raises:
        ConfigError: the planner, or the bus between the processes, does not allow an option.
        BackendError: the bus between the processes cannot be opened.
    """

    sandbox = None
    answers = None
    not_begun = ""

    def __init__(
        self,
        mission: MissionFile,
        workspace: Workspace,
        body_radius_m: Mapping[int, float],
        *,
        virtual_time: bool,
        part: Part | None = None,
    ) -> None:
        self._mission: Final = mission
        self._body_radius_m: Final = body_radius_m
        self.failures: dict[int | None, str] = {}
        self._clock: Clock | None = None
        self._part: Final = part
        # Robots of a remote task planner need no mission here: their targets come over the bus.
        self._mission_code: Final = (
            make_mission(mission, workspace, body_radius_m) if part is None or part.planner else None
        )
        self._scene: Scene | None = None
        self._said = 0
        self._runtime: Final = Runtime(
            now=self._now, on_failure=self._failed, node=HERE if part is None else part.name
        )  # fmt: skip
        self._mailbox: Final = None if part is None else Mailbox(part, part.open_bus(), self._runtime)
        try:
            self._plans: Final = self._planner_of(workspace, part, virtual_time)
        except BaseException:
            if self._mailbox is not None:
                self._mailbox.close()
            raise
        self._listeners: dict[tuple[int, type[Event]], list[MachineRef]] = {}
        self._owners: dict[str, int] = {}
        self._waiting: dict[int, tuple[PlanRequest, MachineRef]] = {}
        self._guards: dict[int, PathGuard] = {}
        self._ports: Mapping[int, RobotPort] = {}

    def _planner_of(self, workspace: Workspace, part: Part | None, virtual_time: bool) -> PlanService | None:
        """Start the planner's process; return None if there are no robots, and so no paths to plan."""
        if part is not None and not part.robots:
            return None
        mission = self._mission
        return PlanService(
            PlannerSpec(
                mission.planner, workspace, self._body_radius_m, mission.planners.get(mission.planner, {}),
                mission.source, mission.overridden,
            ),
            virtual_time=virtual_time, box=box_of(mission),
        )  # fmt: skip

    def ready(self) -> None:
        """Wait until the planner's processes answer."""
        if self._plans is None:
            return
        try:
            self._plans.ready()
        except ConfigError as failure:
            if failure.key != "planner" or failure.source is not None:
                raise
            # The planner's own process knows neither file nor line of its name.
            raise self._mission.refusal("planner", str(failure).removeprefix("planner: ")) from failure

    def receive(self) -> None:
        """Do nothing: nothing runs in another process."""

    def start(self, scene: Scene) -> None:
        """Let the mission, or a remote proxy of the task planner, create its machines; these create the rest."""
        path, ports, seed = self._mission.rta.path, scene.ports, self._mission.seed
        self._ports, self._clock, self._scene = ports, scene.clock, scene
        if self._mission.rta.enabled and path.enabled:
            for robot_id in ports:
                self._guards[robot_id] = PathGuard(
                    scene.rooms[robot_id].terrain, path.delta_s, path.phi_safe_m, path.phi_safer_m, HOME_CLEARANCE_M
                )
        everybody = {**ports, **scene.peers}
        # What robots of other processes promise is not known here.
        speeds = [each.v_max_m_s for each in scene.capabilities.values()]
        fastest_m_s = math.inf if scene.peers else max(speeds, default=math.inf)
        kits = {
            robot_id: RobotKit(
                robot_id, port, {other: peer for other, peer in everybody.items() if other != robot_id},
                self._submit, self._subscribe, seed, scene.rooms[robot_id].disc_m, self._mission.target_timeout_s,
                scene.rooms[robot_id].arrival_m, scene.capabilities[robot_id], fastest_m_s,
            )
            for robot_id, port in ports.items()
        }  # fmt: skip
        if scene.on_transition is not None:
            tell = scene.on_transition
            self._runtime.observe(lambda transition: tell(in_words(transition)))
        part, messages, log = self._part, self._mailbox, scene.log
        if self._mission_code is not None:
            of_all = kits if part is None or messages is None else {
                robot_id: kits.get(robot_id) or messages.kit(robot_id) for robot_id in sorted(part.homes)
            }  # fmt: skip
            stage = Stage(
                scene.workspace, self._body_radius_m, seed, self._mission.base_tick_s, of_all, everybody,
                lambda machine, payload, name: self._runtime.create(machine, payload, name=name), log.on_target,
                log.on_ended, self._say,
            )  # fmt: skip
            try:
                self._mission_code.start(stage)
            except KeyboardInterrupt:
                raise
            except ConfigError as refusal:
                raise placed(self._mission, refusal) from refusal
            except BaseException as failure:  # noqa: BLE001 - foreign code, whose line is named in place of a traceback
                where = line_in(file_of(self._mission.mission.use), failure)
                self.failures[None] = f"the mission failed: {account_of(failure)}{where}{denied(failure)}"
                logger.error("%s", self.failures[None])
        elif part is not None and messages is not None:
            agents = {
                robot_id: MachineRef(robot_id, f"RobotAgent {robot_id}", process)
                for robot_id, process in part.homes.items()
            }
            away = RemoteTasks(
                kits, messages.tell_task_planner, messages.hears_task_planner, agents, log.on_target, log.on_ended
            )
            self._runtime.create(RemoteTaskPlanner, away, name=TASK_PLANNER)
        # Before the first tick, so that no machine misses the first report of a port.
        self._runtime.run()

    def hear(self, report: Report) -> None:
        """Pass on a port's report. Called in the supervisor's thread; only posts."""
        event: Event
        if isinstance(report, ControlReport):
            event = Reengaged() if report.engaged else Disengaged(report.module, report.cause)
        else:
            event = GoalEnded(report.goal_id, report.status)
        for machine in self._listeners.get((report.robot_id, type(event)), ()):
            self._runtime.post(machine, event)

    def run(self, now_s: float) -> None:
        """Deliver the plans that are due, and run the machines until they have nothing to do."""
        if self._mailbox is not None:
            self._mailbox.pump(now_s)
        if self._plans is not None and self._waiting:
            for plan in self._plans.due(now_s):
                request, machine = self._waiting.pop(plan.request_id)
                guard, state = self._guards.get(request.robot_id), self._ports[request.robot_id].state
                if guard is not None and state is not None:
                    plan = guard.judge(state, now_s, request, plan)
                self._runtime.post(machine, PathPlanned(plan.request_id, plan.path, plan.reason, plan.reaches_goal))
        self._runtime.run()
        if self._said > _MOST_LINES:
            logger.warning("... and %d more in this tick", self._said - _MOST_LINES)
        self._said = 0

    @property
    def current_handler(self) -> str | None:
        """The handler that is running, or None. Readable from any thread."""
        between = "of a machine that sends without end" if self._runtime.running else None
        return self._runtime.current_handler or between

    @property
    def incidents(self) -> tuple[str, ...]:
        """Plans whose time depended on the host, one line each."""
        return () if self._plans is None else self._plans.incidents

    @property
    def done(self) -> bool:
        """Whether the mission has nothing left to do; always False if other processes have a part in it."""
        return self._part is None and self._mission_code is not None and self._mission_code.finished

    @property
    def paths_replaced(self) -> int:
        """Number of the untrusted planner's paths that were replaced."""
        return sum(guard.replaced for guard in self._guards.values())

    def close(self) -> None:
        """End the planner's processes and close the machines."""
        if self._plans is not None:
            self._plans.close()
        if self._mailbox is not None:
            self._mailbox.close()
        try:
            self._runtime.close()
        except SoterError as failure:
            # The run is over: a script's `finally` can no longer command a robot.
            logger.warning("not ended cleanly: %s", failure)

    def _now(self) -> float:
        return 0.0 if self._clock is None else self._clock.now()

    def _say(self, name: str, text: str) -> None:
        """Log a message of the mission, and record it as a transition of a machine with that name."""
        self._said += 1
        if self._said > _MOST_LINES:
            return
        # Python strings may hold half a surrogate pair, which UTF-8 cannot encode.
        text, scene = text[:_LONGEST_LINE].encode("utf-8", "replace").decode(), self._scene
        # A warning, so that it shows without any set-up of logging.
        logger.warning("%s%s", SAYS, text)
        if scene is not None and scene.on_transition is not None:
            scene.on_transition(TransitionEvent(self._now(), name, 0, HERE, "", "", "log", text[:DETAIL_CHARACTERS]))

    def _submit(self, request: PlanRequest, reply_to: MachineRef) -> None:
        assert self._plans is not None
        self._plans.submit(request, self._now())
        self._waiting[request.request_id] = (request, reply_to)

    def _subscribe(self, robot_id: int, machine: MachineRef, events: tuple[type[Event], ...]) -> None:
        self._owners[machine.name] = robot_id
        for event in events:
            self._listeners.setdefault((robot_id, event), []).append(machine)

    def _failed(self, failure: MachineError) -> None:
        """Note a failed machine: one robot's costs that robot its AC, the task planner's costs all robots theirs."""
        robot_id, words = self._owners.get(failure.machine), str(failure)
        who = f"a machine of the mission failed: {failure.machine}"
        if isinstance(failure.__cause__, ScriptFailed):
            # The author knows the script, not the machine that runs it.
            words = f"its script failed: {failure.__cause__}{denied(failure)}"
            who = who if robot_id is None else f"robot {robot_id}"
        logger.error("%s: %s", who, words)
        self.failures.setdefault(robot_id, words)
