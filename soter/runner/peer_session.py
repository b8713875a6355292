"""One process's session with the other processes of its mission: exchanges the robots' states, and waits for all."""

from __future__ import annotations

import math
import time
from array import array
from collections.abc import Mapping, Sequence
from typing import Final, Self

import numpy as np

from soter.clock import Clock
from soter.distribution.peer_group import PeerGroup
from soter.distribution.status import RobotStatus
from soter.errors import RobotUnavailable, option_error
from soter.record.messages import AC
from soter.rta import PEER_SILENT_S, RemotePeer, RobotSupervisor
from soter.runner.metrics import percentiles
from soter.runner.part import Part
from soter.runner.progress import Follower, RobotProgress
from soter.runner.result import TickTimes
from soter.sdk import Capabilities, Controller, Robot, RobotState
from soter.stack.kit import RobotPort
from soter.stack.right_of_way import needs_charge

SAY_EVERY_S: Final = 5.0
"""Host time between two messages about missing processes."""

_LOOK_S: Final = 0.05
_DUPLICATE_S: Final = 0.5
"""Least time for which a process listens for a duplicate of its name before anything moves."""


class PeerSession:
    """A process's connection to the other processes of its mission. Used from the supervisor's thread only.

    A context manager that leaves the bus.

    Args:
        part: this process's part of the mission.
        clock: fleet time; thread-safe.

    Attributes:
        process: this process's name.
        peers: the robots of other processes.
        promises: what each of those promises, by id.
        ports: by robot, the read-only ports of those for the planners here.
    """

    def __init__(self, part: Part, clock: Clock) -> None:
        self.process: Final = part.name
        self._ages_s: Final[array[float]] = array("d")
        self._took_s: Final[array[float]] = array("d")
        self._clock: Final = clock
        self._part: Final = part
        self._peer_group: Final[PeerGroup] = part.peer_group(part.open_bus(), clock)
        peer_group = self._peer_group
        self.peers: Final[Sequence[RemotePeer]] = peer_group.peers
        self.promises: Final[Mapping[int, Capabilities]] = {
            peer.robot_id: part.promised[peer.robot_id] for peer in peer_group.peers
        }
        self.ports: Final[Mapping[int, RobotPort]] = {peer.robot_id: peer.port for peer in peer_group.peers}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._peer_group.close()

    def look(self) -> None:
        """Take what the others have sent. To be called before every tick."""
        begun_s = time.perf_counter()
        self._peer_group.look()
        self._took_s.append(time.perf_counter() - begun_s)
        now_s = self._clock.now()
        self._ages_s.extend(now_s - sample.stamp_s for peer in self.peers if (sample := peer.sample()) is not None)

    def tell(self, robots: Sequence[RobotSupervisor]) -> None:
        """Send the others the states of this process's robots. To be called after every tick."""
        begun_s = time.perf_counter()
        self._peer_group.tell([_status(robot) for robot in robots])
        self._took_s[-1] += time.perf_counter() - begun_s

    def wait(self, robots: Sequence[Robot], follower: Follower, *, again: bool = False) -> bool:
        """Wait until all other processes have joined; meanwhile the robots stand, and their states are sent.

        Args:
            robots: this process's robots, ready.
            again: all have joined before; now each is waited for until it has begun, which takes its time.
            follower: shown the missing processes, whenever they change and every few seconds, and polled for whether
                to give up.

        Returns:
            Whether all have joined; False if the follower gave up.

        Raises:
            RobotUnavailable: a process has not joined in time; the message says which, and why.
            ConfigError: another process of this name is running.
        """
        clock, limit_s = self._clock, self._part.mission.distribution.wait_s
        begun_s, said = clock.steady_s(), ""
        since_s, said_s, least_s = (clock.now(), 0.0, 0.0) if again else (-math.inf, -math.inf, _DUPLICATE_S)
        while not follower.stop():
            self._peer_group.look()
            self._peer_group.tell([RobotStatus(robot.read_state(), False, "waiting", False) for robot in robots])
            self._refuse_duplicate()
            waited_s = clock.steady_s() - begun_s
            missing = self._peer_group.missing(clock.now(), since_s)
            if not missing and waited_s >= least_s:
                if said:
                    follower.say("all processes are there")
                return True
            words = "; ".join(self._in_words(name, why) for name, why in missing.items())
            if waited_s > limit_s:
                raise RobotUnavailable(
                    f"after {limit_s:g} s not all processes are there: {words}; start each with --process, and check "
                    "that all reach the same bus"
                )
            if words and ((words != said and not again) or waited_s - said_s >= SAY_EVERY_S):
                said, said_s = words, waited_s
                follower.say(f"waiting for {words}")
            clock.sleep_until(clock.now() + _LOOK_S)
        return False

    def _refuse_duplicate(self) -> None:
        if self._peer_group.has_duplicate():
            raise option_error(
                "--process",
                f"another process '{self.process}' of this mission is running; end that one, or choose another with "
                f"--process: {', '.join(self._part.mission.distribution.processes)}",
            )

    def took_us(self) -> TickTimes:
        """Return how long receiving and sending took at a tick, of host time in microseconds."""
        return percentiles(np.frombuffer(self._took_s) * 1e6)

    def ages_ms(self) -> TickTimes | None:
        """Return how old the others' samples were at the ticks, at most; None if the others have no robots."""
        return percentiles(np.frombuffer(self._ages_s) * 1e3) if self.peers else None

    def progress(self) -> tuple[RobotProgress, ...]:
        """Return the progress of the other processes' robots, as far as they have reported it."""
        now_s, found = self._clock.now(), []
        for peer in self._peer_group.peers:
            state = peer.sample()
            if state is not None:
                silent_s = now_s - state.stamp_s
                driver, cause = peer.driver or AC, ""
                if silent_s > PEER_SILENT_S:
                    driver, cause = "silent", f"not heard of for {silent_s:.1f} s"
                found.append(RobotProgress(peer.robot_id, state.x_m, state.y_m, driver, cause, state.battery, {}, 0, 0))
        return tuple(found)

    def _in_words(self, process: str, why: str) -> str:
        robots = self._part.robots_of(process)
        what = [f"robot {robot_id}" for robot_id in robots]
        what += ["the task planner"] * (process == self._part.planner_home)
        return f"'{process}' with {' and '.join(what)} ({why})"


def _status(robot: RobotSupervisor) -> RobotStatus:
    state, driver = robot.situation.own, robot.driver
    assert isinstance(state, RobotState)
    name = "" if driver is None else driver.name
    return RobotStatus(state, robot.mode is Controller.AC, name, needs_charge(robot))
