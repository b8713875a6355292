"""The main function of a worker process: builds one planner and answers requests until its parent is gone."""

from __future__ import annotations

import os
import pickle
import signal
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO, NoReturn

from soter.child import die_with_parent, yield_to_others
from soter.errors import ConfigError
from soter.stack.planners.base import Planner, PlanResult
from soter.stack.planners.names import PlannerUnavailable, build_planner
from soter.stack.planners.wire import (
    Garbage,
    StartMessage,
    checked,
    describe,
    encode_result,
    encode_start,
    garbage,
)
from soter.workspace import Workspace

MAX_REQUEST_BYTES = 1 << 18


@dataclass(frozen=True, slots=True)
class WorkerSpec:
    """What a worker is told when it starts.

    Attributes:
        planner: name of the planner.
        workspace: the known fence and boxes.
        body_radius_m: radius of the robot's round body.
        options: the raw table of the planner.
        source: the mission file that the options are from, or None.
        memory_limit_bytes: address space that the planner may add to what the bare worker has.
        niceness: how much less than the mission the worker is favoured by the scheduler.
    """

    planner: str
    workspace: Workspace
    body_radius_m: float
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
