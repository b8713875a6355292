"""What a fault is: something between SOTER and one robot that spoils commands, samples, or the vehicle itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import Annotated, ClassVar, Final, Generic, Literal, NamedTuple, Protocol, Self, TypeVar, runtime_checkable

from pydantic import Field, model_validator

from soter.config.table import Table, wrong
from soter.geometry.workspace import MAX_ROBOT_ID
from soter.sdk import Capabilities, Controller, Goal, RobotState, Waypoint

Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
Interval = Annotated[float, Field(ge=0.001, le=1e7, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]

ROUNDING_S: Final = 1e-9


class FaultOptions(Table):
    """The part of a `[[fault]]` table that all kinds share; each kind's own model adds its parameters.

    Attributes:
        kind: a built-in kind, or a class as `module:Class`.
        robot: which robot suffers it: its id, or "all".
        start_s: when it begins, in seconds after the robot is ready.
        duration_s: how long it lasts; to the end of the run if it is not given.
        every_s: it comes again so long after it began; once only if it is not given.
        declared: the robot's promises are widened by what is injected, so that the safety modules pay for it. A fault
            that is not declared breaks the promises: the stack is not told.
    """

    kind: str
    robot: Literal["all"] | Annotated[int, Field(ge=1, le=MAX_ROBOT_ID)] = "all"
    start_s: Seconds = 0.0
    duration_s: Interval | None = None
    every_s: Interval | None = None
    declared: bool = True

    @model_validator(mode="after")
    def _repeats_after_its_end(self) -> Self:
        if self.every_s is not None and (self.duration_s is None or self.duration_s >= self.every_s):
            least = (
                "a fault with a duration_s" if self.duration_s is None else f"above duration_s, {self.duration_s:.12g}"
            )
            raise wrong(("every_s",), self.every_s, least)
        return self

    @property
    def pause_s(self) -> float:
        """How long it is off between two times that it is on; 0 without an end, infinite if it does not come again."""
        if self.duration_s is None:
            return 0.0
        return math.inf if self.every_s is None else self.every_s - self.duration_s

    def active(self, time_s: float) -> bool:
        """Return whether the fault is on, so many seconds after the robot was ready."""
        since_s = time_s - self.start_s + ROUNDING_S
        if since_s < 0.0:
            return False
        if self.duration_s is None:
            return True
        if self.every_s is not None:
            since_s %= self.every_s
        return since_s < self.duration_s

    def window(self, time_s: float) -> int | None:
        """Return how often the fault has come again so many seconds after the robot was ready; None while it is off."""
        if not self.active(time_s):
            return None
        return 0 if self.every_s is None else int((time_s - self.start_s + ROUNDING_S) // self.every_s)

    def end_s(self, time_s: float) -> float:
        """Return when the fault ends that is on so many seconds after the robot was ready; infinite if it does not."""
        if self.duration_s is None:
            return math.inf
        since_s = time_s - self.start_s + ROUNDING_S
        if self.every_s is not None:
            since_s %= self.every_s
        return time_s + self.duration_s - since_s


O = TypeVar("O", bound=FaultOptions)  # noqa: E741 - the options of one kind


class Call(Enum):
    """What a command asks of the robot."""

    GOTO = "goto"
    HALT = "halt"
    SWITCH = "switch"
    RENEW = "renew"


@dataclass(frozen=True, slots=True)
class SentCommand:
    """One command on its way to the robot.

    Attributes:
        call: what is asked.
        goal: the goal to go to, or None.
        target: where the goal is, as it will arrive; None without a goal.
        to: the controller to put in charge, or None.
    """

    call: Call
    goal: Goal | None = None
    target: Waypoint | None = None
    to: Controller | None = None


class Passage(NamedTuple):
    """How a command gets through: once, later, or more than once; a command that is lost has no passage.

    Attributes:
        command: the command as it arrives.
        delay_s: how much later it arrives.
        overtakes: it arrives at its time even if what was sent before it has not; else the order is kept.
    """

    command: SentCommand
    delay_s: float = 0.0
    overtakes: bool = False


class Impairment(NamedTuple):
    """What is wrong with a vehicle. The best value of each field is its default.

    Attributes:
        left: part of the left wheel's motion that reaches the ground, from 0 to 1.
        right: the same of the right wheel.
        brake: part of the deceleration that the brakes still have, from 0 to 1.
        alive: False: motors off, nothing answers, and nothing is remembered afterwards.
    """

    left: float = 1.0
    right: float = 1.0
    brake: float = 1.0
    alive: bool = True

    def joined(self, other: Impairment) -> Impairment:
        """Return both at once."""
        return Impairment(
            self.left * other.left, self.right * other.right, min(self.brake, other.brake), self.alive and other.alive
        )


@runtime_checkable
class Impairable(Protocol):
    """A robot whose vehicle can be impaired; an optional hook that simulated robots in this process offer."""

    def impair(self, left: float, right: float, brake: float, alive: bool) -> None:
        """Impair the vehicle from now on; see `Impairment`. Ones and True make it whole again."""


class Spacing(NamedTuple):
    """What a fault does to how often new samples come, in readings of the state.

    New samples that come at most g readings apart come at most (dropped + 1) g + held apart behind the fault. The age
    that `dropped` costs is paid for in `Fault.widened` for g = 1, and once more for every reading that g is above that.

    Attributes:
        dropped: how many new samples in a row never come through.
        held: how many readings longer one may take to come through than another.
    """

    dropped: int = 0
    held: int = 0


@dataclass(frozen=True, slots=True)
class Context:
    """What a fault knows besides its table.

    Attributes:
        robot_id: the robot that suffers it.
        tick_s: how often samples are read.
        random: its own source of random numbers; the same mission gives the same faults.
    """

    robot_id: int
    tick_s: float
    random: Random


class Fault(Generic[O]):
    """One fault of one robot. A kind overrides what it spoils; what it leaves alone passes.

    Times are seconds after the robot was ready. Everything is called in the supervisor's thread.

    Attributes:
        affected: commands and samples that it has spoilt so far, or times that it has impaired the vehicle.
    """

    options_model: ClassVar[type[FaultOptions]]
    needs_vehicle: ClassVar[bool] = False
    """Whether the robot must be `Impairable`."""

    def __init__(self, options: O, context: Context) -> None:
        self.options: Final = options
        self.context: Final = context
        self.affected = 0

    def widened(self, capabilities: Capabilities) -> Capabilities:
        """Return what the robot can still promise while this fault may be on, if a new sample comes at every reading.

        Where new samples come more rarely, `spacing` says what that costs on top.
        """
        return capabilities

    def spacing(self) -> Spacing:
        """Return what this fault does to how often new samples come."""
        return Spacing()

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        """Return how a command gets through that is sent while the fault is on."""
        return (Passage(command),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        """Return the sample that is seen in place of the robot's latest, None for none.

        It is called at every reading of the state, also while the fault is off: some remember what they have seen.
        """
        return sample

    def impairment(self) -> Impairment | None:
        """Return what is wrong with the vehicle while the fault is on; None for nothing."""
        return None

    def ticks(self, duration_s: float) -> int:
        """Return how many readings of the state a duration takes: what is late is seen at the next of them."""
        return max(0, math.ceil((duration_s - 1e-9) / self.context.tick_s))

    def up_to_ticks(self, duration_s: float) -> float:
        """Return a duration rounded up to whole readings of the state."""
        return self.ticks(duration_s) * self.context.tick_s
