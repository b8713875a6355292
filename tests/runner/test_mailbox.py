"""What machines of different processes tell each other, over a bus in this test; and letters that make no sense."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import pytest

from soter.clock import VirtualClock
from soter.config import load_mission
from soter.distribution.channel import ChannelFrame, Ended, Joined, ReliableChannel, ReliableMessage, VisitMessage
from soter.isolation.messages import encode
from soter.machine import Event, Machine, MachineRef, Next, Runtime, State, Stay
from soter.runner.mailbox import Mailbox
from soter.runner.part import Part
from soter.runner.peer_session import PeerSession
from soter.runner.progress import Follower
from soter.stack.events import TargetEnded, TargetOutcome, VisitTarget
from soter.stack.remote import RemoteCame, RemoteJoined, RemoteVisit
from tests.distribution.air import MemoryBus, Network
from tests.runner.lockstep import OwnPart

EXAMPLE = Path(__file__).parents[2] / "examples" / "distributed" / "mission.toml"


class Listener(Machine):
    """Keeps what comes from other processes."""

    Waiting: State[None] = State(start=True)

    def __init__(self, heard: list[Event]) -> None:
        self.heard = heard

    @Waiting.on(RemoteCame)
    def _came(self, e: RemoteCame) -> Next:
        return self._keep(e)

    @Waiting.on(RemoteVisit)
    def _visit(self, e: RemoteVisit) -> Next:
        return self._keep(e)

    @Waiting.on(RemoteJoined)
    def _joined(self, e: RemoteJoined) -> Next:
        return self._keep(e)

    @Waiting.on(TargetEnded)
    def _ended(self, e: TargetEnded) -> Next:
        return self._keep(e)

    def _keep(self, e: Event) -> Next:
        self.heard.append(e)
        return Stay()


class Side:
    """One process's machines: one that listens for the task planner or for robot 1."""

    def __init__(self, network: Network, process: str) -> None:
        mission = load_mission(EXAMPLE)
        part = Part.of(mission, mission.read_workspace(), process)
        self.heard: list[Event] = []
        self.runtime = Runtime(node=process)
        self.messages = Mailbox(part, MemoryBus(network, process), self.runtime)
        self.machine: MachineRef = self.runtime.create(Listener, heard=self.heard)
        if part.planner:
            self.messages.kit(1).subscribe(1, self.machine)
        else:
            self.messages.hears_task_planner(self.machine)


def pumped(network: Network, *hosts: Side) -> None:
    for _ in range(60):
        for host in hosts:
            host.messages.pump(network.now_s)
            host.runtime.run()
        network.advance(network.now_s + 0.05)


def test_events_of_the_task_planner_reach_robots_elsewhere_and_theirs_reach_it() -> None:
    network = Network(delay_s=(0.0, 0.2), loss=0.3)
    ground, alpha = Side(network, "ground"), Side(network, "alpha")
    pumped(network, ground, alpha)
    assert ground.heard == alpha.heard == [RemoteCame()]
    ground.messages.kit(1).tell(RemoteJoined(1, 2))
    ground.messages.kit(1).tell(RemoteVisit(1, VisitTarget(5, (1.0, 2.0), 30.0, 1)))
    alpha.messages.tell_task_planner(TargetEnded(1, 5, TargetOutcome.REACHED))
    pumped(network, ground, alpha)
    assert alpha.heard[1:] == [RemoteJoined(1, 2), RemoteVisit(1, VisitTarget(5, (1.0, 2.0), 30.0, 1))]
    assert ground.heard[1:] == [TargetEnded(1, 5, TargetOutcome.REACHED)]
    for host in (ground, alpha):
        host.messages.close()


NONSENSE: Final[list[ReliableMessage]] = [
    Ended(1, 5, "vanished"), Ended(2, 5, "reached"), Ended(9, 5, "reached"), VisitMessage(1, 5, 0.0, 0.0, None, 3),
    Joined(1, 2),
]  # fmt: skip


@pytest.mark.parametrize("message", NONSENSE)
def test_a_message_that_makes_no_sense_to_the_task_planner_is_left_out(
    message: ReliableMessage, caplog: pytest.LogCaptureFixture
) -> None:
    network = Network()
    ground = Side(network, "ground")
    mission = load_mission(EXAMPLE)
    alpha = Part.of(mission, mission.read_workspace(), "alpha").reliable_channel(MemoryBus(network, "alpha"))
    exchanged(network, ground, alpha)
    alpha.send("ground", message)
    with caplog.at_level(logging.WARNING):
        exchanged(network, ground, alpha)
    assert ground.heard == [RemoteCame()]
    assert bool(caplog.records) == isinstance(message, Ended)


def exchanged(network: Network, host: Side, channel: ReliableChannel) -> None:
    for _ in range(60):
        host.messages.pump(network.now_s)
        host.runtime.run()
        channel.pump(network.now_s)
        network.advance(network.now_s + 0.05)


def test_another_missions_messages_and_garbage_are_ignored_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    network = Network()
    ground, stranger = Side(network, "ground"), MemoryBus(network, "stranger")
    for _ in range(3):
        stranger.publish("soter/alpha/messages/ground", encode(ChannelFrame(7, 0, "another")))
        stranger.publish("soter/alpha/messages/ground", b"garbage")
        stranger.publish("soter/nobody/messages/ground", encode(ChannelFrame(7, 0, "another")))
        pumped(network, ground)
    assert ground.heard == []
    said = [record.getMessage() for record in caplog.records]
    assert len(said) == 2
    assert any("'alpha' runs another mission" in each for each in said)
    assert any("no message of SOTER" in each for each in said)


def test_who_is_told_to_stop_waits_no_longer() -> None:
    mission = load_mission(EXAMPLE)
    part = Part.of(mission, mission.read_workspace(), "ground")
    network = Network()
    own = OwnPart(
        **{name: getattr(part, name) for name in Part.__dataclass_fields__}, site=Hosts(network), host="ground"
    )
    asked = iter([False, False, True])
    said: list[str] = []
    with PeerSession(own, VirtualClock()) as session:
        assert not session.wait((), Follower(say=said.append, stop=lambda: next(asked)))
    assert len(said) == 1
    assert not network.buses, "it has left the bus"


class Hosts:
    """What an `OwnPart` asks for its network."""

    def __init__(self, network: Network) -> None:
        self.network = network
