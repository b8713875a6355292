"""The main function of a worker process: builds one planner and answers requests until its parent is gone.

What it may say are short JSON messages, so that nothing of a worker's is ever unpickled.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import signal
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal, NoReturn

from soter.errors import ConfigError
from soter.geometry.workspace import Workspace
from soter.isolation.child import die_with_parent, yield_to_others
from soter.stack.planners.base import MAX_WAYPOINTS, Planner, PlanResult, Point
from soter.stack.planners.names import PlannerUnavailable, build_planner

MAX_REASON = 300
"""Longest reason that is passed on, in characters."""

MAX_TEXT = 10_000
"""Longest message of an error that keeps a worker from starting, in characters."""

StartKind = Literal["ready", "config", "unavailable"]


class Garbage(ValueError):
    """What came from a planner or its worker is not what was agreed."""


def describe(error: BaseException) -> str:
    """Return type and message of an exception in one short line, even if its message cannot be had."""
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
            raise Garbage("a waypoint beyond all numbers") from None
        if not (math.isfinite(x) and math.isfinite(y)):
            raise Garbage("a waypoint that is not finite")
        points.append((x, y))
    return tuple(points)


def checked(request_id: int, answer: Any) -> PlanResult:
    """Return a planner's answer as a result that can be relied on in form: plain, finite, short, and to that request.

    Raises:
        Garbage: it is anything else.
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
    """Return the failed result that stands for garbage."""
    return PlanResult.failed(request_id, f"garbage: {error}")


@dataclass(frozen=True, slots=True)
class StartMessage:
    """A worker's first message: it is ready, or why it never will be.

    Attributes:
        kind: whether it is ready, else which kind of error it is.
        message: the error's message.
        source: where a ConfigError is: the file,
        line: the line in it,
        key: and the key.
    """

    kind: StartKind
    message: str = ""
    source: str | None = None
    line: int | None = None
    key: str | None = None


def encode_start(start: StartMessage) -> bytes:
    """Encode a worker's first message."""
    return json.dumps([start.kind, start.message[:MAX_TEXT], start.source, start.line, start.key]).encode()


def decode_start(data: bytes) -> StartMessage:
    """Decode a worker's first message.

    Raises:
        Garbage: it is none.
    """
    match _loads(data):
        case [
            "ready" | "config" | "unavailable" as kind,
            str() as message,
            None | str() as source,
            None | int() as line,
            None | str() as key,
        ]:
            return StartMessage(kind, message, source, line, key)
    raise Garbage("a first message of another kind")


def encode_result(number: int, result: PlanResult) -> bytes:
    """Encode a checked result, as the answer to the worker's job of that number."""
    fields = [number, result.request_id, result.path, result.checks, result.reason, result.reaches_goal]
    return json.dumps(fields).encode()


def decode_result(number: int, request_id: int, data: bytes) -> PlanResult:
    """Decode and check an answer. Floats come through unchanged, bit for bit.

    Raises:
        Garbage: it is not the answer to that job.
    """
    match _loads(data):
        case [int() as got, int() as answered, list() as path, checks, reason, bool() as reaches] if got == number:
            return checked(request_id, PlanResult(answered, _points(path), checks, reason, reaches))
    raise Garbage("a message that is not the answer expected")


def _loads(data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        raise Garbage("a message that is not JSON") from None


MAX_REQUEST_BYTES = 1 << 18


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """What a worker is told when it starts.

    Attributes:
        planner: name of the planner.
        workspace: the known fence and boxes.
        body_radius_m: radius of the robots' round bodies, by id where they differ.
        options: the raw table of the planner.
        source: the mission file that the options are from, or None.
        memory_limit_bytes: address space that the planner may add to what the bare worker has.
        niceness: how much less than the mission the worker is favoured by the scheduler.
    """

    planner: str
    workspace: Workspace
    body_radius_m: float | Mapping[int, float]
    options: Mapping[str, Any]
    source: str | None
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
    channel.send(encode_start(StartMessage("ready")))
    while data := channel.recv(MAX_REQUEST_BYTES):
        number, request = pickle.loads(data)  # noqa: S301 -- from the parent
        channel.send(encode_result(number, _plan(planner, request)))
    os._exit(0)


def _build(spec: WorkerSpec, channel: socket.socket) -> Planner:
    try:
        return build_planner(spec.planner, spec.workspace, spec.body_radius_m, spec.options, spec.source)
    except ConfigError as error:
        channel.send(encode_start(StartMessage("config", str(error), error.source, error.line, error.key)))
    except PlannerUnavailable as error:
        channel.send(encode_start(StartMessage("unavailable", str(error))))
    except BaseException as error:  # noqa: BLE001 -- untrusted code may raise anything
        message = f"planner '{spec.planner}' cannot be built ({describe(error)})"
        channel.send(encode_start(StartMessage("config", message)))
    os._exit(1)


def _plan(planner: Planner, request: Any) -> PlanResult:
    try:
        return checked(request.request_id, planner.plan(request))
    except Garbage as error:
        return garbage(request.request_id, error)
    except BaseException as error:  # noqa: BLE001 -- SystemExit and KeyboardInterrupt are no better
        return PlanResult.failed(request.request_id, f"the planner raised {describe(error)}")
