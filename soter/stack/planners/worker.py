"""The main function of a worker process: builds one planner and answers requests until its parent is gone.

It answers in short JSON messages, so that nothing from a worker is ever unpickled.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import socket
from dataclasses import dataclass
from typing import Any, BinaryIO, Final, NoReturn, TypeVar

import msgspec

from soter.errors import ConfigError, Garbage
from soter.isolation.child import die_with_parent, yield_to_others
from soter.isolation.refused import Refused
from soter.stack.planners.base import MAX_WAYPOINTS, Planner, PlanResult, Point
from soter.stack.planners.names import PlannerSpec, PlannerUnavailable

MAX_REASON = 300
"""Length in characters to which reasons are cut."""

T = TypeVar("T")


def describe(error: BaseException) -> str:
    """Return type and message of an exception in one short line, even if its `__str__` raises."""
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 -- untrusted code wrote that __str__
        text = "no message"
    return " ".join(f"{type(error).__name__}: {text}".split())[:MAX_REASON]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _points(path: Any) -> tuple[Point, ...]:
    if not isinstance(path, tuple | list):
        raise Garbage(f"a path of type {type(path).__name__}")
    if len(path) > MAX_WAYPOINTS:
        raise Garbage(f"{len(path)} waypoints, allowed are {MAX_WAYPOINTS}")
    points: list[Point] = []
    for point in path:
        if not (isinstance(point, tuple | list) and len(point) == 2 and all(map(_is_number, point))):
            raise Garbage("a waypoint that is not a pair of numbers")
        try:
            x, y = float(point[0]), float(point[1])
        except OverflowError:
            raise Garbage("a waypoint with a number too large for a float") from None
        if not (math.isfinite(x) and math.isfinite(y)):
            raise Garbage("a waypoint that is not finite")
        points.append((x, y))
    return tuple(points)


def checked(request_id: int, answer: Any) -> PlanResult:
    """Return a planner's answer as a well-formed result: plain, finite, short, and for that request.

    Raises:
        Garbage: the answer is anything else.
    """
    if not isinstance(answer, PlanResult):
        raise Garbage(f"the planner returned {type(answer).__name__}, not PlanResult")
    if type(answer.request_id) is not int or answer.request_id != request_id:
        raise Garbage("the answer to another request")
    if type(answer.checks) is not int or answer.checks < 0:
        raise Garbage("a number of checks that is not a natural number")
    if answer.reason is not None:
        if not isinstance(answer.reason, str):
            raise Garbage(f"a reason of type {type(answer.reason).__name__}")
        return PlanResult.failed(request_id, answer.reason[:MAX_REASON] or "no reason given", answer.checks)
    path = _points(answer.path)
    if not path:
        raise Garbage("neither a path nor a reason")
    return PlanResult(request_id, path, answer.checks, None, bool(answer.reaches_goal))


def garbage(request_id: int, error: Garbage) -> PlanResult:
    """Return the failed result for a garbage answer."""
    return PlanResult.failed(request_id, f"garbage: {error}")


def decode_start(data: bytes) -> Refused | None:
    """Decode a worker's first message: None if it is ready, else why it cannot start.

    Raises:
        Garbage: it is no such message.
    """
    return _decoded(_start, data)


def decode_result(number: int, request_id: int, data: bytes) -> PlanResult:
    """Decode and check an answer. Floats come through unchanged, bit for bit.

    Raises:
        Garbage: it is not the answer to the worker's job of that number.
    """
    answered, result = _decoded(_answer, data)
    if answered != number:
        raise Garbage("the answer to another job")
    return checked(request_id, result)


_start: Final[msgspec.json.Decoder[Refused | None]] = msgspec.json.Decoder(Refused | None)
_answer: Final = msgspec.json.Decoder(tuple[int, PlanResult])


def _decoded(decoder: msgspec.json.Decoder[T], data: bytes) -> T:
    try:
        return decoder.decode(data)
    except (ValueError, RecursionError) as failure:
        raise Garbage(f"a malformed message: {failure}") from None


MAX_REQUEST_BYTES = 1 << 18


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """The parameters that a worker is started with.

    Attributes:
        planner: the planner, and what it is built for.
        memory_limit_bytes: address space that the planner may use beyond the bare worker's.
        niceness: nice value of the worker, relative to the mission's.
    """

    planner: PlannerSpec
    memory_limit_bytes: int
    niceness: int


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Serve the parent. Never returns, and skips exit handlers: untrusted code may have left some.

    Args:
        stdin: holds a pickled `WorkerSpec`.
        socket_fd: a Unix socket of packets: pickled requests in, JSON answers out.
        lifeline_fd: read end of a pipe that the parent holds open and never writes to.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(lifeline_fd)
    spec: WorkerSpec = pickle.load(stdin)  # noqa: S301 -- from the parent
    channel = socket.socket(fileno=socket_fd)
    yield_to_others(spec.niceness, spec.memory_limit_bytes)
    planner = _build(spec, channel)
    _send(channel, None)
    while data := channel.recv(MAX_REQUEST_BYTES):
        number, request = pickle.loads(data)  # noqa: S301 -- from the parent
        _send(channel, (number, _plan(planner, request)))
    os._exit(0)


def _send(channel: socket.socket, message: Refused | tuple[int, PlanResult] | None) -> None:
    channel.send(msgspec.json.encode(message))


def _build(spec: WorkerSpec, channel: socket.socket) -> Planner:
    try:
        return spec.planner.build()
    except (ConfigError, PlannerUnavailable) as error:
        _send(channel, Refused.of(error))
    except BaseException as error:  # noqa: BLE001 -- untrusted code may raise anything
        refusal = ConfigError(f"it is '{spec.planner.name}', which cannot be made: {describe(error)}", key="planner")
        _send(channel, Refused.of(refusal))
    os._exit(1)


def _plan(planner: Planner, request: Any) -> PlanResult:
    try:
        return checked(request.request_id, planner.plan(request))
    except Garbage as error:
        return garbage(request.request_id, error)
    except BaseException as error:  # noqa: BLE001 -- SystemExit and KeyboardInterrupt are no better
        return PlanResult.failed(request.request_id, f"the planner raised {describe(error)}")
