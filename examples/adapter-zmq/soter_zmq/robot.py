"""The simulated robots as a program: `python -m soter_zmq.robot WORKSPACE.xml`; see `soter_sim.commanded`.

Every robot has a socket for commands and one for reports. They listen on this host only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Final

import zmq

from soter.geometry.workspace import Workspace
from soter.onboard.command import Command, Report
from soter.sdk import RobotSpec, RuleLimits
from soter_sim.commanded import CommandedEndpoint, run
from soter_zmq.wire import decode_command, encode_report


class Endpoint(CommandedEndpoint):
    """The robots' ends of the wire.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        limits: what the mission promises.
        truth_port: where to tell the truth.
        at: by robot, the addresses that it had before.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        limits: RuleLimits,
        truth_port: int,
        at: Mapping[int, Mapping[str, str]],
    ) -> None:
        super().__init__(workspace, robots, limits, truth_port)
        self._context: Final = zmq.Context()
        self._context.linger = 0
        self._poller: Final = zmq.Poller()
        self._commands: Final = {each: self._bound(zmq.PULL, at.get(each, {}).get("command")) for each in self.vehicles}
        self._reports: Final = {each: self._bound(zmq.PUB, at.get(each, {}).get("report")) for each in self.vehicles}
        for socket in self._commands.values():
            self._poller.register(socket, zmq.POLLIN)

    @property
    def addresses(self) -> dict[int, dict[str, str]]:
        return {
            each: {"command": address(self._commands[each]), "report": address(self._reports[each])}
            for each in self.vehicles
        }

    def _wait(self, seconds: float) -> None:
        self._poller.poll(math.ceil(1000.0 * seconds))

    def _hear(self) -> None:
        for robot_id, socket in self._commands.items():
            with suppress(zmq.Again):
                self.take(robot_id, socket.recv(zmq.NOBLOCK))

    def _say(self, robot_id: int, message: bytes) -> None:
        self._reports[robot_id].send(message, zmq.NOBLOCK)

    def _encode(self, report: Report) -> bytes:
        return encode_report(report)

    def _decode(self, message: bytes) -> Command:
        return decode_command(message)

    def _end(self) -> None:
        self._context.destroy()

    def _bound(self, kind: int, wanted: str | None) -> zmq.Socket[bytes]:
        socket = self._context.socket(kind)
        # The last message only: a robot that was held up finds no queue of old commands.
        socket.setsockopt(zmq.CONFLATE, 1)
        socket.bind(wanted or "tcp://127.0.0.1:*")
        return socket


def address(socket: zmq.Socket[bytes]) -> str:
    """Return where a socket listens."""
    return bytes(socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()


if __name__ == "__main__":
    run("soter_zmq.robot", "robots on ZeroMQ", Endpoint)
