"""Scripts: one coroutine per robot, driven by a machine of its own, and the handle that commands the robot."""

from __future__ import annotations

import math
import random
from collections.abc import Awaitable, Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any, Final

from soter.errors import SoterError, account_of, is_interruption
from soter.geometry.workspace import Workspace
from soter.loading import described, line_in
from soter.machine import Event, Goto, Machine, MachineRef, MisuseError, Next, State
from soter.machine.errors import ForeignAwait
from soter.missions.stage import Stage
from soter.problems import shown_value
from soter.sdk import MAX_COORDINATE_M, RobotState
from soter.sdk.capabilities import is_finite
from soter.stack.events import TRIES, TargetEnded, TargetOutcome, VisitTarget
from soter.stack.kit import RobotPort
from soter.stack.remote import RemoteKit, robot_agent

LONGEST_S: Final = 1e6
"""Longest time-out of a goal, as in mission files."""

MOST_TRIES: Final = 1000

_OF_ASYNCIO: Final = ("event loop", "Task got bad yield")
"""What asyncio says if its coroutines are awaited here, or a script's by asyncio."""

_INSTEAD: Final = "; a script awaits robot.go_to, robot.sleep and robot.until, one at a time"


class ScriptFailed(SoterError):
    """A script raised an exception, which is the `__cause__` of this one; its robot has no AC from then on."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """How a goal ended; true if the robot has reached it.

    Attributes:
        outcome: reached, unsafe (geofence or obstacle took the robot), blocked (too many tries), or timed out.
        module: the safety module that ended it by taking the robot over; empty for any other end.
        reason: why the module took the robot, or why no path led there, in words.
    """

    outcome: TargetOutcome
    module: str = ""
    reason: str = ""

    def __bool__(self) -> bool:
        return self.outcome is TargetOutcome.REACHED

    @property
    def why(self) -> str:
        """The end in words: reached, timed out, taken over by a module, or refused."""
        if self.outcome in {TargetOutcome.REACHED, TargetOutcome.TIMED_OUT}:
            return "reached" if self else "timed out"
        return f"taken over by {self.module}" if self.module else f"refused: {self.reason}"


class Peer:
    """What a script sees of a robot: its state, and whether its AC has control."""

    def __init__(self, robot_id: int, port: RobotPort | None) -> None:
        self.id: Final = robot_id
        self._port: Final = port

    @property
    def state(self) -> RobotState | None:
        """The latest sample: place and heading in the workspace's frame, speed, charge; None while there is none."""
        return None if self._port is None else self._port.state

    @property
    def engaged(self) -> bool:
        """Whether the AC has control; False while a safety module drives the robot."""
        return self._port is not None and self._port.engaged


class Robot(Peer):
    """One robot, as the script that runs for it sees and commands it; see `soter.Mission.run`.

    It commands as an AC does: the robot moves by it only while no safety module drives. Every awaited call takes at
    least a tick, waits in fleet time, and may only be made by this robot's own script.

    Attributes:
        id: the robot's id.
        peers: the other robots, by id.
        workspace: fence, boxes, chargers.
        body_radius_m: radius of the robot's body.
        random: a random generator that depends only on the run's seed and the robot.
    """

    def __init__(self, script: RobotScript, robot_id: int, stage: Stage, agent: MachineRef) -> None:
        super().__init__(robot_id, stage.ports.get(robot_id))
        self.peers: Final[Mapping[int, Peer]] = {
            other: Peer(other, port) for other, port in stage.ports.items() if other != robot_id
        }
        self.workspace: Final[Workspace] = stage.workspace
        self.body_radius_m: Final = stage.body_radius_m[robot_id]
        self.random: Final = random.Random(f"mission/{stage.seed}/{robot_id}")
        self._script: Final = script
        self._stage: Final = stage
        self._agent: Final = agent

    def now(self) -> float:
        """Return the fleet time in seconds."""
        return self._script.now()

    async def go_to(self, x_m: float, y_m: float, *, timeout_s: float | None = None, tries: int = TRIES) -> Arrival:
        """Drive to a place, by a path of the mission's planner, and return how that ended.

        While a safety module drives the robot, this waits; then it goes on, unless it was geofence or obstacle.

        Args:
            x_m: the place, east in the workspace's frame.
            y_m: the place, north.
            timeout_s: time with the AC in control after which it is given up; None for `target_timeout_s`.
            tries: number of take-overs and failed paths after which it is given up.

        Raises:
            TypeError: place, time-out or number of tries is no number.
            ValueError: it is not allowed.
        """
        metres = f"a finite number of metres, at most +-{MAX_COORDINATE_M:g}"
        for name, value in (("x_m", x_m), ("y_m", y_m)):
            _refuse_unless(lambda at: abs(at) <= MAX_COORDINATE_M, name, value, metres)
        if timeout_s is not None:
            seconds = f"seconds above 0, at most {LONGEST_S:g}, or None for target_timeout_s"
            _refuse_unless(lambda given: 0.0 < given <= LONGEST_S, "timeout_s", timeout_s, seconds)
        whole = f"a whole number from 1 to {MOST_TRIES}"
        _refuse_unless(lambda given: 1 <= given <= MOST_TRIES and given == int(given), "tries", tries, whole)
        return await self._script.visit(self._agent, (float(x_m), float(y_m)), timeout_s, int(tries))

    async def sleep(self, duration_s: float) -> None:
        """Wait for a time, at least a tick; so long, too, if the time is over already and `duration_s` below 0.

        Raises:
            TypeError: the time is no number.
            ValueError: it is not finite.
        """
        _refuse_unless(is_finite, "duration_s", duration_s, "a finite number of seconds")
        await self._script.sleep(duration_s)

    async def until(self, condition: Callable[[], bool], *, timeout_s: float = math.inf) -> bool:
        """Wait until a condition holds, such as one that another robot's script sets; it is checked at every tick.

        Returns:
            True once it holds; False if the time is up.

        Raises:
            TypeError: the condition is no function, or a coroutine, which would count as true before it has been asked;
                or the time-out is no number.
            ValueError: the time-out is not allowed.
        """
        allowed = "a finite number of seconds, or math.inf for no end"
        _refuse_unless(lambda given: given == math.inf or is_finite(given), "timeout_s", timeout_s, allowed)
        asked: object = condition
        if not callable(asked):
            raise TypeError(
                f"the condition of until is {shown_value(asked)}, allowed: a function, which is asked at every tick; "
                "write `lambda: ` before it"
            )
        end_s = self.now() + timeout_s
        while True:
            holds: object = condition()
            if isinstance(holds, Awaitable):
                if isinstance(holds, Coroutine):
                    holds.close()  # else Python warns that nobody has awaited it
                raise TypeError("the condition of until is a coroutine, allowed: a function that is not async")
            if holds:
                return True
            if not self.now() < end_s:
                return False
            await self._script.sleep(0.0)


def _refuse_unless(fits: Callable[[Any], bool], name: str, given: object, allowed: str) -> None:
    """Refuse an argument that is no number, or none that fits."""
    message = f"{name} is {shown_value(given)}, allowed: {allowed}"
    if not isinstance(given, Real):
        raise TypeError(message)
    if not fits(given):
        raise ValueError(message)


class Wake(Event):
    """A script's own timer."""


@dataclass(frozen=True)
class Script:
    """The payload of a script's machine."""

    run: Callable[[Robot], Coroutine[object, object, None]]
    robot_id: int
    stage: Stage
    target_ids: Iterator[int]
    on_end: Callable[[], None]


def _in_words(failure: BaseException, run: Callable[..., object]) -> str:
    """Return what a script has raised, with its line, and what to await if it has awaited what only others can."""
    file = Path(run.__code__.co_filename) if hasattr(run, "__code__") else None
    if isinstance(failure, ForeignAwait):
        return f"it awaited something of another library, of type {failure.what}{line_in(file, failure)}{_INSTEAD}"
    told = any(each in account_of(failure, str) for each in _OF_ASYNCIO)
    return f"{described(failure, file)}{_INSTEAD if told else ''}"


class RobotScript(Machine):
    """Gives targets to a robot agent as a task planner does; the script runs as its handler."""

    Running: State[Script] = State(start=True)
    Ended: State[None] = State()

    script: Script

    @Running.entry
    async def _run(self, script: Script) -> Next:
        self.script, stage, robot_id = script, script.stage, script.robot_id
        kit = stage.kits[robot_id]
        if not isinstance(kit, RemoteKit):
            kit.subscribe(robot_id, self.ref, ())
        agent = self.create(robot_agent(kit), (kit, self.ref), name=f"RobotAgent {robot_id}")
        # Run the script from the first tick on, since only then a script that never awaits is noticed.
        await self.sleep(0.0)
        try:
            await script.run(Robot(self, robot_id, stage, agent))
        except GeneratorExit:
            raise
        except BaseException as failure:
            if is_interruption(failure):
                raise
            raise ScriptFailed(_in_words(failure, script.run)) from failure
        script.on_end()
        return Goto(self.Ended)

    def _check_own(self) -> None:
        """Refuse to wait in other code than this robot's own script.

        Raises:
            MisuseError: another script, or a coroutine of asyncio's, has this robot's handle.
        """
        try:
            self._running_context("await")
        except MisuseError as failure:
            raise MisuseError(
                f"the handle of robot {self.script.robot_id} was awaited elsewhere; a script may await its own handle "
                "only, which `run` is given, and sees of others what robot.peers says; scripts tell each other by "
                "attributes of the mission"
            ) from failure

    async def visit(
        self, agent: MachineRef, place: tuple[float, float], timeout_s: float | None, tries: int
    ) -> Arrival:
        """Have the robot agent visit a place; see `Robot.go_to`."""
        self._check_own()
        stage, robot_id, target_id = self.script.stage, self.script.robot_id, next(self.script.target_ids)
        began_s = self.now()
        self.send(agent, VisitTarget(target_id, place, timeout_s, tries))
        stage.on_target(robot_id, target_id, place)
        ended = await self.receive(TargetEnded, match=lambda e: e.target_id == target_id)
        stage.on_ended(robot_id, target_id, ended.outcome)
        if self.now() <= began_s:
            await self.sleep(0.0)
        return Arrival(ended.outcome, ended.module, ended.reason)

    async def sleep(self, duration_s: float) -> None:
        """Wait; see `Robot.sleep`."""
        self._check_own()
        self.after(max(duration_s, self.script.stage.tick_s), Wake())
        await self.receive(Wake)
