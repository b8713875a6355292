"""What crosses between the supervisor's process and the mission's, in MessagePack.

Nothing is unpickled and nothing is believed: what comes from the mission is decoded into these types or refused, and
texts and lists have a longest length. Positions in metres, workspace frame; times in seconds.
"""

from __future__ import annotations

from typing import Annotated, Final, Self, TypeVar

import msgspec

from soter.errors import Garbage
from soter.isolation.refused import Refused
from soter.rta import ControlReport, GoalReport, Report
from soter.sdk import Capabilities, RobotState, Waypoint

MAX_TURN_BYTES: Final = 1 << 16
"""The longest message of a mission: room for an `Ask` of every robot, but not for one of them to keep a tick busy."""

MAX_ANNOUNCED: Final = 16
"""Waypoints that a mission may announce beyond the one it asks for."""

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
    """What a port has reported: one of the two."""

    goal: GoalReport | None = None
    control: ControlReport | None = None

    @classmethod
    def of(cls, report: Report) -> Self:
        """Return a report as it crosses."""
        if isinstance(report, GoalReport):
            return cls(goal=report)
        return cls(control=report._replace(module=report.module[:MAX_TEXT], cause=report.cause[:MAX_TEXT]))


class PeerSeen(_Message, frozen=True):
    """A robot that another process commands, as it was heard last."""

    state: RobotState | None
    engaged: bool


class Footprint(_Message, frozen=True):
    """The room that one robot takes.

    Attributes:
        body_radius_m: of its body.
        disc_m: distance that its plans keep from robots that stand in the way.
        arrival_m: how near to a target is reached.
    """

    body_radius_m: float
    disc_m: float
    arrival_m: float


class Begin(_Message, tag="begin", frozen=True):
    """The robots are ready; the first tick is near.

    Attributes:
        fleet_s: fleet time,
        steady_s: at this moment of the host's steady clock.
        robot_ids: which robots, in the order of every `Tick.states`.
        rooms: what room each of them takes, in the same order.
        recorded: whether changes of state are of interest.
        peer_ids: the robots that other processes command, in the order of every `Tick.peers`.
        capabilities: what each of the robots promises.
    """

    fleet_s: float
    steady_s: float
    robot_ids: tuple[int, ...]
    rooms: tuple[Footprint, ...]
    recorded: bool = False
    peer_ids: tuple[int, ...] = ()
    capabilities: tuple[Capabilities, ...] = ()


class Tick(_Message, tag="tick", frozen=True):
    """What the ports show after a tick.

    Attributes:
        number: counts the ticks that were sent.
        now_s: fleet time of the tick.
        fleet_s: fleet time when this was sent,
        steady_s: which was this moment of the host's steady clock.
        states: every robot's latest sample.
        reports: what the ports have reported since the last one, oldest first.
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
    """The ACs are there; `Begin` may come."""


class Ask(_Message, frozen=True):
    """A goto through a robot's port.

    Attributes:
        robot_id: which robot.
        handover: how many hand-overs of that robot the mission had heard of when it asked.
        goal_id: the mission's number for it.
        target: where to.
        upcoming: what the AC intends after it; for statistics only.
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
    """Something has failed for good: a robot's AC, or with None what all of them depend on."""

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
    """What the mission did about a tick; the mission's sign of life.

    Attributes:
        tick: the number of the tick that it has seen last.
        asks: at most one for a robot.
        news: targets given and ended, oldest first.
        failures: of now.
        incidents: new ones.
        moves: changes of state, oldest first, where they are recorded; those beyond the limit are left out.
        paths_replaced: how many paths of the planner were not used up to now.
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
    """The mission has been in one handler for long. It says so while it can, so that a hang has a name."""

    handler: Text


Down = Begin | Tick
Up = Started | Refused | Turn | Busy

_encoder: Final = msgspec.msgpack.Encoder()
_up: Final = msgspec.msgpack.Decoder(Up)
_down: Final = msgspec.msgpack.Decoder(Down)


def encode(message: msgspec.Struct) -> bytes:
    """Encode what another process decodes."""
    return _encoder.encode(message)


def decode_up(data: bytes) -> Up:
    """Decode a message of the mission's process.

    Raises:
        Garbage: it is none.
    """
    message: Up = decoded(_up, data, MAX_TURN_BYTES, "message")
    return message


def decoded(decoder: msgspec.msgpack.Decoder[M], data: bytes, most_bytes: int, what: str) -> M:
    """Decode what nobody vouches for.

    Args:
        decoder: of what was agreed.
        data: what came.
        most_bytes: what is longer is not looked at.
        what: what it should be, in a word.

    Raises:
        Garbage: it is not what was agreed.
    """
    if len(data) > most_bytes:
        raise Garbage(f"a {what} of more than {most_bytes} bytes")
    try:
        return decoder.decode(data)
    except Exception as failure:  # noqa: BLE001 - not all that msgspec raises is its own: texts that are no UTF-8
        raise Garbage(" ".join(str(failure).split())[:MAX_TEXT]) from None


def decode_down(data: bytes) -> Down:
    """Decode a message of the supervisor's process."""
    message: Down = _down.decode(data)
    return message
