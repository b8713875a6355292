"""Runs a mission: opens the backend, and ticks its robots until the time is up."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Final

from soter.check.admission import refused_at
from soter.check.mission import admitted
from soter.clock import VehicleClock
from soter.config import MissionFile
from soter.controllers import refuse_unknown_tables
from soter.errors import ConfigError, IllFormedModule, RunFailed
from soter.faults import FaultyFleet, read_faults
from soter.geometry.workspace import Workspace
from soter.isolation.supervisor_end import BEGIN_S
from soter.record.recorder import Recorder
from soter.registry import load_backend, missing_library
from soter.runner.hosts import make_host
from soter.runner.loop import Accepted, Loop
from soter.runner.machine_host import MachineHost
from soter.runner.mission_host import MissionHost
from soter.runner.part import Part, refuse_in_one_process
from soter.runner.peer_session import PeerSession
from soter.runner.progress import Follower
from soter.runner.remote_host import RemoteMissionHost
from soter.runner.result import Run
from soter.runner.watchdog import SLOW_S, CutOff, Watchdog
from soter.sdk import Fleet
from soter.specs import asked, promises, read_options, robot_specs
from soter.stack.assembly import Study

logger = logging.getLogger(__name__)

INIT_TIMEOUT_S: Final = 60.0


def run_mission(
    mission: MissionFile,
    *,
    record: Path | None = None,
    sign: Path | None = None,
    follower: Follower | None = None,
    study: Study | None = None,
    accept_unproved: bool = False,
    process: str | None = None,
) -> Run:
    """Run a mission to its end. Call it from the main thread: only there can a blocked handler be interrupted.

    Args:
        mission: from `soter.config.load_mission`.
        record: file to record to, or None. An old recording there is replaced when the new one is complete. The
            returned run says what could not be recorded.
        sign: the private key that the recording is signed with, or None; see `soter.record.signing`.
        follower: follows the run and may end it; None for nobody.
        study: changes to the modules that no mission may make; on simulated robots only. Unproved conditions are then
            accepted.
        accept_unproved: whether to run although conditions are not proved; the result lists them.
        process: the process of a distributed mission that this is; None for a mission in one process.

    Returns:
        The finished run. Whatever ended it, its robots are stopped by then.

    Raises:
        ConfigError: bad input, or a module that is not proved; nothing has moved.
        BackendError: the backend cannot be opened or a robot does not get ready; nothing has moved.
        IllFormedModule: a safety module cannot keep its rule on these robots; nothing has moved.
    """
    follower = follower or Follower()
    preparing = follower.connecting or nullcontext
    with preparing():
        workspace = mission.read_workspace()
        part = None if process is None else Part.of(mission, workspace, process)
    if part is not None and not part.robots:
        if record is not None:
            raise ConfigError(f"process '{process}' has no robots, and so there is nothing to record", key="--record")
        return _run_task_planner(part, workspace, follower)
    # Proofs take seconds in a large world, trials many. Studies ask about modules that are not proved.
    with preparing(), _watched_trials(follower) as tell:
        backend_class = load_backend(mission.backend)
        config = read_options(backend_class, mission, workspace)
        refuse_unknown_tables(mission)
        specs = robot_specs(mission, workspace, asked(backend_class, config, mission, workspace))
        faults = read_faults(mission, [spec.id for spec in specs])
        promised = promises(backend_class, config, mission, workspace)  # refuses bodies that do not fit
        radii_m = {robot_id: each.body_radius_m for robot_id, each in promised.items()}
        if part is None:
            refuse_in_one_process(mission, backend_class)
        else:
            specs = [spec for spec in specs if spec.id in part.robots]
        unproved = admitted(
            mission, workspace, backend_class, config, ill_formed=study is not None and study.on_ill_formed is not None,
            unproved=accept_unproved or study is not None, on_progress=tell,
        )  # fmt: skip
    declared = backend_class.robot_class.declared
    unasked = nullcontext if declared.in_process else preparing
    with ExitStack() as stack:
        if study is not None and not declared.in_process:
            raise mission.refusal("backend", f"it is '{mission.backend}', but studies run in virtual time only")
        # Closed after everything else: closing takes time, in which no robot may move.
        recorder = (
            None
            if record is None
            else stack.enter_context(Recorder(record, waits=declared.in_process, sign=sign, stop=follower.stop))
        )
        watchdog = stack.enter_context(Watchdog())
        if recorder is not None:
            watchdog.last_words = recorder.close
        host: MissionHost
        if declared.in_process:
            host = make_host(mission, workspace, radii_m, virtual_time=True)
        else:
            # On a wall clock the supervisor must never wait for the ACs.
            host = RemoteMissionHost(mission, workspace, radii_m, part=part)
        watchdog.handler = lambda: host.current_handler
        stack.callback(_end, host, watchdog)
        with unasked():
            # Before robots are connected: it finds what a script, a controller or a planner does not allow.
            host.ready()
        try:
            fleet = stack.enter_context(backend_class().open(config, specs))
        except ImportError as failure:
            raise missing_library(mission.backend, failure) from failure
        if faults:
            faulty = FaultyFleet(fleet, faults, mission.seed, mission.base_tick_s, mission.reseed)
            fleet = stack.enter_context(faulty)
        with unasked():
            session = None if part is None else stack.enter_context(PeerSession(part, fleet.clock))
            for robot in fleet.robots:
                robot.init(INIT_TIMEOUT_S)
        try:
            accepted = Accepted(mission, workspace, unproved)
            loop = Loop(accepted, fleet, host, study or Study(), recorder, session, watchdog)
        except IllFormedModule as failure:
            raise refused_at(failure, mission, workspace, backend_class, config) from failure
        status, failure_text = "interrupted", ""
        if loop.begin(follower):
            status, failure_text = loop.run(follower)
        engine = getattr(config, "engine", None)
        run = Run(loop.result(status, failure_text, engine), loop.tracks, falls=tuple(loop.falls))
        if recorder is not None:
            recorder.finish(run.result.model_dump_json(indent=2).encode())
    return run if recorder is None else replace(run, recording=recorder.close())


@contextmanager
def _watched_trials(follower: Follower) -> Iterator[Callable[[str], None]]:
    """Yield what is to be called before each trial of a user's module: none may block, or keep a run from its end."""
    with Watchdog() as watchdog:

        def tell(text: str) -> None:
            watchdog.ticks += 1
            watchdog.phase = f"{text}, which", BEGIN_S
            watchdog.check()
            if follower.stop():
                raise KeyboardInterrupt
            if follower.trying is not None:
                follower.trying(text)

        try:
            yield tell
        except CutOff as failure:
            raise RunFailed(str(failure)) from failure


def _end(host: MissionHost, watchdog: Watchdog) -> None:
    """Close the mission host; a failure there does not change the run's result."""
    try:
        with watchdog.over("the mission's end", SLOW_S):
            host.close()
    except CutOff as failure:
        logger.error("%s", failure)


class NoRobots(Fleet):
    """A fleet of a process that has no robots."""

    def __init__(self) -> None:
        super().__init__(VehicleClock(), (), None)

    def _close(self) -> None:
        pass


def _run_task_planner(part: Part, workspace: Workspace, follower: Follower) -> Run:
    """Run a task planner whose robots are all in other processes: it gives targets, and counts how they end.

    Safety does not rest on it.
    """
    with ExitStack() as stack:
        watchdog = stack.enter_context(Watchdog())
        fleet = stack.enter_context(NoRobots())
        session = stack.enter_context(PeerSession(part, fleet.clock))
        radii_m = {robot_id: each.body_radius_m for robot_id, each in part.promised.items()}
        host = MachineHost(part.mission, workspace, radii_m, virtual_time=False, part=part)
        watchdog.handler = lambda: host.current_handler
        stack.callback(_end, host, watchdog)
        loop = Loop(Accepted(part.mission, workspace), fleet, host, Study(), None, session, watchdog)
        status, failure = "interrupted", ""
        if loop.begin(follower):
            status, failure = loop.run(follower)
        return Run(loop.result(status, failure, None), loop.tracks)
