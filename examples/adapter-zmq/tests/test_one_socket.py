"""What the kit says of this adapter where one socket, which keeps the last message only, serves all robots."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import Any, ClassVar

import pytest
import zmq

from soter.clock import VehicleClock
from soter.conformance import CLAUSES, Verdict, try_clause
from soter.sdk import Robot, RobotSpec
from soter_zmq.adapter import ZmqBackend, ZmqConfig, ZmqRobot
from soter_zmq.harness import ZmqHarness
from soter_zmq.receiver import Receiver, opened
from soter_zmq.relay import Relay


class Addressed(ZmqRobot):
    """Says with each command whom it is for."""

    def _publish(self, message: bytes) -> None:
        with suppress(zmq.Again):
            self._commands.send(json.dumps([self.id, message.decode()]).encode(), zmq.NOBLOCK)


def until_closed(shared: ExitStack) -> zmq.Context[zmq.Socket[bytes]]:
    """Return a context that is destroyed, with what it has not sent, where the backend is closed."""
    context = zmq.Context()
    context.linger = 0
    shared.callback(context.destroy)
    return context


class SaysByOne(ZmqBackend):
    """Tells all robots by the socket of the first."""

    def connect(
        self, config: ZmqConfig, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Robot]:
        context = until_closed(shared)
        one = opened(context, zmq.PUSH, config.robots[robots[0].id].command)
        made = [Addressed(each, clock, one) for each in robots]
        receiver = Receiver(context, {config.robots[each.id].report: each.receive for each in made})
        shared.callback(receiver.close)
        return made


class HearsByOne(ZmqBackend):
    """Hears all robots by the socket of the first."""

    def connect(
        self, config: ZmqConfig, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[Robot]:
        context = until_closed(shared)
        at = config.robots
        made = {each.id: ZmqRobot(each, clock, opened(context, zmq.PUSH, at[each.id].command)) for each in robots}
        receiver = Receiver(
            context, {at[robots[0].id].report: lambda message: made[json.loads(message)["robot"]].receive(message)}
        )
        shared.callback(receiver.close)
        return list(made.values())


class Gateway(Relay):
    """Passes on what comes by one line to the robot that it names, and all that robots say by the line of the first."""

    one_report: ClassVar[bool] = False

    def _hear(self) -> None:
        reports = [line for source, line in self._lines.items() if source.type == zmq.SUB]
        commands = {line.robot_id: line for source, line in self._lines.items() if source.type == zmq.PULL}
        poller = zmq.Poller()
        for source in self._lines:
            poller.register(source, zmq.POLLIN)
        while not self._ended.is_set():
            for source, _ in poller.poll(20):
                message, line = source.recv(), self._lines[source]
                if message.startswith(b"["):
                    robot_id, text = json.loads(message)
                    message, line = text.encode(), commands[robot_id]
                self.pass_on(reports[0] if line in reports and self.one_report else line, message)


class OneReport(Gateway):
    """Has one line for what all robots say."""

    one_report = True


class SaysByOneHarness(ZmqHarness):
    """Opens robots behind a gateway that hears by one line."""

    backend = SaysByOne

    def impair(self, addresses: Mapping[int, Any]) -> Relay:
        return Gateway(addresses)


class HearsByOneHarness(ZmqHarness):
    """Opens robots behind a gateway that speaks by one line."""

    backend = HearsByOne

    def impair(self, addresses: Mapping[int, Any]) -> Relay:
        return OneReport(addresses)


@pytest.mark.parametrize(
    ("harness", "clause"),
    [(SaysByOneHarness, "several.told"), (HearsByOneHarness, "several.said")],
    ids=["commands", "reports"],
)
def test_one_socket_for_all_robots_loses_what_is_for_one_of_them(harness: type[ZmqHarness], clause: str) -> None:
    outcome, _ = try_clause(CLAUSES[clause], harness())
    assert outcome.verdict is Verdict.FAIL
    assert "a buffer that keeps the last message only" in outcome.reason
