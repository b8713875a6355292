"""Both ends of a link in one process, on a clock that tests move."""

from __future__ import annotations

import socket
from collections import deque

from soter.isolation.child import Child, ChildDied
from soter.isolation.messages import Footprint, Turn, encode
from soter.isolation.mission_end import MissionEnd
from soter.isolation.supervisor_end import SupervisorEnd
from soter.rta import Port, Report
from soter.sdk import Controller, Link, RobotState, Waypoint

SILENT_S = 2.0
TICK_S = 0.05


def state(robot_id: int, x_m: float = 1.0) -> RobotState:
    """A sample of a robot that stands still."""
    return RobotState(robot_id, 0.0, 0.0, x_m, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, None, Controller.SC, None, Link.UP)


class FakeChild(Child):
    """A process that is none.

    Attributes:
        said: what it has sent.
        told: what it was sent; as much as there is `room` for.
        ended: how it has ended, or None.
        killed: whether it was told to end.
    """

    def __init__(self) -> None:
        self.said: deque[bytes] = deque()
        self.told: list[bytes] = []
        self.room = 10**6
        self.ended: str | None = None
        self.closed = False
        self.killed = False

    def send(self, data: bytes) -> bool:
        if self.closed:
            raise ChildDied("it closed its socket")
        if len(self.told) >= self.room:
            return False
        self.told.append(data)
        return True

    def receive(self, timeout_s: float = 0.0) -> bytes | None:
        if self.said:
            return self.said.popleft()
        if self.closed:
            raise ChildDied("it closed its socket")
        return None

    def how_it_ended(self) -> str | None:
        return self.ended

    def end(self) -> None:
        self.killed = True


ROOM = Footprint(0.1, 0.5, 0.1)


class Rig:
    """The supervisor's end with two robots, begun; what ports report goes to the mission as it should.

    Args:
        peers: robots of other processes.
    """

    def __init__(self, peers: tuple[int, ...] = ()) -> None:
        self.now_s = 100.0
        self.child = FakeChild()
        self.end = SupervisorEnd(self.child, SILENT_S, steady=lambda: self.now_s)
        self.ports: dict[int, Port[Waypoint, RobotState]] = {i: Port(i, self.end.hear) for i in (1, 2)}
        self.end.begin(self.ports, 0.0, (ROOM,) * len(self.ports), peers=peers)

    def tick(self, *turns: Turn, lasts_s: float = TICK_S) -> list[Turn]:
        """Tell of a tick, let time pass, say what the mission says, and take it."""
        self.end.send(self.now_s, self.now_s, [state(1), state(2)])
        self.now_s += lasts_s
        self.child.said.extend(map(encode, turns))
        return self.end.receive()

    def silence(self, lasts_s: float) -> None:
        """Tell of ticks, one after the other, to which the mission says nothing more than it has said."""
        for _ in range(round(lasts_s / TICK_S)):
            self.tick()


class Pair:
    """The mission's end, and the other side of its socket."""

    def __init__(self) -> None:
        self.supervisor, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.heard: list[Report] = []
        self.end = MissionEnd(theirs, self.heard.append)
        self._theirs = theirs

    def close(self) -> None:
        self.supervisor.close()
        self._theirs.close()
