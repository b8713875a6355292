"""What machines of different processes tell each other, over a bus in this test; and letters that make no sense."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Final

import pytest

from soter.clock import VirtualClock
from soter.config import load_mission
from soter.distribution.channel import Ended, Frame, Joined, Letter, Post, Visit, encode_frame
from soter.machine import Event, Machine, MachineRef, Next, Runtime, State, Stay
from soter.runner.correspondence import Correspondence
from soter.runner.part import Part
from soter.runner.together import Together
from soter.stack.away import JoinedAway, OtherSideCame, VisitAway
from soter.stack.events import Outcome, TargetEnded, VisitTarget
from tests.distribution.air import MemoryBus, Network
from tests.runner.lockstep import OwnPart

EXAMPLE = Path(__file__).parents[2] / "examples" / "distributed" / "mission.toml"


class Listener(Machine):
    """Keeps what comes from other processes."""

    Waiting: State[None] = State(start=True)

    def __init__(self, heard: list[Event]) -> None:
        self.heard = heard

    @Waiting.on(OtherSideCame)
    def _came(self, e: OtherSideCame) -> Next:
        return self._keep(e)

    @Waiting.on(VisitAway)
    def _visit(self, e: VisitAway) -> Next:
        return self._keep(e)

    @Waiting.on(JoinedAway)
    def _joined(self, e: JoinedAway) -> Next:
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
        self.letters = Correspondence(part, MemoryBus(network, process), self.runtime)
        self.machine: MachineRef = self.runtime.create(Listener, heard=self.heard)
        if part.planner:
            self.letters.kit(1).subscribe(1, self.machine)
        else:
            self.letters.hears_task_planner(self.machine)


def pumped(network: Network, *sides: Side) -> None:
    for _ in range(60):
        for side in sides:
            side.letters.pump(network.now_s)
            side.runtime.run()
        network.advance(network.now_s + 0.05)


def test_events_of_the_task_planner_reach_robots_elsewhere_and_theirs_reach_it() -> None:
    network = Network(delay_s=(0.0, 0.2), loss=0.3)
    ground, alpha = Side(network, "ground"), Side(network, "alpha")
    pumped(network, ground, alpha)
    assert ground.heard == alpha.heard == [OtherSideCame()]
    ground.letters.kit(1).tell(JoinedAway(1, 2))
    ground.letters.kit(1).tell(VisitAway(1, VisitTarget(5, (1.0, 2.0), 30.0, 1)))
    alpha.letters.tell_task_planner(TargetEnded(1, 5, Outcome.REACHED))
    pumped(network, ground, alpha)
    assert alpha.heard[1:] == [JoinedAway(1, 2), VisitAway(1, VisitTarget(5, (1.0, 2.0), 30.0, 1))]
    assert ground.heard[1:] == [TargetEnded(1, 5, Outcome.REACHED)]
    for side in (ground, alpha):
        side.letters.close()


NONSENSE: Final[list[Letter]] = [
    Ended(1, 5, "vanished"), Ended(2, 5, "reached"), Ended(9, 5, "reached"), Visit(1, 5, 0.0, 0.0, None, 3),
    Joined(1, 2),
]  # fmt: skip


@pytest.mark.parametrize("letter", NONSENSE)
def test_a_letter_that_makes_no_sense_to_the_task_planner_is_left_out(
    letter: Letter, caplog: pytest.LogCaptureFixture
) -> None:
    network = Network()
    ground = Side(network, "ground")
    mission = load_mission(EXAMPLE)
    alpha = Part.of(mission, mission.read_workspace(), "alpha").post(MemoryBus(network, "alpha"))
    exchanged(network, ground, alpha)
    alpha.send("ground", letter)
    with caplog.at_level(logging.WARNING):
        exchanged(network, ground, alpha)
    assert ground.heard == [OtherSideCame()]
    assert bool(caplog.records) == isinstance(letter, Ended)


def exchanged(network: Network, side: Side, post: Post) -> None:
    for _ in range(60):
        side.letters.pump(network.now_s)
        side.runtime.run()
        post.pump(network.now_s)
        network.advance(network.now_s + 0.05)


def test_another_missions_letters_and_garbage_are_ignored_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    network = Network()
    ground, stranger = Side(network, "ground"), MemoryBus(network, "stranger")
    for _ in range(3):
        stranger.publish("soter/alpha/letters/ground", encode_frame(Frame(7, 0, "another")))
        stranger.publish("soter/alpha/letters/ground", b"garbage")
        stranger.publish("soter/nobody/letters/ground", encode_frame(Frame(7, 0, "another")))
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
    with Together(own, VirtualClock()) as together:
        assert not together.wait((), said.append, lambda: next(asked))
    assert len(said) == 1
    assert not network.buses, "it has left the bus"


class Hosts:
    """What an `OwnPart` asks for its network."""

    def __init__(self, network: Network) -> None:
        self.network = network
