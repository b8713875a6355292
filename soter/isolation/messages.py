"""The messages between the supervisor's process and the mission's, in MessagePack.

Nothing is unpickled or trusted: messages of the mission are decoded into these types or refused, and texts and lists
have a longest length. Positions in metres, workspace frame; times in seconds.
"""

from __future__ import annotations

from typing import Annotated, Final, Self, TypeVar

import msgspec

from soter.errors import Garbage
from soter.isolation.refused import Refused
from soter.rta import ControlReport, GoalReport, Report
from soter.sdk import Capabilities, RobotState, Waypoint

MAX_TURN_BYTES: Final = 1 << 16
"""The longest message of a mission: room for an `Ask` of every robot, but decoded in a small part of a tick."""

MAX_ANNOUNCED: Final = 16
"""Most waypoints that a mission may announce beyond the requested one."""

MAX_NEWS: Final = 1024
MAX_MOVES: Final = 100
MAX_TEXT: Final = 300

Id = Annotated[int, msgspec.Meta(ge=0, lt=2**62)]
Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


M = TypeVar("M")


class _Message(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    pass


# --- to the mission ----------------------------------------------------------------------------------------


class Reported(_Message, frozen=True):
    """A report of a port: one of the two."""

    goal: GoalReport | None = None
    control: ControlReport | None = None

    @classmethod
    def of(cls, report: Report) -> Self:
        """Return a report as a message."""
        if isinstance(report, GoalReport):
            return cls(goal=report)
        return cls(control=report._replace(module=report.module[:MAX_TEXT], cause=report.cause[:MAX_TEXT]))


class PeerSeen(_Message, frozen=True):
    """The latest state of a robot that another process commands."""

    state: RobotState | None
    engaged: bool


class Footprint(_Message, frozen=True):
    """The room that one robot takes.

    Attributes:
        body_radius_m: radius of its body.
        disc_m: distance that its plans keep from robots that stand in the way.
        arrival_m: distance to a target at which the target counts as reached.
    """

    body_radius_m: float
    disc_m: float
    arrival_m: float


class Begin(_Message, tag="begin", frozen=True):
    """The robots are ready; the first tick is near.

    Attributes:
        fleet_s: fleet time when this message was sent.
        steady_s: the host's steady time at that moment.
        robot_ids: the robots, in the order of every `Tick.states`.
        rooms: the room that each of them takes, in the same order.
        recorded: whether changes of state are recorded.
        peer_ids: the robots that other processes command, in the order of every `Tick.peers`.
        capabilities: the promise of each of the robots.
    """

    fleet_s: float
    steady_s: float
    robot_ids: tuple[int, ...]
    rooms: tuple[Footprint, ...]
    recorded: bool = False
    peer_ids: tuple[int, ...] = ()
    capabilities: tuple[Capabilities, ...] = ()


class Tick(_Message, tag="tick", frozen=True):
    """The state of the ports after a tick.

    Attributes:
        number: counts the ticks that were sent.
        now_s: fleet time of the tick.
        fleet_s: fleet time when this message was sent.
        steady_s: the host's steady time at that moment.
        states: every robot's latest sample.
        reports: the ports' reports since the last tick, oldest first.
        peers: the robots that other processes command.
    """

    number: int
    now_s: float
    fleet_s: float
    steady_s: float
    states: tuple[RobotState | None, ...]
    reports: tuple[Reported, ...]
    peers: tuple[PeerSeen, ...] = ()


# --- from the mission --------------------------------------------------------------------------------------


class Started(_Message, tag="started", frozen=True):
    """The ACs are ready for `Begin`."""


class Begun(_Message, tag="begun", frozen=True):
    """The ACs have begun, which may have taken long: from here on ticks are answered."""


class Ask(_Message, frozen=True):
    """A goto through a robot's port.

    Attributes:
        robot_id: the robot.
        handover: how many hand-overs of that robot the mission had heard of before the request.
        goal_id: the mission's number for the goal.
        target: the goal's place.
        upcoming: the AC's intended waypoints after the target; for statistics only.
    """

    robot_id: Id
    handover: Id
    goal_id: Id
    target: Waypoint
    upcoming: Annotated[tuple[Waypoint, ...], msgspec.Meta(max_length=MAX_ANNOUNCED)] = ()


class TargetGiven(_Message, tag="given", frozen=True):
    """A robot has been given a target."""

    robot_id: Id
    target_id: Id
    x_m: float
    y_m: float


class TargetEndedMessage(_Message, tag="ended", frozen=True):
    """A target has ended, one way or another."""

    robot_id: Id
    target_id: Id
    outcome: Text


class FailedForGood(_Message, frozen=True):
    """A robot's AC has failed for good; with None, a part that all ACs depend on has failed."""

    robot_id: Id | None
    cause: Text


class Moved(_Message, frozen=True):
    """A machine has changed its state, with the fields of `soter.record.messages.TransitionEvent`, for recordings."""

    time_s: float
    machine: Text
    machine_id: Id
    node: Text
    source: Text
    target: Text
    event: Text
    detail: Text


class Turn(_Message, tag="turn", frozen=True):
    """The mission's answer to a tick, and its sign of life.

    Attributes:
        tick: the number of the latest tick that the mission has seen.
        asks: at most one for each robot.
        news: targets given and ended, oldest first.
        failures: new failures.
        incidents: new incidents.
        moves: changes of state, oldest first, if they are recorded; those beyond the limit are left out.
        paths_replaced: how many paths of the planner have not been used so far.
        done: whether the mission has nothing left to do.
    """

    tick: Id
    asks: Annotated[tuple[Ask, ...], msgspec.Meta(max_length=MAX_NEWS)] = ()
    news: Annotated[tuple[TargetGiven | TargetEndedMessage, ...], msgspec.Meta(max_length=MAX_NEWS)] = ()
    failures: Annotated[tuple[FailedForGood, ...], msgspec.Meta(max_length=MAX_NEWS)] = ()
    incidents: Annotated[tuple[Text, ...], msgspec.Meta(max_length=MAX_NEWS)] = ()
    paths_replaced: Id = 0
    moves: Annotated[tuple[Moved, ...], msgspec.Meta(max_length=MAX_MOVES)] = ()
    done: bool = False


class Busy(_Message, tag="busy", frozen=True):
    """The mission has been in one handler for long. Sent while it still can, so that a hang has a name."""

    handler: Text


Down = Begin | Tick
Up = Started | Refused | Begun | Turn | Busy

_encoder: Final = msgspec.msgpack.Encoder()
_up: Final = msgspec.msgpack.Decoder(Up)
_down: Final = msgspec.msgpack.Decoder(Down)


def encode(message: msgspec.Struct) -> bytes:
    """Return a message as bytes for another process."""
    return _encoder.encode(message)


def decode_up(data: bytes) -> Up:
    """Return the message in bytes from the mission's process.

    Raises:
        Garbage: the bytes are no such message.
    """
    message: Up = decoded(_up, data, MAX_TURN_BYTES, "message")
    return message


def decoded(decoder: msgspec.msgpack.Decoder[M], data: bytes, most_bytes: int, what: str) -> M:
    """Return the message in untrusted bytes.

    Args:
        decoder: of the expected type.
        data: the bytes.
        most_bytes: the longest message; longer ones are not decoded.
        what: a word for the expected message.

    Raises:
        Garbage: the bytes are no such message.
    """
    if len(data) > most_bytes:
        raise Garbage(f"a {what} of more than {most_bytes} bytes")
    try:
        return decoder.decode(data)
    except Exception as failure:  # noqa: BLE001 - msgspec also raises others' errors: texts that are no UTF-8
        raise Garbage(" ".join(str(failure).split())[:MAX_TEXT]) from None


def decode_down(data: bytes) -> Down:
    """Return the message in bytes from the supervisor's process."""
    message: Down = _down.decode(data)
    return message
