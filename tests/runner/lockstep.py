"""Several processes of a mission in one test: real loops, each in a thread, one at a time, over one world and one bus.

Everybody sleeps on a clock of its own, which agrees with nobody's. Whoever is due first runs next, until it sleeps
again; world and network are moved to its time before. So a test repeats bit for bit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final

from soter.adapters.pybullet.backend import KinematicRobot
from soter.clock import Clock
from soter.config import MissionFile, load_mission
from soter.controllers import MISSION
from soter.distribution.bus import Bus
from soter.geometry.workspace import Workspace
from soter.record.recorder import Recorder
from soter.runner import RunResult
from soter.runner.hosts import make_host
from soter.runner.loop import Accepted, Loop
from soter.runner.mission_host import MissionHost
from soter.runner.part import Part
from soter.runner.peer_session import PeerSession
from soter.runner.progress import Follower
from soter.runner.run import NoRobots
from soter.sdk import Capabilities, Fleet, RobotSpec, RobotState, TruthReport
from soter.specs import robot_specs
from soter.stack.assembly import Study
from soter_sim import World
from tests.distribution.air import MemoryBus, Network

EXAMPLES = Path(__file__).parents[2] / "examples"
PERIOD_S = 0.05


class OwnClock(Clock):
    """The clock of one process.

    Attributes:
        offset_s: what it shows when the world begins.
    """

    def __init__(self, site: Site, offset_s: float) -> None:
        self.offset_s: Final = offset_s
        self._site: Final = site

    def now(self) -> float:
        return self.offset_s + self._site.network.now_s

    def steady_s(self) -> float:
        return self.now()

    def sleep_until(self, time_s: float) -> None:
        self._site.sleep_until(time_s - self.offset_s)


class OwnTimeRobot(KinematicRobot):
    """A robot whose samples are stamped by its process's clock, and ticked between the periods of its world."""

    declared: ClassVar[Capabilities] = replace(KinematicRobot.declared, sample_age_s=PERIOD_S, accel_m_s2=None)

    def __init__(self, spec: RobotSpec, clock: OwnClock, world: World) -> None:
        super().__init__(spec, clock, world)
        self._offset_s: Final = clock.offset_s
        self._seen: RobotState | None = None
        self._shifted: RobotState | None = None

    def _sample(self) -> RobotState:
        sample = super()._sample()
        if sample is not self._seen or self._shifted is None:
            self._seen = sample
            self._shifted = sample._replace(stamp_s=self._world.now_s + self._offset_s)
        return self._shifted


class OwnFleet(Fleet):
    """The robots of one process. Truth is the world's: it is asked for by the test, not by a process."""

    def __init__(self, world: World, specs: list[RobotSpec], clock: OwnClock) -> None:
        super().__init__(clock, [OwnTimeRobot(spec, clock, world) for spec in specs], None)

    def _close(self) -> None:
        """The world goes on for the others."""


@dataclass(frozen=True)
class OwnPart(Part):
    """A part of a mission that is joined to the others in this test."""

    site: Any = None
    host: str = ""

    def open_bus(self) -> Bus:
        return MemoryBus(self.site.network, self.host)


class Ended(BaseException):
    """This process is ended by its test, as by SIGKILL: nothing of it runs any more."""


@dataclass
class _Process:
    name: str
    thread: threading.Thread
    turn: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    wakes_s: float = 0.0
    killed: bool = False
    done: bool = False
    result: RunResult | None = None
    failure: BaseException | None = None


class Site:
    """Processes, their world, and what joins them.

    Args:
        processes: by name, which robots it has, and whether the planner.
        network: what joins them.
        record: a folder into which every process with robots records; None for none.
        mission: name of the example that is run.
        script: a mission in place of the example's own.
        overrides: of that mission; double underscores in names stand for dots.

    Attributes:
        said: what processes have said while they waited.
        results: by process, of those that came to an end.
        loops: by process, of those with robots that have begun.
        poses: at every period of the world, where the robots were: time, x, y of each.
    """

    def __init__(
        self,
        processes: Mapping[str, tuple[tuple[int, ...], bool]],
        network: Network | None = None,
        record: Path | None = None,
        mission: str = "surveillance",
        script: str | None = None,
        **overrides: Any,
    ) -> None:
        given: dict[str, Any] = {
            "backend": "kinematic",
            "planner": "straight-line",
            **({"targets": "uniform"} if script is None else {"mission": script}),
            "duration_s": 60.0,
        }
        given["distribution.processes"] = {
            name: {"robots": list(ids), "planner": plans} for name, (ids, plans) in processes.items()
        }
        given |= {key.replace("__", "."): value for key, value in overrides.items()}
        self.mission: Final[MissionFile] = load_mission(EXAMPLES / f"{mission}.toml", given)
        self.workspace: Final[Workspace] = self.mission.read_workspace()
        self.network: Final = network or Network(delay_s=(0.001, 0.004))
        promised = {place.id: OwnTimeRobot.declared for place in self.workspace.robots}
        self.specs: Final = [replace(spec, battery=1.0) for spec in robot_specs(self.mission, self.workspace, promised)]
        self.world: Final = World(self.workspace, self.specs, "kinematic")
        self._record: Final = record
        self.said: dict[str, list[str]] = {}
        self.loops: dict[str, Loop] = {}
        self.planner: Loop | None = None
        self.poses: list[tuple[float, dict[int, tuple[float, float]]]] = []
        self._plan: list[tuple[float, Callable[[], None]]] = []
        self._processes: dict[str, _Process] = {}
        self._mine: Final = threading.Semaphore(0)
        self._starts = 0
        self._duplicates: dict[str, str] = {}

    # --- what a test says ------------------------------------------------------------------------------------

    def at(self, time_s: float, action: Callable[[], None]) -> None:
        """Have something done at a time of the world."""
        self._plan.append((time_s, action))
        self._plan.sort(key=lambda each: each[0])

    def start(self, name: str, after_s: float = 0.0) -> None:
        """Start a process, or start it anew; its clock begins anywhere."""
        self._starts += 1
        process = _Process(name, threading.Thread(target=partial(self._run, name), name=name, daemon=True))
        process.wakes_s = self.network.now_s + after_s
        self._processes[name] = process
        process.thread.start()

    def start_duplicate(self, name: str) -> None:
        """Start a second process of a name, on a host of its own."""
        self._duplicates[f"{name} too"] = name
        self.start(f"{name} too")

    def kill(self, name: str) -> None:
        """End a process as SIGKILL does."""
        process = self._processes[name]
        process.killed = True
        process.turn.release()
        process.thread.join()
        for bus in [bus for bus in self.network.buses if bus.host == name]:
            bus.close()

    def run(self, until_s: float) -> TruthReport:
        """Run on until a time of the world, or until every process has ended; return what has really happened."""
        while True:
            waiting = [each for each in self._processes.values() if not each.done]
            next_s = min((each.wakes_s for each in waiting), default=until_s)
            if self._plan and self._plan[0][0] <= min(next_s, until_s):
                time_s, action = self._plan.pop(0)
                self._advance(time_s)
                action()
                continue
            if not waiting or next_s > until_s:
                self._advance(until_s)
                return self.world.truth.report()
            first = min(waiting, key=lambda each: each.wakes_s)
            self._advance(first.wakes_s)
            first.turn.release()
            self._mine.acquire()
            if first.failure is not None:
                raise first.failure

    def close(self) -> None:
        """End whatever still runs."""
        for name, process in self._processes.items():
            if not process.done:
                self.kill(name)
        self.world.close()

    @property
    def results(self) -> dict[str, RunResult]:
        return {name: each.result for name, each in self._processes.items() if each.result is not None}

    # --- one process -----------------------------------------------------------------------------------------

    def sleep_until(self, time_s: float) -> None:
        """Give way to the others until a time of the world. Called by the process whose turn it is."""
        process = self._processes[threading.current_thread().name]
        process.wakes_s = max(time_s, self.network.now_s)
        self._mine.release()
        process.turn.acquire()
        if process.killed:
            raise Ended

    def _part(self, name: str) -> OwnPart:
        processes = self.mission.distribution.processes
        mine = processes[self._duplicates.get(name, name)]
        homes = {robot_id: each for each, table in processes.items() for robot_id in table.robots}
        planner_home = "".join(
            each for each, table in processes.items() if table.planner and self.mission.ac == MISSION
        )
        promised = dict.fromkeys(homes, OwnTimeRobot.declared)
        return OwnPart(
            self._duplicates.get(name, name), self.mission, mine.robots, mine.planner, homes, planner_home, promised,
            "digest", self, name,
        )  # fmt: skip

    def _run(self, name: str) -> None:
        process = self._processes[name]
        process.turn.acquire()
        try:
            if not process.killed:
                process.result = self._loop(name)
        except Ended:
            pass
        except BaseException as failure:  # noqa: BLE001 - raised again by the test's own thread
            process.failure = failure
        process.done = True
        if not process.killed:
            self._mine.release()

    def _loop(self, name: str) -> RunResult:
        part, clock = self._part(name), OwnClock(self, 1000.0 * self._starts + 0.123)
        say = self.said.setdefault(name, []).append
        with PeerSession(part, clock) as session:
            if not part.robots:
                host = _mission_side(self, part)
                try:
                    fleet = NoRobots()
                    fleet.clock = clock
                    accepted = Accepted(part.mission, self.workspace)
                    self.planner = Loop(accepted, fleet, host, Study(), None, session)
                    return self._result(self.planner, say)
                finally:
                    host.close()
            return self._robots_loop(part, clock, session, say)

    def _robots_loop(
        self, part: OwnPart, clock: OwnClock, session: PeerSession, say: Callable[[str], None]
    ) -> RunResult:
        host = _mission_side(self, part)
        recorder = None if self._record is None else Recorder(self._record / f"{part.name}.mcap", waits=True)
        fleet = OwnFleet(self.world, [spec for spec in self.specs if spec.id in part.robots], clock)
        try:
            host.ready()
            for robot in fleet.robots:
                robot.init(1.0)
            loop = Loop(Accepted(part.mission, self.workspace), fleet, host, Study(), recorder, session)
            self.loops[part.name] = loop
            return self._result(loop, say)
        finally:
            host.close()
            if recorder is not None:
                recorder.close()

    def _result(self, loop: Loop, say: Callable[[str], None]) -> RunResult:
        assert loop.begin(Follower(say=say))
        status, failure = loop.run(Follower())
        return loop.result(status, failure, None)

    def _advance(self, time_s: float) -> None:
        while self.world.now_s + PERIOD_S <= time_s + 1e-9:
            until_s = self.world.now_s + PERIOD_S
            self.network.advance(max(until_s, self.network.now_s))
            self.world.advance(until_s)
            bodies = self.world.bodies
            places = {robot_id: (bodies.x[index], bodies.y[index]) for index, robot_id in enumerate(bodies.ids)}
            self.poses.append((self.world.now_s, places))
        self.network.advance(max(time_s, self.network.now_s))


def _mission_side(site: Site, part: Part) -> MissionHost:
    radii_m = {robot_id: each.body_radius_m for robot_id, each in part.promised.items()}
    return make_host(part.mission, site.workspace, radii_m, virtual_time=True, part=part)
