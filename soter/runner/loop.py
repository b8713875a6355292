"""One run, from the first tick to the last: binds the safety side to robots and ACs, ticks, sums up."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Final, NamedTuple

from soter.check.user_rules import UserRules
from soter.config import MissionFile
from soter.errors import BackendError, ConfigError, RunFailed
from soter.geometry.workspace import Workspace
from soter.isolation.supervisor_end import BEGIN_S
from soter.record.about import Setup
from soter.record.recorder import Recorder, TargetLog
from soter.record.tracks import RunTracks
from soter.rta import RemotePeer, Watch
from soter.runner.metrics import Metrics, breach_figures, counts, fault_figures, module_figures
from soter.runner.mission_host import MissionHost, OwnRoom, Scene, arrival_m
from soter.runner.needless import NeedlessJudge
from soter.runner.peer_session import PeerSession
from soter.runner.progress import Follower, Progress, ProgressThread, robot_progress
from soter.runner.real_time import real_time
from soter.runner.remote_host import WALL_CLOCK
from soter.runner.result import RunResult
from soter.runner.trace import Trace
from soter.runner.watchdog import SLOW_S, CutOff, Watchdog
from soter.runner.whole_truth import WholeTruth
from soter.sdk import Fleet, TruthReport
from soter.stack.assembly import Others, SafetySide, Study, assemble
from soter.stack.declaration import timing_of

logger = logging.getLogger(__name__)

DISC_SLACK_M: Final = 0.05
"""How much farther than the collision module's distance plans keep from robots that stand in the way."""

_DECIDING: Final = "a safety module", SLOW_S
_JUDGING: Final = "the rule of a safety module", SLOW_S
_LOOK_TICKS: Final = 64


class Accepted(NamedTuple):
    """A mission that may be run.

    Attributes:
        mission: the mission.
        workspace: fence, boxes, chargers.
        unproved: conditions that are not proved, but were accepted.
    """

    mission: MissionFile
    workspace: Workspace
    unproved: tuple[str, ...] = ()


class Loop:
    """One run, from the first tick to the last.

    Args:
        accepted: the mission to run.
        fleet: the robots, ready; no robots if the mission's task planner is alone in its process.
        host: runs the ACs.
        study: changes to the modules.
        recorder: records the run, or None.
        session: the other processes of a distributed mission, or None.
        watchdog: ends the run if foreign code does not return; None for no such limit.
    """

    def __init__(
        self,
        accepted: Accepted,
        fleet: Fleet,
        host: MissionHost,
        study: Study,
        recorder: Recorder | None,
        session: PeerSession | None = None,
        watchdog: Watchdog | None = None,
    ) -> None:
        mission, workspace, self.unproved = accepted
        self.falls: Final[list[tuple[float, float]]] = []
        self.mission: Final = mission
        self.workspace: Final = workspace
        self.fleet: Final = fleet
        self.host: Final = host
        self.session: Final = session
        self.recorder: Final = recorder
        self.watchdog: Final = watchdog or Watchdog()
        self.modules: Final = mission.rta.order
        safer_inset_m = mission.rta.geofence.phi_safer_inset_m if "geofence" in self.modules else None
        robot_ids = [robot.id for robot in fleet.robots]
        self.metrics: Final = Metrics(workspace, self.modules, robot_ids, safer_inset_m)
        watches: list[Watch] = [self.metrics] if recorder is None else [self.metrics, recorder]
        self.safety: Final[SafetySide] = assemble(
            mission, workspace, fleet.robots, host.hear, watches, tap=None if recorder is None else recorder.tap,
            study=study, others=self._others(recorder, robot_ids),
        )  # fmt: skip
        self.robots: Final = tuple(self.safety.supervisor.robots.values())
        self.trace: Final = Trace()
        self.ticks = 0
        # A run without robots is a process of a distributed mission, on a wall clock.
        self.wall_clock: Final = not fleet.robots or not all(robot.capabilities.in_process for robot in fleet.robots)
        self.real_time = False
        self.jitter_s: Final = max((robot.capabilities.jitter_s for robot in fleet.robots), default=math.inf)
        self.wall_s = 0.0
        speeds = {robot.id: robot.capabilities.v_max_m_s for robot in fleet.robots}
        self.metrics.judge = NeedlessJudge(self.safety.supervisor.robots, self.safety.robots, speeds).judge
        own = {robot_id: robot.declared.own for robot_id, robot in self.safety.robots.items()}
        truth = fleet.truth
        self.truth: Final = None if truth is None else WholeTruth(truth, UserRules(truth, own))

    def _others(self, recorder: Recorder | None, robot_ids: Sequence[int]) -> Others:
        if self.session is None:
            return Others()
        peers: Sequence[RemotePeer] = self.session.peers
        taps = peers if recorder is None else [recorder.tap_peer(peer, robot_ids) for peer in peers]
        return Others(taps, self.session.promises)

    def begin(self, follower: Follower) -> bool:
        """Begin, as soon as all other processes have joined, shortly before the first tick.

        Returns:
            False when told to stop.

        Raises:
            ConfigError: another process of this name is running, or the recording cannot be written.
            RobotUnavailable: the others have not joined in time.
            RunFailed: the mission host does not return.
        """
        session, robots = self.session, self.fleet.robots
        if session is not None and not session.wait(robots, follower):
            return False
        self._begin()
        if self.recorder is not None and follower.recording is not None:
            follower.recording(self.recorder.writing)
        # All that took its time, in which the others heard nothing.
        return session is None or session.wait(robots, follower, again=True)

    def _begin(self) -> None:
        """Begin the recording and the mission host."""
        recorder, safety = self.recorder, self.safety
        rooms = {
            robot.id: OwnRoom(
                safety.robots[robot.id].terrain,
                safety.robots[robot.id].trigger_m + DISC_SLACK_M,
                arrival_m(robot.capabilities),
            )
            for robot in self.fleet.robots
        }
        log: TargetLog = self.metrics
        if recorder is not None:
            self._begin_recording(recorder)
            log = recorder
        scene = Scene(
            self.fleet.clock, self.workspace, rooms, safety.ports, log,
            None if recorder is None else recorder.on_transition,
            {} if self.session is None else self.session.ports,
            {robot.id: robot.capabilities for robot in self.fleet.robots},
        )  # fmt: skip
        try:
            with self.watchdog.over("the mission's beginning", BEGIN_S):
                self.host.start(scene)
        except CutOff as failure:
            raise RunFailed(str(failure)) from failure

    def _begin_recording(self, recorder: Recorder) -> None:
        promises = {robot.id: robot.capabilities for robot in self.fleet.robots}
        setup = Setup(
            self.mission, self.workspace, self.robots, self.safety.modules, promises,
            {robot_id: timing_of(each, self.mission.base_tick_s) for robot_id, each in promises.items()},
            {} if self.session is None else self.session.promises, self.unproved,
        )  # fmt: skip
        try:
            recorder.begin(setup, self.fleet, self.truth, self.metrics, self.metrics.standstills.stalls)
        except OSError as failure:
            why = failure.strerror or failure
            raise ConfigError(f"'{recorder.path}' cannot be recorded to: {why}", key="record") from failure

    def run(self, follower: Follower) -> tuple[str, str]:
        """Tick until the time is up; return the status, and the reason of a failure."""
        start_s = time.perf_counter()
        try:
            with ExitStack() as stack:
                if follower.show is not None and self.wall_clock:
                    follower = replace(follower, show=stack.enter_context(ProgressThread(follower.show)).put)
                wanted = self.mission.isolation.real_time
                if self.wall_clock and self.robots and wanted != "never":
                    self.real_time = stack.enter_context(real_time(required=wanted == "always"))
                status = self._tick_on(start_s, follower)
            failure = self.host.failures.get(None) or self.host.not_begun
            # Their SCs brought the robots home, but the mission was not done.
            return ("failed", failure) if failure and status == "completed" else (status, "")
        except (RunFailed, BackendError, CutOff) as failure:
            logger.error("the run failed: %s", failure)
            return "failed", str(failure)
        except KeyboardInterrupt:
            return "interrupted", ""
        finally:
            self.watchdog.phase = None
            self.wall_s = time.perf_counter() - start_s
            self.metrics.finish(self.ticks * self.mission.base_tick_s)

    def _tick_on(self, start_s: float, follower: Follower) -> str:
        base_tick_s, clock, host = self.mission.base_tick_s, self.fleet.clock, self.host
        began_s = clock.now()
        self.metrics.begin(began_s)
        supervisor, metrics, trace, robots = self.safety.supervisor, self.metrics, self.trace, self.robots
        charging, recorder, session, watchdog = self.safety.charging, self.recorder, self.session, self.watchdog
        # The world's own judgement goes on by itself.
        own_rules = self.truth if self.truth is not None and self.truth.judges_own_rules else None
        last = round(self.mission.duration_s / base_tick_s)
        show, pace, stop = follower.show, follower.pace, follower.stop
        falls_of, lost = follower.falls_of, self.fleet.lost
        shown_s = -math.inf
        look_ticks = 1 if self.wall_clock else _LOOK_TICKS
        for tick in range(last):
            host.receive()
            if session is not None:
                session.look()
            # In virtual time the clock shows exactly this time; on a wall clock it shows how late the tick is.
            now_s = clock.now()
            late_s = now_s - (began_s + tick * base_tick_s)
            watchdog.phase = _DECIDING
            supervisor.tick(now_s)
            watchdog.phase = None
            if session is not None:
                session.tell(robots)
            host.run(now_s)
            watchdog.check()
            if host.failures:
                self._fail_acs()
            trace.add(now_s, robots)
            metrics.tick(now_s, tick, late_s, robots, charging)
            if recorder is not None:
                recorder.tick(now_s, tick)
            if show is not None and tick % look_ticks == 0:
                # From here on there is time until the next tick.
                wall_s = time.perf_counter()
                if wall_s - shown_s >= follower.every_s:
                    shown_s = wall_s
                    show(self._progress(wall_s - start_s))
            clock.sleep_until(began_s + (tick + 1) * base_tick_s)
            self.ticks = watchdog.ticks = tick + 1
            if pace is not None:
                pace(self.ticks * base_tick_s)
            if cause := lost():
                raise RunFailed(cause)
            if own_rules is not None:
                watchdog.phase = _JUDGING
                own_rules.look(clock.now(), robots)
                watchdog.phase = None
            if falls_of:
                self._follow(falls_of, clock.now())
            if stop():
                return "interrupted"
            if host.done:
                break
        return "completed"

    def _fail_acs(self) -> None:
        if not self.robots:
            raise RunFailed(next(iter(self.host.failures.values())))
        for robot_id, cause in self.host.failures.items():
            for robot in self.robots:
                if robot_id is None or robot_id == robot.robot_id:
                    robot.fail_ac(cause)

    def _progress(self, wall_s: float) -> Progress:
        robots = robot_progress(self.robots, self.metrics)
        if not robots and self.session is not None:
            reached = self.metrics.reached_by_robot
            robots = tuple(each._replace(targets_reached=reached[each.robot_id]) for each in self.session.progress())
        return Progress(
            self.ticks * self.mission.base_tick_s, self.mission.duration_s, wall_s, robots,
            self._violations(self._report()),
        )  # fmt: skip

    def _report(self) -> TruthReport | None:
        return None if self.truth is None else self.truth.report()

    def _violations(self, report: TruthReport | None) -> dict[str, int] | None:
        if report is None or self.truth is None:
            return None
        return {rule: report.count(rule) for rule in self.truth.rules}

    @property
    def tracks(self) -> RunTracks:
        """The ways of the robots, with what ground truth saw broken."""
        report = self._report()
        return replace(self.metrics.tracks, violations=() if report is None else report.violations)

    @staticmethod
    def _min_margin(report: TruthReport | None) -> dict[str, float] | None:
        if report is None:
            return None
        # The one NaN: so results with it are equal to each other.
        return {
            rule: math.nan if math.isnan(margin) else round(margin, 5) for rule, margin in report.min_margin.items()
        }

    def _follow(self, rule: str, now_s: float) -> None:
        """Note the time if a rule's least margin has fallen; later random draws cannot change that."""
        margin = (self._min_margin(self._report()) or {}).get(rule)
        if margin is not None and math.isnan(margin):
            # It counts as broken, and nothing is less.
            margin = -math.inf
        if margin is not None and not (self.falls and margin >= self.falls[-1][1]):
            self.falls.append((round(now_s, 9), margin))

    def result(self, status: str, failure: str, engine: str | None) -> RunResult:
        metrics, mission, report = self.metrics, self.mission, self._report()
        duration_s = round(self.ticks * mission.base_tick_s, 6)
        targets = metrics.target_counts()
        incidents = [*self.host.incidents] or [WALL_CLOCK] * self.wall_clock
        return RunResult(
            status=status,
            failure=failure,
            mission=mission.source or "",
            process="" if self.session is None else self.session.process,
            peer_age_ms=None if self.session is None else self.session.ages_ms(),
            peer_tick_us=None if self.session is None else self.session.took_us(),
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
            paths_replaced=self.host.paths_replaced,
            no_certified_motion=sum(each.declared.recovery.no_certified_motion for each in self.safety.robots.values()),
            monitors=module_figures(self.robots),
            dm_tick_us=metrics.tick_times(),
            answered=None if self.host.answers is None else round(min(self.host.answers / max(self.ticks, 1), 1.0), 4),
            missed_ticks=metrics.missed_ticks(self.jitter_s),
            tick_late_ms=metrics.tick_lateness() if self.wall_clock else None,
            real_time=self.real_time,
            sandbox=self.host.sandbox,
            deterministic=not incidents and status == "completed",
            nondeterminism="; ".join(incidents),
            trace_sha256=self.trace.hexdigest(),
            faults=fault_figures(self.fleet),
            uncontrolled=metrics.uncontrolled,
            assumptions=breach_figures(self.robots),
            failed_robots={robot.robot_id: robot.ac_failure for robot in self.robots if robot.ac_failure},
        )
