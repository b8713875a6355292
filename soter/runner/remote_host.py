"""The mission host in a process of its own, on a wall clock: whatever happens to it, the supervisor's ticks go on."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Mapping
from typing import Final

from soter.config import MissionFile
from soter.errors import ConfigError, Garbage, RunFailed
from soter.geometry.workspace import Workspace
from soter.isolation.child import Child, ChildDied, NotBoxed
from soter.isolation.messages import Footprint, PeerSeen, TargetGiven, Turn
from soter.isolation.refused import Refused
from soter.isolation.supervisor_end import SupervisorEnd
from soter.record.messages import TransitionEvent
from soter.rta import Report
from soter.runner.boxes import box_of
from soter.runner.mission_host import MAX_INCIDENTS, Scene
from soter.runner.mission_process import MissionSpec
from soter.runner.part import Part
from soter.stack.events import OUTCOMES

_READ_BYTES: Final = 1 << 14
_PASSED_LINES: Final = 20
_PASSED_CHARACTERS: Final = 300
_PAUSE_S: Final = 0.1
_JOIN_S: Final = 0.5


class OutputPump:
    """A pipe for a process's output, and a thread that logs what the process writes.

    Of a process that prints without end only a part is logged, at the cost of a few wake-ups a second.

    Attributes:
        output_fd: the pipe's end to write to; `started` closes it once the process has it.
    """

    def __init__(self, name: str) -> None:
        self._name: Final = name
        self._read_fd, self.output_fd = os.pipe()
        self._thread: Final = threading.Thread(target=self._pass_on, name=f"words of {name}", daemon=True)

    def started(self) -> None:
        """Start the thread, once the process has its end of the pipe."""
        os.close(self.output_fd)
        self._thread.start()

    def close(self) -> None:
        """Wait for the last output of a process that has ended, but not for that of processes it has left behind."""
        self._thread.join(_JOIN_S)

    def _pass_on(self) -> None:
        begun = b""
        while data := os.read(self._read_fd, _READ_BYTES):
            # A line may come in pieces, as from an interpreter that does not buffer; one that never ends is cut.
            whole, newline, begun = (begun + data).rpartition(b"\n")
            if not newline and len(begun) > _READ_BYTES:
                whole, begun = begun, b""
            self._say(whole)
            time.sleep(_PAUSE_S)
        self._say(begun)
        os.close(self._read_fd)

    def _say(self, words: bytes) -> None:
        lines = words.decode("utf-8", "replace").splitlines()
        for line in lines[:_PASSED_LINES]:
            if line.strip():
                text = "".join(c if c.isprintable() else " " for c in line[:_PASSED_CHARACTERS])
                # Lines that a script logs already begin with the mission's name.
                logger.warning("%s: %s", self._name, text.removeprefix(f"{self._name}: "))
        if len(lines) > _PASSED_LINES:
            logger.warning("%s: ... and %d lines more", self._name, len(lines) - _PASSED_LINES)


logger = logging.getLogger(__name__)

FACTORY: Final = "soter.runner.hosts:make_host"
PROCESS: Final = "soter.runner.mission_process"

START_LIMIT_S: Final = 75.0
"""Host time that the mission may take to start: a planner's worker has 60 s."""

NICENESS: Final = 5
GRACE_S: Final = 1.0

WALL_CLOCK: Final = "it ran on a wall clock"


class RemoteMissionHost:
    """A `MissionHost` that is a proxy of another one, in a process of its own.

    That process is killed when it fails, when the run ends, and by the kernel when this process ends in any way.

    Args:
        mission: the mission; its `isolation` says what the process may use.
        workspace: fence, boxes, chargers.
        body_radius_m: body radii of the robots, by id.
        factory: makes the mission host in that process, as `module:function`.
        part: this process's part of the mission; None for all of it.
    """

    current_handler: str | None = None

    def __init__(
        self,
        mission: MissionFile,
        workspace: Workspace,
        body_radius_m: Mapping[int, float],
        factory: str = FACTORY,
        part: Part | None = None,
    ) -> None:
        self.failures: dict[int | None, str] = {}
        self.paths_replaced = 0
        self.done = False
        self.answers = 0
        self.incidents: list[str] = [WALL_CLOCK]
        self._scene: Scene | None = None
        limits = mission.isolation
        self._output: Final = OutputPump("mission")
        spec = MissionSpec(factory, mission, workspace, body_radius_m, limits.memory_mib << 20, NICENESS, part)
        # A tick has no time to wait for a process to end.
        box = box_of(mission, part)
        self._child: Final = Child(PROCESS, spec, output_fd=self._output.output_fd, patience_s=0.0, box=box)
        self._output.started()
        self._end: Final = SupervisorEnd(self._child, limits.silent_s)

    @property
    def pid(self) -> int:
        """The id of the mission's process."""
        return self._child.pid

    @property
    def sandbox(self) -> dict[str, str]:
        """What the sandbox denies the mission's process, and by which means; empty without a sandbox."""
        return {} if self._child.in_force is None else self._child.in_force.in_words()

    def ready(self) -> None:
        """Wait until the ACs are made.

        Raises:
            ConfigError: the mission asks for something that is not allowed, or for a sandbox that the kernel lacks.
            BackendUnavailable: a library is missing.
            RunFailed: the mission's process does not start.
        """
        try:
            first = self._end.await_start(START_LIMIT_S)
        except NotBoxed as failure:
            raise ConfigError(f"the mission cannot be sandboxed: {failure}", key="isolation.sandbox") from failure
        except (ChildDied, Garbage) as failure:
            raise RunFailed(f"the mission's process could not be started ({failure})") from failure
        if first is None:
            raise RunFailed(
                f"the mission's process has not started within {START_LIMIT_S:g} s; is the host overloaded?"
            )
        if not isinstance(first, Refused):
            if self._child.in_force is not None and self._child.in_force.missing:
                logger.warning("the mission's sandbox is incomplete: %s", self._child.in_force.missing)
            return
        error = first.error()
        raise RunFailed(f"the mission could not be made: {error}") if isinstance(error, RunFailed) else error

    @property
    def not_begun(self) -> str:
        """Why the mission has not begun, in words; empty once it has."""
        return self._end.not_begun

    def start(self, scene: Scene) -> None:
        """Tell the mission that its robots are ready; it begins while the first ticks pass."""
        self._scene = scene
        rooms = [scene.rooms[robot_id] for robot_id in scene.ports]
        self._end.begin(
            scene.ports, scene.clock.now(),
            tuple(Footprint(room.terrain.body_radius_m, room.disc_m, room.arrival_m) for room in rooms),
            recorded=scene.on_transition is not None, peers=tuple(scene.peers),
            capabilities=tuple(scene.capabilities[robot_id] for robot_id in scene.ports),
        )  # fmt: skip

    def hear(self, report: Report) -> None:
        """Queue a port's report."""
        self._end.hear(report)

    def receive(self) -> None:
        """Take what the mission has sent since the last tick. To be called before a tick; never waits."""
        assert self._scene is not None
        for turn in self._end.receive():
            self._take(turn, self._scene)
        if self._end.failure and None not in self.failures:
            self.failures[None] = f"the mission has failed: {self._end.failure}"
            logger.error("%s", self.failures[None])

    def run(self, now_s: float) -> None:
        """Send the mission a tick; never waits."""
        assert self._scene is not None
        states = [port.state for port in self._scene.ports.values()]
        peers = [PeerSeen(port.state, port.engaged) for port in self._scene.peers.values()]
        self._end.send(now_s, self._scene.clock.now(), states, peers)

    def close(self) -> None:
        """End the mission's process. Idempotent."""
        self._child.kill(0.0 if self._end.failure else GRACE_S)
        self._output.close()

    def _take(self, turn: Turn, scene: Scene) -> None:
        log = scene.log
        self.answers += 1
        if scene.on_transition is not None:
            for each in turn.moves:
                scene.on_transition(TransitionEvent(
                    each.time_s, each.machine, each.machine_id, each.node, each.source, each.target, each.event,
                    each.detail,
                ))  # fmt: skip
        for news in turn.news:
            if isinstance(news, TargetGiven):
                log.on_target(news.robot_id, news.target_id, (news.x_m, news.y_m))
            elif (outcome := OUTCOMES.get(news.outcome)) is not None:
                log.on_ended(news.robot_id, news.target_id, outcome)
            else:
                self._end.fail(f"it sent garbage: a target ended as '{news.outcome}'")
        for failed in turn.failures:
            self.failures.setdefault(failed.robot_id, failed.cause)
        self.paths_replaced, self.done = turn.paths_replaced, turn.done
        self.incidents += turn.incidents[: max(0, MAX_INCIDENTS - len(self.incidents))]
