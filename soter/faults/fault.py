"""What a fault is: something between SOTER and one robot that spoils commands, samples, or the vehicle itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import ClassVar, Final, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

from soter.faults.options import FaultOptions
from soter.sdk import Capabilities, Controller, Goal, RobotState, Waypoint

O = TypeVar("O", bound=FaultOptions)  # noqa: E741 - the options of one kind


class Call(Enum):
    """What a command asks of the robot."""

    GOTO = "goto"
    HALT = "halt"
    SWITCH = "switch"
    RENEW = "renew"


@dataclass(frozen=True, slots=True)
class Command:
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

    command: Command
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

    Args:
        options: its table.
        context: the rest.

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

    def command(self, time_s: float, command: Command) -> Sequence[Passage]:
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
