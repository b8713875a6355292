"""The frames from a run to the process that writes its recording: MessagePack, each with its length in front.

They are arrays without names, since every tick of a run is sent, which costs the run's time.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from numbers import Integral, Real
from typing import Any, Final

import msgspec
from msgspec import Raw, Struct

from soter.geometry.site import SitePlan
from soter.geometry.workspace import Workspace
from soter.record.content import RecordedWay
from soter.record.messages import Event
from soter.sdk import RobotState

_LENGTH: Final = struct.Struct("<I")


class RobotRow(Struct, array_like=True, gc=False):
    """One robot at one tick; see also `messages.RobotTick`.

    Attributes:
        state: the robot's sample.
        driver: index of the module that drives, or -1 for the AC.
        in_sc: whether the SC is active.
        modules_in_sc: bit i is set while module i is in SC.
        numbers: margin and reach bound of every module, in their order.
        refused: calls that failed, and the errors.
    """

    state: RobotState
    driver: int
    in_sc: bool
    modules_in_sc: int
    numbers: list[float]
    unread: bool = False
    no_state: str = ""
    refused: tuple[tuple[str, str], ...] = ()
    ac_drove: bool = False
    ac_failure: str = ""


class FirstFrame(Struct, array_like=True, tag=0):
    """The first frame.

    Attributes:
        about: `About` as JSON.
        files: attachments by name.
        workspace: the workspace for the scene, if it is a rectangle.
        site: the workspace for the scene, if it is made of polygons.
        radii_m: body radii, by robot id.
        robots: robot ids, in the order of the rows.
        modules: names of the modules, by robot id.
    """

    about: bytes
    files: dict[str, bytes]
    workspace: Workspace | None
    site: SitePlan | None
    radii_m: dict[int, float]
    robots: list[int]
    modules: dict[int, list[str]]


class TickFrame(Struct, array_like=True, gc=False):
    """One tick.

    Attributes:
        time_s: fleet time.
        host_ns: the host's time of day.
        rows: the robots, in their order.
        events: the events since the tick before: index into `messages.EVENTS`, or `WAY`, and the message.
    """

    tick: int
    time_s: float
    host_ns: int
    rows: list[RobotRow]
    events: list[tuple[int, Raw]]


class Ticks(Struct, array_like=True, tag=1, gc=False):
    """Some ticks, one after the other."""

    ticks: list[TickFrame]


class Finish(Struct, array_like=True, tag=2):
    """The last frame.

    Attributes:
        time_s: fleet time.
        result: the result as JSON; empty if the run did not come to an end.
        events: the events since the last tick, in the same form.
    """

    time_s: float
    result: bytes
    events: list[tuple[int, Raw]]


Frame = FirstFrame | Ticks | Finish

WAY: Final = -1
"""Index of a `RecordedWay` among the events."""

PendingEvent = tuple[int, Event | RecordedWay]
"""An event that is not encoded yet; it is encoded with its frame."""


class Task(Struct):
    """How to write a recording.

    Attributes:
        nice: whether the run does not wait for the writer, which must not slow it.
        part: the file that is written.
        target: the file to replace with it when it is complete; None if there is none.
        sign: the private key to sign it with; None to leave it unsigned.
    """

    nice: bool
    part: str
    target: str | None = None
    sign: str | None = None


class WriterOutcome(Struct):
    """The result of writing; `failure` says why the recording is not complete."""

    failure: str = ""
    size_bytes: int = 0


_MOST: Final = (1 << 63) - 1


def _as_plain(value: object) -> object:
    """Return a value of a foreign type as a plain one: adapters may use numpy's numbers."""
    if isinstance(value, Integral):
        return int(value)
    return float(value) if isinstance(value, Real) else repr(value)


_encode: Final = msgspec.msgpack.Encoder(enc_hook=_as_plain).encode
_decode: Final = msgspec.msgpack.Decoder(Frame).decode


def packed(frame: Any) -> bytes:
    """Return a frame as bytes, whatever values it holds: some of them come from untrusted code."""
    try:
        data = _encode(frame)
    except (UnicodeEncodeError, OverflowError):
        data = _encode(tamed(frame))
    return _LENGTH.pack(len(data)) + data


def tamed(value: Any) -> Any:
    """Return a copy with texts that are valid and integers that are not too long."""
    if isinstance(value, Struct):
        return type(value)(*(tamed(getattr(value, name)) for name in value.__struct_fields__))
    if isinstance(value, str):
        return value.encode(errors="backslashreplace").decode()
    if type(value) is int:
        return max(-_MOST, min(value, _MOST))
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(tamed, value))
    if isinstance(value, list | tuple):
        return type(value)(map(tamed, value))
    if isinstance(value, dict):
        return {tamed(key): tamed(each) for key, each in value.items()}
    return value


class FrameReader:
    """Puts frames together that arrive in pieces."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def take(self, data: bytes) -> Iterator[Frame]:
        """Add received data; yield every complete frame."""
        buffer = self._buffer
        buffer += data
        at, end = 0, len(buffer)
        while end - at >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(buffer, at)
            if end - at - _LENGTH.size < length:
                break
            at += _LENGTH.size
            yield _decode(memoryview(buffer)[at : at + length].tobytes())
            at += length
        del buffer[:at]
