"""The main function of a mission's process: makes the mission host and runs it at every tick of the supervisor."""

from __future__ import annotations

import faulthandler
import logging
import os
import pickle
import signal
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pkgutil import resolve_name
from typing import BinaryIO, Final, NoReturn

from soter.config import MissionFile
from soter.errors import BackendError, ConfigError, account_of
from soter.geometry.workspace import Workspace
from soter.isolation.child import die_with_parent, yield_to_others
from soter.isolation.messages import (
    MAX_MOVES,
    MAX_TEXT,
    Begin,
    Begun,
    FailedForGood,
    Moved,
    Started,
    TargetEndedMessage,
    TargetGiven,
    Tick,
    Turn,
)
from soter.isolation.mission_end import MissionEnd
from soter.isolation.refused import Refused
from soter.record.messages import TransitionEvent
from soter.rta import Report
from soter.runner.mission_host import MissionHost, OwnRoom, Scene
from soter.runner.part import Part
from soter.stack.events import Place, TargetOutcome
from soter.stack.site_terrain import terrain_of

logger = logging.getLogger(__name__)

_LOOK_S: Final = 0.1
_BUSY_LOOKS: Final = 2
"""Consecutive looks that find the same handler running, with no progress, after which it is reported."""


@dataclass(frozen=True, slots=True)
class MissionSpec:
    """The parameters that a mission's process is started with.

    Attributes:
        factory: makes the mission host, as `module:function`; called like `soter.runner.hosts.make_host`.
        mission: the mission.
        workspace: fence, boxes, chargers.
        body_radius_m: body radii of the robots, by id.
        memory_limit_bytes: address space that the process may use beyond what it has before the mission host is made.
        niceness: nice value of the process, relative to the supervisor's.
        part: this process's part of the mission; None for all of it.
    """

    factory: str
    mission: MissionFile
    workspace: Workspace
    body_radius_m: Mapping[int, float]
    memory_limit_bytes: int
    niceness: int
    part: Part | None = None


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> NoReturn:
    """Serve the supervisor until it is gone. Never returns, and skips exit handlers: untrusted code may have left some.

    Args:
        stdin: holds a pickled `MissionSpec`.
        socket_fd: a Unix socket of packets, see `soter.isolation`.
        lifeline_fd: read end of a pipe that the supervisor holds open and never writes to.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(lifeline_fd)
    # On a crash, print the stack to its output.
    faulthandler.enable()
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(line_buffering=True)  # type: ignore[union-attr] # both are text files here
    spec: MissionSpec = pickle.load(stdin)  # noqa: S301 - from the supervisor
    yield_to_others(spec.niceness, spec.memory_limit_bytes)
    _Host(spec, socket.socket(fileno=socket_fd)).serve()
    os._exit(0)


class _Host:
    """The mission host in this process, and its link to the supervisor."""

    def __init__(self, spec: MissionSpec, link: socket.socket) -> None:
        self._spec: Final = spec
        self._end: Final = MissionEnd(link, self._hear)
        self._host: MissionHost | None = None
        self._news: list[TargetGiven | TargetEndedMessage] = []
        self._moves: list[Moved] = []
        self._incidents = 0
        self._turns = 0
        self._broken = ""

    def serve(self) -> None:
        host = self._made()
        if host is None:
            return
        self._host = host
        threading.Thread(target=self._watch, args=(host,), name="mission-watch", daemon=True).start()
        try:
            while (messages := self._end.wait()) is not None:
                for message in messages:
                    if isinstance(message, Begin):
                        self._attempt(partial(self._start, host, message))
                        self._end.say(Begun())
                last = messages[-1]
                if isinstance(last, Tick):
                    self._attempt(partial(host.run, last.now_s))
                    self._end.answer(self._turn(host))
                self._turns += 1
        except (BrokenPipeError, ConnectionResetError):
            # The run has ended while this turn was computed.
            logger.debug("the supervisor is gone")
        finally:
            host.close()

    def on_target(self, robot_id: int, target_id: int, place: Place) -> None:
        self._news.append(TargetGiven(robot_id, target_id, float(place[0]), float(place[1])))

    def on_ended(self, robot_id: int, target_id: int, outcome: TargetOutcome) -> None:
        self._news.append(TargetEndedMessage(robot_id, target_id, outcome.value))

    def _made(self) -> MissionHost | None:
        spec = self._spec
        try:
            make: Callable[..., MissionHost] = resolve_name(spec.factory)
            away = {} if spec.part is None else {"part": spec.part}
            host = make(spec.mission, spec.workspace, spec.body_radius_m, virtual_time=False, **away)
            for radius_m in {*spec.body_radius_m.values()}:
                # Kept from here on: that of a large workspace takes seconds to make, for which no tick can wait.
                terrain_of(spec.workspace, radius_m)
            host.ready()
        except Exception as failure:
            if not isinstance(failure, ConfigError | BackendError):
                logger.exception("the ACs could not be made")
            self._end.say(Refused.of(failure))
        else:
            self._end.say(Started())
            return host
        return None

    def _start(self, host: MissionHost, begin: Begin) -> None:
        terrains = {
            radius_m: terrain_of(self._spec.workspace, radius_m)
            for radius_m in {one.body_radius_m for one in begin.rooms}
        }
        rooms = {
            robot_id: OwnRoom(terrains[room.body_radius_m], room.disc_m, room.arrival_m)
            for robot_id, room in zip(begin.robot_ids, begin.rooms, strict=True)
        }
        moved = self._moved if begin.recorded else None
        host.start(Scene(
            self._end.clock, self._spec.workspace, rooms, self._end.ports, self, moved, self._end.peers,
            dict(zip(begin.robot_ids, begin.capabilities, strict=True)),
        ))  # fmt: skip

    def _moved(self, transition: TransitionEvent) -> None:
        if len(self._moves) < MAX_MOVES:
            texts = (transition.source, transition.target, transition.event, transition.detail)
            source, target, event, detail = (text[:MAX_TEXT] for text in texts)
            machine, node = transition.machine[:MAX_TEXT], transition.node[:MAX_TEXT]
            self._moves.append(
                Moved(transition.time_s, machine, transition.machine_id, node, source, target, event, detail)
            )

    def _hear(self, report: Report) -> None:
        assert self._host is not None
        self._attempt(partial(self._host.hear, report))

    def _attempt(self, call: Callable[[], None]) -> None:
        """Call the mission host, unless it has failed already."""
        if self._broken:
            return
        try:
            call()
        except BaseException as failure:
            logger.exception("the mission failed")
            self._broken = f"the mission failed: {account_of(failure)}"

    def _turn(self, host: MissionHost) -> Turn:
        news, self._news = tuple(self._news), []
        moves, self._moves = tuple(self._moves), []
        incidents = tuple(each[:MAX_TEXT] for each in host.incidents[self._incidents :])
        self._incidents += len(incidents)
        failures = {None: self._broken, **host.failures} if self._broken else host.failures
        failed = tuple(FailedForGood(robot_id, cause[:MAX_TEXT]) for robot_id, cause in failures.items())
        return Turn(
            0, news=news, failures=failed, incidents=incidents, paths_replaced=host.paths_replaced, moves=moves,
            done=host.done,
        )  # fmt: skip

    def _watch(self, host: MissionHost) -> None:
        """Report a handler that does not return, if the interpreter still lets other threads run."""
        seen, looks = (-1, ""), 0
        pause = threading.Event()
        while not pause.wait(_LOOK_S):
            found = self._turns, host.current_handler or ""
            looks = looks + 1 if found == seen else 0
            seen = found
            if looks >= _BUSY_LOOKS and found[1]:
                self._end.busy(found[1][:MAX_TEXT])
                looks = 0
