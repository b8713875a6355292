"""What a recording holds: one class a schema, the schema's name, and what every field means.

The JSON schemas inside of a recording, and the tables of its documentation, are made from these classes.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, get_args

from msgspec import UNSET, Meta, Struct, UnsetType

from soter.sdk import Controller

VERSION: Final = 1
"""Of the messages; a reader refuses recordings of a newer one."""

AC: Final = Controller.AC.value
SC: Final = Controller.SC.value

FleetTime = Annotated[float, Meta(description="Fleet time in seconds, exact.")]
# Whole numbers that a float holds exactly, as other readers of JSON need it.
Whole = Annotated[int, Meta(ge=-(2**53), le=2**53)]
RobotId = Annotated[Whole, Meta(description="Number of the robot.")]


class Message(Struct, omit_defaults=True):
    """What all of them share: a field that has its default is left out of the JSON."""


class StateMessage(Message):
    """The sample that a supervisor has of its robot: workspace frame, ENU, metres, radians."""

    stamp_s: Annotated[float, Meta(description="Fleet time at which the vehicle was in this state.")]
    x_m: Annotated[float, Meta(description="East.")]
    y_m: Annotated[float, Meta(description="North.")]
    z_m: Annotated[float, Meta(description="Up.")]
    heading_rad: Annotated[float, Meta(description="Heading, counter-clockwise from east.")]
    vx_m_s: Annotated[float, Meta(description="Velocity, east.")]
    vy_m_s: Annotated[float, Meta(description="Velocity, north.")]
    yaw_rate_rad_s: Annotated[float, Meta(description="Turn rate, counter-clockwise.")]
    link: Annotated[str, Meta(description="UP, STALE or DOWN.")]
    vehicle_stamp_s: Annotated[
        float | UnsetType, Meta(description="The same moment on the vehicle's own clock; absent where it has none.")
    ] = UNSET
    battery: Annotated[float | UnsetType, Meta(description="Charge from 0 to 1; absent where unknown.")] = UNSET
    controller: Annotated[str, Meta(description="AC or SC, as the robot reports it; absent where it does not.")] = ""
    goal_id: Annotated[Whole | UnsetType, Meta(description="The goal that it works on; absent without one.")] = UNSET
    vz_m_s: Annotated[float | UnsetType, Meta(description="Velocity, up; absent where it is not reported.")] = UNSET


NotFinite = Annotated[str, Meta(pattern="^(|inf|-inf|nan)$")]


class ModuleTick(Message):
    """One decision module after a tick. Margin and reach bound are those of its last look."""

    name: Annotated[str, Meta(description="Name of the module.")]
    mode: Annotated[str, Meta(description="AC or SC.")]
    margin: Annotated[
        float | UnsetType, Meta(description="Signed distance to the edge of phi_safe, in the module's unit; absent if "
                                            "it is no finite number.")
    ] = UNSET  # fmt: skip
    reach: Annotated[
        float | UnsetType, Meta(description="Reach bound that the margin was compared with; absent if not finite.")
    ] = UNSET
    margin_is: Annotated[NotFinite, Meta(description="inf, -inf or nan, where the margin is that.")] = ""
    reach_is: Annotated[NotFinite, Meta(description="The same for the reach bound.")] = ""

    @classmethod
    def of(cls, name: str, mode: str, margin: float, reach: float) -> ModuleTick:
        """Return it for any numbers: JSON has none that are not finite."""
        if math.isfinite(margin) and math.isfinite(reach):
            return cls(name, mode, margin, reach)
        margin_set, margin_is = _told(margin)
        reach_set, reach_is = _told(reach)
        return cls(name, mode, margin_set, reach_set, margin_is, reach_is)

    @property
    def margin_value(self) -> float:
        """The margin, whatever number it is."""
        return float(self.margin_is or "nan") if self.margin is UNSET else self.margin

    @property
    def reach_value(self) -> float:
        """The reach bound, whatever number it is."""
        return float(self.reach_is or "nan") if self.reach is UNSET else self.reach


def _told(value: float) -> tuple[float | UnsetType, str]:
    return (value, "") if math.isfinite(value) else (UNSET, str(value))


class Refusal(Message):
    """A call of a robot's interface that failed."""

    call: Annotated[str, Meta(description="drive, hand_over, insist or renew.")]
    failure: Annotated[str, Meta(description="The exception.")]


class RobotTick(Message):
    """All that a robot's decision modules knew and decided at one tick; a replay needs nothing else."""

    tick: Annotated[Whole, Meta(description="Number of the tick, from 0.")]
    time_s: FleetTime
    robot_id: RobotId
    mode: Annotated[str, Meta(description="Who has control: AC or SC.")]
    driver: Annotated[str, Meta(description="Who drives: AC, or the module whose safe controller does.")]
    state: Annotated[StateMessage, Meta(description="What it knew.")]
    modules: Annotated[tuple[ModuleTick, ...], Meta(description="The decision modules, in their order.")] = ()
    unread: Annotated[bool, Meta(description="There was no sample at this tick; `state` is the one before.")] = False
    no_state: Annotated[str, Meta(description="Why there was none.")] = ""
    refused: Annotated[tuple[Refusal, ...], Meta(description="Calls to the robot that failed at this tick.")] = ()
    ac_drove: Annotated[bool, Meta(description="Whether the AC's port passed on a command at this tick.")] = False
    ac_failure: Annotated[str, Meta(description="Why the AC will never get control again.")] = ""
    check: Annotated[str, Meta(description="Checksum of this record, see soter.record.check.")] = ""


class RobotEvent(Message):
    """What all events of one robot share."""

    time_s: FleetTime
    robot_id: RobotId


class HeardMessage(Message):
    """What another process is known to have heard of one of this process's robots."""

    robot_id: RobotId
    stamp_s: Annotated[float, Meta(description="Fleet time of the latest sample of it that was heard.")]


class PeerEvent(RobotEvent):
    """A robot that another process supervises, as it was known at a tick. There is one a tick for each of them."""

    state: Annotated[
        StateMessage | UnsetType,
        Meta(description="Its latest sample; its stamp is the earliest that it can be of. Absent before the first."),
    ] = UNSET
    heard: Annotated[tuple[HeardMessage, ...], Meta(description="What its process is known to have heard.")] = ()
    needs_charge: Annotated[bool, Meta(description="Whether it is on its way to charge, and low.")] = False
    assumption: Annotated[str, Meta(description="Number of the assumption that it was seen to break.")] = ""
    cause: Annotated[str, Meta(description="How, in words.")] = ""
    check: Annotated[str, Meta(description="Checksum of this record, see soter.record.check.")] = ""


class GoalEvent(RobotEvent):
    """A goal was sent to a robot, or ended. That one was superseded is not recorded: the next goal says it."""

    goal_id: Annotated[Whole, Meta(description="Number of the goal, unique for its robot.")]
    by: Annotated[str, Meta(description="AC or SC.")]
    status: Annotated[str, Meta(description="active when it was sent, then how it ended.")]
    x_m: Annotated[float, Meta(description="East.")]
    y_m: Annotated[float, Meta(description="North.")]
    z_m: Annotated[float, Meta(description="Up.")]
    heading_rad: Annotated[float | UnsetType, Meta(description="Heading to arrive with; absent for any.")] = UNSET
    speed_m_s: Annotated[float | UnsetType, Meta(description="Cap on the speed; absent for none.")] = UNSET
    reason: Annotated[str, Meta(description="Why it ended so.")] = ""


class SwitchEvent(RobotEvent):
    """A robot changed hands, or the module that drives it changed."""

    before: Annotated[str, Meta(description="Who drove: AC or a module.")]
    after: Annotated[str, Meta(description="Who drives now: AC or a module.")]
    module: Annotated[str, Meta(description="The module that caused it, or supervisor.")]
    cause: Annotated[str, Meta(description="Why, in words; empty when control goes back to the AC.")]
    joined: Annotated[tuple[str, ...], Meta(description="Further modules that fired at the same tick.")] = ()


class TargetEvent(RobotEvent):
    """A robot was given a target, or is done with it."""

    target_id: Annotated[Whole, Meta(description="Number of the target.")]
    x_m: Annotated[float | UnsetType, Meta(description="East; absent when it has ended.")] = UNSET
    y_m: Annotated[float | UnsetType, Meta(description="North; absent when it has ended.")] = UNSET
    outcome: Annotated[str, Meta(description="reached, unsafe, blocked or timed_out; absent when it begins.")] = ""


class TransitionEvent(Message):
    """A machine of the mission changed its state."""

    time_s: FleetTime
    machine: Annotated[str, Meta(description="Name of the machine.")]
    machine_id: Annotated[Whole, Meta(description="Number of the machine in its runtime.")]
    node: Annotated[str, Meta(description="Name of the runtime.")]
    source: Annotated[str, Meta(description="State that was left; absent when it starts.")] = ""
    target: Annotated[str, Meta(description="State that was entered; absent when it stops.")] = ""
    event: Annotated[str, Meta(description="Class of the event that led to it; absent at the start.")] = ""
    detail: Annotated[str, Meta(description="The event, cut after 200 characters.")] = ""


class FaultEvent(RobotEvent):
    """An injected fault has spoilt something since the record before."""

    kind: Annotated[str, Meta(description="Kind of the fault.")]
    declared: Annotated[bool, Meta(description="Whether the robot's promises were widened by it.")]
    affected: Annotated[
        Whole, Meta(description="Commands and samples spoilt, or times the vehicle was impaired, so far.")
    ]


class ViolationEvent(Message):
    """Ground truth saw a rule broken, or kept again. Looked at every second, and at the end."""

    time_s: FleetTime
    rule: Annotated[str, Meta(description="battery, geofence, collision, obstacle, or a module of the user's.")]
    robots: Annotated[tuple[Whole, ...], Meta(description="The robot, or the pair.")]
    start_s: Annotated[float, Meta(description="Fleet time at which it began.")]
    end_s: Annotated[float | UnsetType, Meta(description="Fleet time at which it ended; absent while it goes on.")] = (
        UNSET
    )


class WorstMessage(Message):
    """The look at which an assumption failed by the most, of all excesses in one unit."""

    excess: Annotated[float, Meta(description="By how much what was seen was more than is assumed.")]
    unit: Annotated[str, Meta(description="Of that.")]
    time_s: FleetTime
    cause: Annotated[str, Meta(description="What was seen then.")]


class BreachEvent(RobotEvent):
    """Looks at which an assumption failed, at most 2 s apart; told again, a second later, while there are more."""

    assumption: Annotated[str, Meta(description="Its number, such as A14; see docs/assurance.md.")]
    start_s: Annotated[float, Meta(description="Fleet time of the first look.")]
    last_s: Annotated[float, Meta(description="Fleet time of the last one up to now.")]
    times: Annotated[int, Meta(description="How many there were up to now.")]
    cause: Annotated[str, Meta(description="What was seen at the first.")]
    worst: Annotated[
        tuple[WorstMessage, ...],
        Meta(description="The worst of them, for each unit; empty where none can be measured."),
    ] = ()


class StallEvent(RobotEvent):
    """A robot has been without its AC for 300 s, and was not charging; or that has ended."""

    start_s: Annotated[float, Meta(description="Fleet time since when it is without its AC.")]
    module: Annotated[str, Meta(description="The module whose safe controller has it.")]
    cause: Annotated[str, Meta(description="Why.")]
    end_s: Annotated[float | UnsetType, Meta(description="Fleet time at which it ended; absent while it goes on.")] = (
        UNSET
    )


class DropEvent(Message):
    """Ticks are missing: on a wall clock the run does not wait for its writer."""

    time_s: FleetTime
    first_tick: Annotated[Whole, Meta(description="The first that is missing.")]
    ticks: Annotated[Whole, Meta(description="How many are missing.")]


Event = (
    GoalEvent
    | SwitchEvent
    | TargetEvent
    | TransitionEvent
    | FaultEvent
    | ViolationEvent
    | DropEvent
    | PeerEvent
    | BreachEvent
    | StallEvent
)

EVENTS: Final[tuple[type[Event], ...]] = get_args(Event)
"""Everything but ticks; what crosses to the writer is numbered by it."""

TOPICS: Final[dict[type[Message], str]] = {
    RobotTick: "/robots/{robot_id}/tick",
    GoalEvent: "/robots/{robot_id}/goal",
    SwitchEvent: "/switches",
    TargetEvent: "/targets",
    TransitionEvent: "/machines",
    FaultEvent: "/faults",
    ViolationEvent: "/violations",
    DropEvent: "/drops",
    PeerEvent: "/peers",
    BreachEvent: "/breaches",
    StallEvent: "/stalls",
}
"""Where each of them is recorded."""


def kind_name(message: type[Struct]) -> str:
    """Return the name of a kind of message as files have it, such as `Goal`."""
    return message.__name__.removesuffix("Event").removesuffix("Message")


def schema_name(message: type[Struct]) -> str:
    """Return the name of a message's schema; of those that are not SOTER's own, the one by which Foxglove knows it."""
    return f"soter.{kind_name(message)}" if issubclass(message, Message) else f"foxglove.{message.__name__}"
