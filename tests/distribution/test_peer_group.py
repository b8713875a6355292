"""What processes know of each other's robots, with clocks that agree in nothing and a network that may do anything."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.clock import Clock
from soter.distribution.peer_group import PeerGroup
from soter.distribution.peers import DRIFT, RemoteRobot
from soter.distribution.status import Echo, RobotStatus, Status, decode_status
from soter.errors import Garbage
from soter.isolation.messages import encode
from soter.rta import PEER_SILENT_S, Assumption, SpeedBound
from soter.sdk import Waypoint
from tests.distribution.air import MemoryBus, Network
from tests.isolation.ends import state

TICK_S = 0.05
MISSION = "a mission"
SPEED = SpeedBound(0.22, 1.0)


class SkewedClock(Clock):
    """A clock that agrees with nobody's."""

    def __init__(self, network: Network, offset_s: float, rate: float) -> None:
        self._network, self._offset_s, self._rate = network, offset_s, rate

    def now(self) -> float:
        return self.at(self._network.now_s)

    def at(self, true_s: float) -> float:
        """What it shows at a time of the network."""
        return self._offset_s + self._rate * true_s

    def skip(self, by_s: float) -> None:
        """Let it jump."""
        self._offset_s += by_s

    def sleep_until(self, time_s: float) -> None:
        raise AssertionError("nobody sleeps here")


class Process:
    """One process with one robot, whose samples are `age_s` old when they are told."""

    def __init__(self, network: Network, name: str, other: str, robot_id: int, offset_s: float, rate: float) -> None:
        self.network, self.name, self.robot_id = network, name, robot_id
        self.clock = SkewedClock(network, offset_s, rate)
        self.peer_group = PeerGroup(
            MemoryBus(network, name), "soter", name, {other: {3 - robot_id: (SPEED, 0.0)}}, MISSION, self.clock
        )
        self.told: dict[float, float] = {}  # place of a sample, and when it was really taken
        self.where_m = 0.0
        self.age_s = 0.02

    @property
    def peer(self) -> RemoteRobot:
        return self.peer_group.peers[0]

    def tick(self) -> None:
        self.peer_group.look()
        self.where_m += 1e-3
        true_s = self.network.now_s - self.age_s
        self.told[self.where_m] = true_s
        sample = state(self.robot_id)._replace(x_m=self.where_m, stamp_s=self.clock.at(true_s))
        self.peer_group.tell([RobotStatus(sample, True, "", False)])

    def known_age_s(self) -> float:
        """How old the peer's sample is at most, by what this process knows."""
        sample = self.peer.sample()
        return math.inf if sample is None else self.clock.now() - sample.stamp_s


class World:
    """Two processes and time."""

    def __init__(
        self,
        seed: int = 0,
        delay_s: tuple[float, float] = (0.0, 0.0),
        loss: float = 0.0,
        offsets_s: tuple[float, float] = (0.0, 1000.0),
        rates: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        self.network = Network(seed, delay_s, loss)
        self._given = (offsets_s, rates)
        self.a = Process(self.network, "a", "b", 1, offsets_s[0], rates[0])
        self.b = Process(self.network, "b", "a", 2, offsets_s[1], rates[1])

    def restart_b(self) -> None:
        """Start b anew, with a clock of its own that begins anywhere."""
        self.b.peer_group.close()
        told = self.b.told
        self.b = Process(self.network, "b", "a", 2, -77.0, 1.0)
        self.b.told.update(told)
        self.b.where_m = max(told)

    def run(self, duration_s: float, look: Callable[[], None] = lambda: None) -> None:
        end_s = self.network.now_s + duration_s
        while self.network.now_s < end_s - 1e-9:
            for process in (self.a, self.b):
                process.tick()
                self.network.advance(self.network.now_s + TICK_S / 2)
                look()


def sound(me: Process, other: Process) -> None:
    """No sample is taken for younger than it is."""
    sample = me.peer.sample()
    if sample is not None:
        assert sample.stamp_s <= me.clock.at(other.told[sample.x_m]) + 1e-9


@settings(max_examples=60)
@given(
    st.integers(0, 2**32), st.sampled_from([(0.0, 0.0), (0.001, 0.003), (0.0, 0.4), (0.3, 1.0)]),
    st.sampled_from([0.0, 0.3, 0.8]), st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    st.tuples(*[st.floats(1 - DRIFT / 2.1, 1 + DRIFT / 2.1)] * 2), st.booleans(), st.booleans(),
)  # fmt: skip
def test_no_sample_is_ever_taken_for_younger_than_it_is(
    seed: int, delay_s: tuple[float, float], loss: float, offsets_s: tuple[float, float], rates: tuple[float, float],
    one_way: bool, restarts: bool,
) -> None:  # fmt: skip
    world = World(seed, delay_s, loss, offsets_s, rates)
    stamps: dict[str, float] = {}

    def look() -> None:
        for me, other in ((world.a, world.b), (world.b, world.a)):
            sound(me, other)
            found = me.peer.found()
            assert found is None, found
            sample = me.peer.sample()
            if sample is not None:
                assert sample.stamp_s >= stamps.get(me.name, -math.inf)
                stamps[me.name] = sample.stamp_s

    world.run(2.0, look)
    if one_way:
        world.network.cut.add(("a", "b"))
        world.run(2.0, look)
        world.network.cut.clear()
    if restarts:
        world.restart_b()
        stamps.pop("b", None)
    world.run(3.0, look)


def test_the_age_that_is_known_is_a_round_trip_too_large_at_most() -> None:
    world = World(delay_s=(0.004, 0.004))
    world.run(1.0)
    ages_s: list[tuple[float, float]] = []

    def look() -> None:
        sample = world.a.peer.sample()
        assert sample is not None
        ages_s.append((world.a.known_age_s(), world.network.now_s - world.b.told[sample.x_m]))

    world.run(1.0, look)
    excess_s = [known_s - true_s for known_s, true_s in ages_s]
    assert all(0.0 <= excess <= 0.008 + TICK_S / 2 + 1e-3 for excess in excess_s), excess_s


def test_before_anything_came_back_nothing_is_known() -> None:
    world = World(delay_s=(0.1, 0.1))
    world.network.cut.add(("a", "b"))
    world.run(1.0)
    assert world.a.peer.sample() is None
    assert world.a.peer.heard_of(1) == -math.inf
    assert world.a.peer_group.missing(0.0) == {"b": "it does not hear this one"}
    assert world.b.peer_group.missing(0.0) == {"a": "it has not been heard yet"}


def alive(me: Process) -> bool:
    """Whether this process's robot may move, as the supervisor judges it."""
    now_s = me.clock.now()
    return me.known_age_s() <= PEER_SILENT_S and now_s - me.peer.heard_of(me.robot_id) <= PEER_SILENT_S


@pytest.mark.parametrize("cut", [{("a", "b"), ("b", "a")}, {("a", "b")}, {("b", "a")}])
def test_who_is_cut_off_either_way_is_known_to_be_silent_on_both_sides(cut: set[tuple[str, str]]) -> None:
    world = World(delay_s=(0.002, 0.002))
    world.run(1.0)
    assert alive(world.a)
    assert alive(world.b)
    world.network.cut = cut
    world.run(PEER_SILENT_S + 2 * TICK_S)
    assert not alive(world.a)
    assert not alive(world.b)
    world.run(30.0)
    assert not alive(world.a)
    assert not alive(world.b)
    world.network.cut = set()
    world.run(4 * TICK_S)
    assert alive(world.a)
    assert alive(world.b)


def test_what_the_other_has_heard_is_told_by_the_stamp_of_the_sample() -> None:
    world = World(delay_s=(0.002, 0.002), offsets_s=(50.0, 7000.0))
    world.run(1.0)
    heard_s = world.a.peer.heard_of(1)
    assert heard_s in {world.a.clock.at(true_s) for true_s in world.a.told.values()}
    assert world.a.clock.now() - heard_s < 3 * TICK_S
    assert world.a.peer.heard_of(2) == -math.inf


def test_a_restart_is_noticed_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    world = World(delay_s=(0.002, 0.002))
    world.run(1.0)
    before = world.a.peer.sample()
    assert before is not None
    with caplog.at_level(logging.WARNING):
        world.restart_b()
        world.run(1.0)
    assert [record.getMessage() for record in caplog.records] == ["process 'b' has been started anew"]
    after = world.a.peer.sample()
    assert after is not None
    assert after.x_m > before.x_m
    assert alive(world.a)
    assert alive(world.b)
    assert world.a.peer.found() is None, "a new clock is no fault"


def test_late_words_of_an_ended_start_are_not_taken_for_the_one_that_lives() -> None:
    world = World(delay_s=(0.002, 0.002))
    late: list[bytes] = []
    MemoryBus(world.network, "spy").subscribe("soter/b/status", lambda _, data: late.append(data))
    world.run(1.0)
    world.restart_b()
    world.run(1.0)
    world.a.peer_group.look()
    before = world.a.peer.sample()
    assert before is not None
    serial = decode_status(late[18]).serial
    stale = msgspec.structs.replace(decode_status(late[18]), serial=serial + 1000)
    MemoryBus(world.network, "b").publish("soter/b/status", encode(stale))
    world.network.advance(world.network.now_s + 0.003)
    world.a.peer_group.look()
    assert world.a.peer.sample() == before
    assert alive(world.a)
    assert world.a.peer_group.others["b"].starts == 2


def test_of_two_processes_with_one_name_no_sample_is_taken_for_younger_than_it_is(
    caplog: pytest.LogCaptureFixture,
) -> None:
    world = World(delay_s=(0.002, 0.002))
    world.run(1.0)
    twin = Process(world.network, "b", "a", 2, 500.0, 1.0)
    twin.where_m, twin.age_s = 50.0, 1.5  # it hears of its robot late
    with caplog.at_level(logging.WARNING):
        for process in (world.a, world.b, twin) * 40:
            process.tick()
            world.network.advance(world.network.now_s + TICK_S / 3)
            sample = world.a.peer.sample()
            assert sample is not None
            sound(world.a, world.b if sample.x_m < 50.0 else twin)
    assert [record.getMessage() for record in caplog.records] == ["process 'b' has been started anew"]
    assert alive(world.a), "the other one tells where the robot is"
    assert world.b.peer_group.has_duplicate()
    assert twin.peer_group.has_duplicate()


def test_a_peer_that_moves_too_fast_is_found_out_by_its_own_stamps() -> None:
    world = World(delay_s=(0.0, 0.3))
    world.run(2.0)
    assert world.a.peer.found() is None, "late messages make nobody look fast"
    world.b.where_m += 1.0
    world.run(1.0)
    found = world.a.peer.found()
    assert found is not None
    assert found.assumption is Assumption.PEERS
    assert world.a.peer.found() is None


@pytest.mark.parametrize("rates", [(1.0, 1.02), (1.0, 0.98), (1.005, 0.995)])
def test_clocks_that_go_apart_faster_than_is_allowed_for_are_found_out(rates: tuple[float, float]) -> None:
    world = World(delay_s=(0.002, 0.002), rates=rates)
    world.run(10.0)
    for process in (world.a, world.b):
        found = process.peer.found()
        assert found is not None
        assert found.assumption is Assumption.CLOCK
        assert "went apart by" in found.cause


def test_a_host_that_sleeps_is_found_out_by_its_peer_and_by_itself() -> None:
    world = World(delay_s=(0.002, 0.002))
    world.run(1.0)
    world.b.clock.skip(-0.3)
    world.run(0.3)
    for process in (world.a, world.b):
        found = process.peer.found()
        assert found is not None
        assert found.assumption is Assumption.CLOCK


def test_a_peer_whose_stamps_go_back_is_found_out_and_not_believed() -> None:
    world = World(delay_s=(0.002, 0.002))
    world.run(1.0)
    world.b.age_s = 0.4
    world.a.peer.found()
    world.run(0.2)
    found = world.a.peer.found()
    assert found is not None
    assert found.assumption is Assumption.CLOCK
    sound(world.a, world.b)


def test_a_port_of_another_process_shows_and_takes_nothing() -> None:
    world = World()
    world.run(1.0)
    port = world.a.peer.port
    assert port.engaged
    assert port.state is not None
    assert port.state.robot_id == 2
    port.goto(Waypoint(1.0, 1.0))
    assert port.take() is None


def test_another_process_of_the_same_name_is_told_from_what_an_earlier_start_has_left_behind() -> None:
    world = World()
    bus, peer_group = MemoryBus(world.network, "c"), world.a.peer_group
    for serial in range(40):
        bus.publish("soter/a/status", encode(Status("a", 999, MISSION, serial, serial * TICK_S)))
    world.run(1.0)
    assert not peer_group.has_duplicate(), "all of it came at once"
    for serial in range(10):
        bus.publish("soter/a/status", encode(Status("a", 888, MISSION, serial, serial * TICK_S)))
        world.run(TICK_S)
    assert peer_group.has_duplicate()
    assert not world.b.peer_group.has_duplicate()


def test_another_mission_and_garbage_are_noticed(caplog: pytest.LogCaptureFixture) -> None:
    world = World()
    world.run(1.0)
    bus, peer_group = MemoryBus(world.network, "c"), world.a.peer_group
    for data in (b"garbage", b"", b"\xc1" * 99):
        bus.publish("soter/b/status", data)
    bus.publish("soter/c/status", encode(Status("c", 999, MISSION, 1, 0.0)))
    stranger = RobotStatus(state(7), True, "", False)
    bus.publish("soter/b/status", encode(Status("b", 999, MISSION, 1, 0.0, (stranger,))))
    world.network.advance(world.network.now_s + 0.01)
    peer_group.look()
    assert peer_group._inbox.garbage == 3
    assert peer_group.others["b"].strangers == 1
    bus.publish("soter/b/status", encode(Status("b", 999, "another", 1, 0.0)))
    world.network.advance(world.network.now_s + 0.01)
    peer_group.look()
    assert "another mission" in peer_group.missing(0.0)["b"]
    assert sum("no message of SOTER" in record.getMessage() for record in caplog.records) == 1
    assert sum("runs another mission" in record.getMessage() for record in caplog.records) == 1


GOOD = state(1)


@pytest.mark.parametrize("bad", [
    Status("a", 1, MISSION, 1, math.nan),
    Status("a", 1, MISSION, -1, 0.0),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(x_m=math.nan), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(vx_m_s=math.inf), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(y_m=1e6), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(battery=1.5), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(stamp_s=9.0), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD._replace(stamp_s=math.nan), True, "", False),)),
    Status("a", 1, MISSION, 1, 0.0, (RobotStatus(GOOD, True, "", False),) * 65),
    Status("a", 1, MISSION, 1, 0.0, (), (Echo("b", 1, math.inf, 0.0),)),
    Status("a", 1, MISSION, 1, 0.0, (), (Echo("b", 1, 0.0, -1.0),)),
    Status("a" * 99999, 1, MISSION, 1, 0.0),
])  # fmt: skip
def test_a_status_that_cannot_be_meant_is_garbage(bad: Status) -> None:
    with pytest.raises(Garbage):
        decode_status(encode(bad))


@given(st.binary(max_size=300))
def test_no_bytes_do_more_than_being_refused(data: bytes) -> None:
    try:
        decode_status(data)
    except Garbage:
        return
