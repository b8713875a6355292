"""Missions for tests, by what they do."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, ClassVar, Final

from soter.errors import ConfigError
from soter.machine import Event, Goto, Machine, Next, State, Stay
from soter.missions import Arrival, Mission, Robot, Stage
from soter.sdk import Waypoint
from soter.stack.events import Disengaged, GoalEnded, Reengaged, TargetEnded, VisitTarget
from soter.stack.kit import RobotKit
from soter.stack.remote import robot_agent

ARRIVALS: Final[list[tuple[int, Arrival]]] = []
"""What robots were told of their goals, in this order. Tests empty it."""

SEEN: Final[list[Any]] = []
"""What else scripts have found. Tests empty it."""


class Ends(Mission):
    """Goes to one place, as told, and ends."""

    class Options(Mission.Options):
        """Where to, and how hard to try."""

        place: tuple[float, float]
        timeout_s: float | None = None
        tries: int = 3

    options: Options

    async def run(self, robot: Robot) -> None:
        if robot.id == 1:
            options = self.options
            arrived = await robot.go_to(*options.place, timeout_s=options.timeout_s, tries=options.tries)
            ARRIVALS.append((robot.id, arrived))


class StandsAbout(Ends):
    """Goes to one place, as told, while the other robot does nothing, for longer."""

    async def run(self, robot: Robot) -> None:
        await (super().run(robot) if robot.id == 1 else robot.sleep(40.0))


class Wanders(Mission):
    """Goes to places that are drawn."""

    async def run(self, robot: Robot) -> None:
        while True:
            await robot.go_to(robot.random.uniform(1.0, 4.0), robot.random.uniform(1.0, 4.0))


class Roams(Mission):
    """Goes to and fro between the room and beyond the fence, once its robot and the others are seen."""

    async def run(self, robot: Robot) -> None:
        await robot.until(lambda: robot.state is not None and all(each.state for each in robot.peers.values()))
        while True:
            for place in [(float(robot.id), 4.5), (float(robot.id), 5.5), (3.0 + robot.id / 2.0, 2.0)]:
                ARRIVALS.append((robot.id, await robot.go_to(*place, timeout_s=30.0)))


class Meets(Mission):
    """Robot 2 waits for robot 1, and both say when."""

    ready = False

    async def run(self, robot: Robot) -> None:
        if robot.id == 1:
            await robot.sleep(3.0)
            self.ready = True
        else:
            SEEN.append(await robot.until(lambda: self.ready, timeout_s=1.0))
            SEEN.append(await robot.until(lambda: self.ready))
        SEEN.append((robot.id, round(robot.now(), 3)))


class Looks(Mission):
    """Looks around."""

    async def run(self, robot: Robot) -> None:
        await robot.until(lambda: robot.state is not None and robot.engaged)
        peer = robot.peers[3 - robot.id]
        assert robot.state is not None
        assert peer.state is not None
        SEEN.append((robot.id, robot.state.x_m, peer.id, peer.state.x_m, peer.engaged, robot.workspace.width_m))
        self.log(f"robot {robot.id} has looked")


class Raises(Mission):
    """Robot 1's script fails; the others wander."""

    async def run(self, robot: Robot) -> None:
        await robot.sleep(0.5)
        if robot.id == 1:
            raise RuntimeError("out of ideas")
        await Wanders.run(self, robot)  # type: ignore[arg-type]


class AwaitsAnything(Mission):
    async def run(self, robot: Robot) -> None:
        await asyncio.sleep(1.0)


class AwaitsNoLoop(Mission):
    async def run(self, robot: Robot) -> None:
        await asyncio.sleep(0)


class GoesToNone(Mission):
    async def run(self, robot: Robot) -> None:
        await robot.go_to(None, 2.0)  # type: ignore[arg-type]


class SleepsInWords(Mission):
    async def run(self, robot: Robot) -> None:
        await robot.sleep("5")  # type: ignore[arg-type]


class Interrupts(Mission):
    """Robot 1's script raises what Ctrl-C does."""

    async def run(self, robot: Robot) -> None:
        if robot.id == 1:
            raise KeyboardInterrupt
        await robot.sleep(100.0)


class AwaitsNothing(Mission):
    async def run(self, robot: Robot) -> None:
        while True:
            pass


class TalksToItself(Mission):
    """Its machine never comes to rest."""

    def begin(self, stage: Stage) -> None:
        stage.create(_TalksToItself, None, "it")


class TargetsNowhere(Mission):
    """Tells of targets that no file can hold."""

    def begin(self, stage: Stage) -> None:
        stage.on_target(1, 1, (float("nan"), 1.0))
        stage.on_target(2, 10**30, (1.0, 1.0))


class Word(Event):
    pass


class _TalksToItself(Machine):
    Talking: State[None] = State(start=True)

    @Talking.entry
    def _begin(self, _: None) -> Stay:
        self.after(1.0, Word())
        return Stay()

    @Talking.on(Word)
    def _says(self, _: Word) -> Stay:
        self.send(self.ref, Word())
        return Stay()


class NeverLetsGo(Mission):
    """Wants to drive when all is over, and says what no file can hold."""

    async def run(self, robot: Robot) -> None:
        self.log("\ud800 and a number follow")
        self.log(3)
        try:
            await robot.sleep(1000.0)
        finally:
            await robot.go_to(1.0, 1.0)


class Chatters(Mission):
    """Talks without end, and at length."""

    async def run(self, robot: Robot) -> None:
        for _ in range(20_000):
            self.log("x" * 1000)
        self.log("y" * 1_000_000)
        await robot.sleep(1000.0)


class Exits(Mission):
    """Would end the whole program."""

    async def run(self, robot: Robot) -> None:
        raise SystemExit(7)


class Cancels(Mission):
    """Ends by what is no `Exception`."""

    async def run(self, robot: Robot) -> None:
        raise asyncio.CancelledError("never mind")


class GoesNowhere(Mission):
    async def run(self, robot: Robot) -> None:
        refused = 0
        for x_m, options in [
            (float("inf"), {}),
            (1.0, {"timeout_s": 0.0}),
            (1.0, {"timeout_s": 1e7}),
            (1.0, {"tries": 0}),
        ]:
            try:
                await robot.go_to(x_m, 1.0, **options)  # type: ignore[arg-type]
            except ValueError:
                refused += 1
        SEEN.append(refused)
        await robot.go_to(float("nan"), 1.0)


class UsesOther(Mission):
    """Robot 1's script uses robot 2's handle."""

    handles: ClassVar[dict[int, Robot]] = {}

    async def run(self, robot: Robot) -> None:
        self.handles[robot.id] = robot
        await robot.sleep(1.0)
        if robot.id == 1:
            await self.handles[2].sleep(1.0)
        await robot.sleep(100.0)


class WaitsForCoroutine(Mission):
    async def run(self, robot: Robot) -> None:
        async def arrived() -> bool:
            return False

        await robot.until(arrived)  # type: ignore[arg-type] # what a user has got wrong


class WaitsForTruth(Mission):
    async def run(self, robot: Robot) -> None:
        await robot.until(robot.now() > 100.0)  # type: ignore[arg-type] # what a user has got wrong


class WaitsForNoNumber(Mission):
    async def run(self, robot: Robot) -> None:
        await robot.until(lambda: False, timeout_s=math.nan)


class TriesInHalves(Mission):
    async def run(self, robot: Robot) -> None:
        await robot.go_to(2.0, 2.0, tries=1.5)  # type: ignore[arg-type]


class CannotBegin(Mission):
    def begin(self, stage: Stage) -> None:
        raise RuntimeError("no stage")


class RefusesLate(Mission):
    """Finds out only when it begins that it cannot be done as told."""

    class Options(Mission.Options):
        """How fast."""

        speed_m_s: float = 1.0

    def begin(self, stage: Stage) -> None:
        raise ConfigError("it is 3, allowed: 1", key="mission.speed_m_s")


class CannotBeMade(Mission):
    def __init__(self, options: Any) -> None:
        raise RuntimeError("not today")

    async def run(self, robot: Robot) -> None: ...


class Plain(Mission):
    def run(self, robot: Robot) -> None:  # type: ignore[override]
        """Is no coroutine."""


class BeginsAsync(Mission):
    async def begin(self, stage: Stage) -> None:  # type: ignore[override] # what a user has got wrong
        """Would never be awaited."""


class ChecksAsync(Looks):
    @classmethod
    async def check_workspace(cls, *_: Any) -> None:  # type: ignore[override]
        """Would never be awaited."""


class Nothing(Mission):
    pass


class WrongOptions(Mission):
    Options = dict  # type: ignore[assignment]

    async def run(self, robot: Robot) -> None: ...


class NoMission:
    pass


class Shuttle(Mission):
    """A task planner of its own over the robot agents: to and fro, a machine for each robot."""

    def begin(self, stage: Stage) -> None:
        for robot_id in stage.kits:
            stage.create(ShuttlePlanner, (stage, robot_id, self.finish), f"ShuttlePlanner {robot_id}")


class ShuttlePlanner(Machine):
    """Sends its robot to and fro five times, and ends the run."""

    Going: State[tuple[Stage, int, Callable[[], None]]] = State(start=True)

    @Going.entry
    def _start(self, given: tuple[Stage, int, Callable[[], None]]) -> Next:
        self.stage, self.robot_id, self.finish = given
        kit = self.stage.kits[self.robot_id]
        self.agent = self.create(robot_agent(kit), (kit, self.ref), name=f"RobotAgent {self.robot_id}")
        self.number = 0
        return self._next()

    @Going.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        self.stage.on_ended(e.robot_id, e.target_id, e.outcome)
        return self._next()

    def _next(self) -> Next:
        self.number += 1
        if self.number > 5:
            self.finish()
            return Stay()
        place = (1.5 + 2.0 * (self.number % 2), float(self.robot_id) + 1.0)
        target_id = self.robot_id * 1000 + self.number
        self.stage.on_target(self.robot_id, target_id, place)
        self.send(self.agent, VisitTarget(target_id, place))
        return Stay()


class Straight(Mission):
    """Planner and executor of its own: a machine for each robot that asks its port, without any plan."""

    def begin(self, stage: Stage) -> None:
        for robot_id, kit in stage.kits.items():
            stage.create(StraightDriver, kit, f"StraightDriver {robot_id}")


class StraightDriver(Machine):
    Waiting: State[RobotKit | None] = State(start=True, ignore=(GoalEnded,))
    Driving: State[None] = State()

    @Waiting.entry
    def _start(self, kit: RobotKit | None) -> Next:
        if kit is not None:
            self.kit = kit
            self.reached = 0
            kit.subscribe(kit.robot_id, self.ref, (GoalEnded, Disengaged, Reengaged))
        return Stay()

    @Waiting.on(Reengaged)
    def _engaged(self, e: Reengaged) -> Next:
        return Goto(self.Driving)

    @Driving.entry
    def _drive(self) -> Next:
        x = 1.5 if self.reached % 2 else 3.5
        self.goal_id = self.kit.port.goto(Waypoint(x, float(self.kit.robot_id) + 1.0, radius_m=0.1, timeout_s=60.0))
        return Stay()

    @Driving.on(GoalEnded)
    def _ended(self, e: GoalEnded) -> Next:
        if e.goal_id != self.goal_id:
            return Stay()
        self.reached += e.status == "reached"
        SEEN.append((self.kit.robot_id, e.status))
        return Goto(self.Driving)

    @Driving.on(Disengaged)
    def _lost(self, e: Disengaged) -> Next:
        return Goto(self.Waiting, None)
