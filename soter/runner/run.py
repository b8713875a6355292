"""Runs a mission: opens the backend, binds the safety side to it, ticks until the time is up, sums up."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from soter.check.admission import admitted, refused_at
from soter.check.user_rules import UserRules
from soter.config import MissionFile
from soter.errors import ConfigError, IllFormedModule, RunFailed
from soter.faults import FaultyFleet, read_faults
from soter.geometry.workspace import Workspace
from soter.record.recorder import Recorder
from soter.registry import load_backend, missing_library
from soter.rta import RemotePeer, Watch
from soter.runner.ac_side import AcSide, OwnRoom, Scene, TargetLog, arrival_m
from soter.runner.metrics import Metrics, breach_figures, counts, fault_figures, module_figures
from soter.runner.needless import NeedlessJudge
from soter.runner.part import Part, refuse_in_one_process
from soter.runner.planner_run import run_planner
from soter.runner.progress import Aside, Audience, Progress, robot_progress
from soter.runner.real_time import real_time
from soter.runner.remote_side import RemoteSide
from soter.runner.result import Run, RunResult
from soter.runner.sides import make_ac_side
from soter.runner.together import Said, Together
from soter.runner.trace import Trace
from soter.runner.watchdog import HandlerWatchdog
from soter.sdk import RULES, Fleet, TruthReport
from soter.specs import asked, promises, read_options, robot_specs
from soter.stack.assembly import SafetySide, assemble
from soter.stack.declaration import timing_of

logger = logging.getLogger(__name__)

INIT_TIMEOUT_S: Final = 60.0
DISC_SLACK_M: Final = 0.05
"""Added to the distance at which the collision module acts, for plans around robots that stand in the way."""

_LOOK_TICKS: Final = 64


@dataclass(frozen=True)
class Study:
    """Questions to the modules that a mission must not ask.

    Attributes:
        deltas: how many Delta they look ahead; None for what proofs need.
        safer_alone: they give back wherever phi_safer holds, though the AC could break the rule before the next look.
        on_ill_formed: takes the refusal of an ill-formed module, which then runs all the same; None refuses.
    """

    deltas: float | None = None
    safer_alone: bool = False
    on_ill_formed: Callable[[IllFormedModule], None] | None = None


def run_mission(
    mission: MissionFile,
    *,
    on_progress: Callable[[Progress], None] | None = None,
    progress_every_s: float = 0.2,
    stop: Callable[[], bool] | None = None,
    connecting: AbstractContextManager[object] | None = None,
    study: Study | None = None,
    accept_unproved: bool = False,
    record: Path | None = None,
    sign: Path | None = None,
    on_recording: Callable[[Path], None] | None = None,
    process: str | None = None,
    say: Said = logger.warning,
) -> Run:
    """Run a mission to its end. Call it from the main thread: only there can a blocked handler be interrupted.

    Args:
        mission: from `soter.config.load_mission`.
        on_progress: called when the robots begin to move, and every `progress_every_s` of host time.
        progress_every_s: see there.
        stop: asked at every tick whether to end the run early, as Ctrl-C does.
        connecting: entered while robots on a wire get ready, when nobody is asked; what it raises ends the run.
        study: what is changed of the modules that no mission may change; on simulated robots only. What is not proved
            is part of the question: it is run.
        accept_unproved: whether to run what is not proved; the result says what that was.
        record: where to record it, or None. A recording that is there is replaced when the new one is complete. What
            cannot be recorded is said in what is returned.
        sign: the private key that the recording is signed with, or None; see `soter.record.signing`.
        on_recording: called before the first tick with the file that is written, once it says what is run.
        process: which process of a distributed mission this is; None for a mission in one process.
        say: told which other processes are waited for.

    Returns:
        What happened. Whatever ends the run, its robots are stopped by then.

    Raises:
        ConfigError: bad input, or a module that is not proved; nothing has moved.
        BackendError: the backend cannot be opened or a robot does not get ready; nothing has moved.
        IllFormedModule: a safety module cannot keep its promise on these robots; nothing has moved.
    """
    audience = Audience(on_progress, progress_every_s, stop or (lambda: False))
    workspace = mission.read_workspace()
    part = None if process is None else Part.of(mission, workspace, process)
    if part is not None and not part.robots:
        if record is not None:
            raise ConfigError(f"process '{process}' has no robots, and so there is nothing to record", key="--record")
        return run_planner(part, workspace, audience, say)
    backend_class = load_backend(mission.backend)
    config = read_options(backend_class, mission, workspace)
    specs = robot_specs(mission, workspace, asked(backend_class, config, mission, workspace))
    faults = read_faults(mission, [spec.id for spec in specs])
    promised = promises(backend_class, config, mission, workspace)  # refuses bodies that do not fit
    radii_m = {robot_id: each.body_radius_m for robot_id, each in promised.items()}
    if part is None:
        refuse_in_one_process(mission, backend_class)
    else:
        specs = [spec for spec in specs if spec.id in part.robots]
    # Questions to the modules are about what is not proved.
    unproved = admitted(
        mission, workspace, backend_class, config, ill_formed=study is not None and study.on_ill_formed is not None,
        unproved=accept_unproved or study is not None,
    )  # fmt: skip
    with ExitStack() as stack:
        declared = backend_class.robot_class.declared
        if study is not None and not declared.in_process:
            raise mission.refusal("backend", f"it is '{mission.backend}', but studies run in virtual time only")
        # Closed after everything else: it takes its time, in which no robot may move.
        recorder = (
            None
            if record is None
            else stack.enter_context(Recorder(record, waits=declared.in_process, sign=sign, stop=audience.stop))
        )
        side: AcSide
        if declared.in_process:
            side = make_ac_side(mission, workspace, radii_m, virtual_time=True)
        else:
            # Time passes by itself: whatever the ACs do with it, the supervisor must not have to wait.
            side = RemoteSide(mission, workspace, radii_m, process=process)
        stack.callback(side.close)
        try:
            fleet = stack.enter_context(backend_class().open(config, specs))
        except ImportError as failure:
            raise missing_library(mission.backend, failure) from failure
        if faults:
            fleet = stack.enter_context(FaultyFleet(fleet, faults, mission.seed, mission.base_tick_s))
        side.ready()
        together = None if part is None else stack.enter_context(Together(part, fleet.clock))
        with nullcontext() if declared.in_process or connecting is None else connecting:
            for robot in fleet.robots:
                robot.init(INIT_TIMEOUT_S)
        try:
            loop = _Loop(mission, workspace, fleet, side, study or Study(), recorder, together, unproved)
        except IllFormedModule as failure:
            raise refused_at(failure, mission, workspace, backend_class, config) from failure
        status, failure_text = "interrupted", ""
        if together is None or together.wait(fleet.robots, say, audience.stop):
            loop.begin(workspace)
            if recorder is not None and on_recording is not None:
                on_recording(recorder.writing)
            status, failure_text = loop.run(audience)
        engine = getattr(config, "engine", None)
        run = Run(loop.result(status, failure_text, engine), loop.metrics.tracks)
        if recorder is not None:
            recorder.finish(run.result.model_dump_json(indent=2).encode())
    return run if recorder is None else replace(run, recording=recorder.close())


class _Loop:
    """One run, from the first tick to the last."""

    def __init__(
        self,
        mission: MissionFile,
        workspace: Workspace,
        fleet: Fleet,
        side: AcSide,
        study: Study,
        recorder: Recorder | None,
        together: Together | None = None,
        unproved: tuple[str, ...] = (),
    ) -> None:
        self.unproved: Final = unproved
        self.mission: Final = mission
        self.fleet: Final = fleet
        self.side: Final = side
        self.together: Final = together
        self.recorder: Final = recorder
        self.modules: Final = mission.rta.order
        safer_inset_m = mission.rta.geofence.phi_safer_inset_m if "geofence" in self.modules else None
        robot_ids = [robot.id for robot in fleet.robots]
        self.metrics: Final = Metrics(workspace, self.modules, robot_ids, safer_inset_m)
        watches: list[Watch] = [self.metrics] if recorder is None else [self.metrics, recorder]
        self.safety: Final[SafetySide] = assemble(
            mission, workspace, fleet.robots, side.hear, watches, tap=None if recorder is None else recorder.tap,
            on_ill_formed=study.on_ill_formed, deltas=study.deltas, safer_alone=study.safer_alone,
            remote=self._remote(recorder, robot_ids),
            remote_promises={} if together is None else together.promises,
        )  # fmt: skip
        self.robots: Final = tuple(self.safety.supervisor.robots.values())
        self.trace: Final = Trace()
        self.ticks = 0
        self.wall_clock: Final = isinstance(side, RemoteSide)
        self.real_time = False
        self.jitter_s: Final = max(robot.capabilities.jitter_s for robot in fleet.robots)
        self.wall_s = 0.0
        speeds = {robot.id: robot.capabilities.v_max_m_s for robot in fleet.robots}
        self.metrics.judge = NeedlessJudge(
            self.safety.supervisor.robots, self.safety.forwarders, self.safety.modules, speeds
        ).judge
        truth = fleet.truth
        self.user_rules: Final = None if truth is None else UserRules(truth, self.safety.own)

    def _remote(self, recorder: Recorder | None, robot_ids: Sequence[int]) -> Sequence[RemotePeer]:
        peers = () if self.together is None else self.together.peers
        return peers if recorder is None else [recorder.tap_peer(peer, robot_ids) for peer in peers]

    def begin(self, workspace: Workspace) -> None:
        """Begin the recording and the ACs' side; the first tick is near."""
        recorder, safety = self.recorder, self.safety
        rooms = {
            robot.id: OwnRoom(
                safety.terrains[robot.id], safety.trigger_m[robot.id] + DISC_SLACK_M, arrival_m(robot.capabilities)
            )
            for robot in self.fleet.robots
        }
        log: TargetLog = self.metrics
        if recorder is not None:
            self._begin_recording(recorder, workspace)
            log = recorder.beside(log)
        self.side.start(Scene(
            self.fleet.clock, workspace, rooms, safety.ports, log,
            None if recorder is None else recorder.on_transition,
            {} if self.together is None else self.together.ports,
            {robot.id: robot.capabilities for robot in self.fleet.robots},
        ))  # fmt: skip

    def _begin_recording(self, recorder: Recorder, workspace: Workspace) -> None:
        promises = {robot.id: robot.capabilities for robot in self.fleet.robots}
        timings = {robot_id: timing_of(each, self.mission.base_tick_s) for robot_id, each in promises.items()}
        faults = self.fleet.report if isinstance(self.fleet, FaultyFleet) else tuple
        try:
            recorder.begin(
                self.mission, workspace, self.robots, self.safety.modules, promises, timings, self.fleet.truth, faults,
                {} if self.together is None else self.together.promises, self.metrics.standstills.stalls,
                self.unproved,
            )  # fmt: skip
        except OSError as failure:
            why = failure.strerror or failure
            raise ConfigError(f"'{recorder.path}' cannot be recorded to: {why}", key="record") from failure

    def run(self, audience: Audience) -> tuple[str, str]:
        """Tick until the time is up; return the status and, for a failure, what it was."""
        start_s = time.perf_counter()
        try:
            with ExitStack() as stack:
                watchdog = stack.enter_context(HandlerWatchdog(lambda: self.side.current_handler, lambda: self.ticks))
                if audience.show is not None and self.wall_clock:
                    audience = replace(audience, show=stack.enter_context(Aside(audience.show)).put)
                wanted = self.mission.isolation.real_time
                if self.wall_clock and wanted != "never":
                    self.real_time = stack.enter_context(real_time(required=wanted == "always"))
                status = self._tick_on(watchdog, start_s, audience)
            failure = self.side.failures.get(None)
            # The robots were brought home by their SCs, but what they were for was not done.
            return ("failed", failure) if failure and status == "completed" else (status, "")
        except KeyboardInterrupt:
            return "interrupted", ""
        except RunFailed as failure:
            logger.error("the run failed: %s", failure)
            return "failed", str(failure)
        finally:
            self.wall_s = time.perf_counter() - start_s
            self.metrics.finish(self.ticks * self.mission.base_tick_s)

    def _tick_on(self, watchdog: HandlerWatchdog, start_s: float, audience: Audience) -> str:
        base_tick_s, clock, side = self.mission.base_tick_s, self.fleet.clock, self.side
        receive = side.receive if isinstance(side, RemoteSide) else None
        began_s = clock.now()
        self.metrics.begin(began_s)
        supervisor, metrics, trace, robots = self.safety.supervisor, self.metrics, self.trace, self.robots
        charging, recorder, together = self.safety.charging, self.recorder, self.together
        last = round(self.mission.duration_s / base_tick_s)
        shown_s = -math.inf
        look_ticks = 1 if self.wall_clock else _LOOK_TICKS
        for tick in range(last):
            if receive is not None:
                receive()
            if together is not None:
                together.look()
            # In virtual time the clock shows just this time; on a wall clock it shows how late the tick really is.
            now_s = clock.now()
            late_s = now_s - (began_s + tick * base_tick_s)
            supervisor.tick(now_s)
            if together is not None:
                together.tell(robots)
            side.run(now_s)
            watchdog.check()
            if side.failures:
                self._fail_acs()
            trace.add(now_s, robots)
            metrics.tick(now_s, tick, late_s, robots, charging)
            if recorder is not None:
                recorder.tick(now_s, tick)
            if audience.show is not None and tick % look_ticks == 0:
                # Now there is time until the next tick.
                wall_s = time.perf_counter()
                if wall_s - shown_s >= audience.every_s:
                    shown_s = wall_s
                    audience.show(self._progress(wall_s - start_s))
            clock.sleep_until(began_s + (tick + 1) * base_tick_s)
            self.ticks = tick + 1
            if lost := self.fleet.lost():
                raise RunFailed(lost)
            if self.user_rules is not None:
                self.user_rules.look(clock.now(), self.robots)
            if audience.stop():
                return "interrupted"
            if side.done:
                break
        return "completed"

    def _fail_acs(self) -> None:
        for robot_id, cause in self.side.failures.items():
            for robot in self.robots:
                if robot_id is None or robot_id == robot.robot_id:
                    robot.fail_ac(cause)

    def _progress(self, wall_s: float) -> Progress:
        truth = self.fleet.truth
        return Progress(
            self.ticks * self.mission.base_tick_s,
            self.mission.duration_s,
            wall_s,
            robot_progress(self.robots, self.metrics),
            self._violations(None if truth is None else truth.report()),
        )

    def _violations(self, report: TruthReport | None) -> dict[str, int] | None:
        if report is None or self.user_rules is None:
            return None
        return {**{rule: report.count(rule) for rule in RULES}, **self.user_rules.counts()}

    def _min_margin(self, report: TruthReport | None) -> dict[str, float] | None:
        if report is None or self.user_rules is None:
            return None
        margins = {**report.min_margin, **self.user_rules.min_margin}
        return {rule: round(margin, 5) for rule, margin in margins.items()}

    def result(self, status: str, failure: str, engine: str | None) -> RunResult:
        metrics, mission, truth = self.metrics, self.mission, self.fleet.truth
        report = None if truth is None else truth.report()
        duration_s = round(self.ticks * mission.base_tick_s, 6)
        targets = metrics.target_counts()
        return RunResult(
            status=status,
            failure=failure,
            mission=mission.source or "",
            process="" if self.together is None else self.together.process,
            peer_age_ms=None if self.together is None else self.together.ages_ms(),
            peer_tick_us=None if self.together is None else self.together.took_us(),
            backend=mission.backend,
            engine=engine,
            planner=mission.planner,
            ac=mission.ac,
            does=mission.mission.use,
            targets_from=mission.targets_from,
            modules=self.modules,
            robots=len(self.robots),
            seed=mission.seed,
            duration_s=duration_s,
            wall_s=round(self.wall_s, 3),
            real_time_factor=round(duration_s / self.wall_s, 1) if self.wall_s else 0.0,
            violations=self._violations(report),
            contacts=None if report is None else report.contacts,
            truth_ended_s=None if report is None or report.ended_s is None else round(report.ended_s, 2),
            ac_share=round(metrics.ac_share, 4),
            ac_share_without_charging=round(metrics.ac_share_without_charging, 4),
            disengagements=counts(metrics.disengagements, self.modules),
            joined=counts(metrics.joined, self.modules),
            disengagements_total=metrics.disengagements.total(),
            needless=metrics.needless,
            targets=targets,
            targets_reached=targets.reached,
            longest_stall_s=round(metrics.longest_stall_s, 2),
            accepted_unproved=self.unproved,
            longest_without_ac_s=round(metrics.standstills.longest_s, 2),
            permanent_stalls=metrics.standstills.permanent(metrics.end_s),
            never_moved=metrics.standstills.never_moved(duration_s),
            no_progress_s=round(metrics.no_progress_s, 2),
            min_margin=self._min_margin(report),
            paths_replaced=self.side.paths_replaced,
            no_certified_motion=sum(r.no_certified_motion for r in self.safety.recoveries.values()),
            monitors=module_figures(self.robots),
            dm_tick_us=metrics.tick_times(),
            missed_ticks=metrics.missed_ticks(self.jitter_s),
            tick_late_ms=metrics.tick_lateness() if self.wall_clock else None,
            real_time=self.real_time,
            sandbox=self.side.sandbox if isinstance(self.side, RemoteSide) else None,
            deterministic=not self.side.incidents and status == "completed",
            nondeterminism="; ".join(self.side.incidents),
            trace_sha256=self.trace.hexdigest(),
            faults=fault_figures(self.fleet),
            uncontrolled=metrics.uncontrolled,
            assumptions=breach_figures(self.robots),
            failed_robots={robot.robot_id: robot.ac_failure for robot in self.robots if robot.ac_failure},
        )
