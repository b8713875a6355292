from __future__ import annotations

import random
from itertools import count, pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from soter.distribution.channel import (
    ALIVE_S,
    MAX_MESSAGES,
    MAX_WAITING,
    REPEAT_S,
    Came,
    Channel,
    ChannelFrame,
    ReliableMessage,
    VisitMessage,
    decode_frame,
)
from soter.errors import Garbage
from soter.isolation.messages import encode

TICK_S = 0.05
MISSION = "a mission"


def message(number: int) -> VisitMessage:
    return VisitMessage(1, number, 0.0, 0.0, None, 3)


class End:
    """A process that may start anew; what it sends is numbered over all of its starts.

    Attributes:
        heard: by start of this process, and then by start of the other: numbers of the letters that came.
    """

    def __init__(self, draw: random.Random) -> None:
        self._draw = draw
        self._epochs: list[int] = []
        self.numbers = count(1)
        self.heard: list[list[list[int]]] = []
        self.sent: list[int] = []
        self.restart()

    def restart(self) -> None:
        epoch = self._draw.getrandbits(61) + 1
        self.channel = Channel(epoch, MISSION, lambda: self._draw.getrandbits(61) + 1)
        self.heard.append([])

    def say(self) -> None:
        """Say one thing, if there is anybody to say it to."""
        number = next(self.numbers)
        if self.channel.there:
            self.sent.append(number)
        self.channel.send(message(number))

    def take(self, frame: ChannelFrame) -> None:
        for each in self.channel.take(frame):
            if isinstance(each, Came):
                self.heard[-1].append([])
                # Letters to whoever was there before are gone.
                self.sent.clear()
            else:
                assert isinstance(each, VisitMessage)
                self.heard[-1][-1].append(each.target_id)


class Air:
    """Two ends, and a bus that does to frames what the test says."""

    def __init__(self, seed: int = 0, *, loss: float = 0.0, twice: float = 0.0, latest_s: float = 0.0) -> None:
        self.draw = random.Random(seed)
        self.loss, self.twice, self.latest_s = loss, twice, latest_s
        self.cut = {0: False, 1: False}
        self.now_s = 0.0
        self.ends = (End(self.draw), End(self.draw))
        self._under_way: list[tuple[float, int, ChannelFrame]] = []

    def tick(self) -> None:
        for index, end in enumerate(self.ends):
            for frame in end.channel.due(self.now_s):
                assert decode_frame(encode(frame)) == frame
                if self.cut[index] or self.draw.random() < self.loss:
                    continue
                for _ in range(2 if self.draw.random() < self.twice else 1):
                    self._under_way.append((self.now_s + self.draw.uniform(0.0, self.latest_s), 1 - index, frame))
        self.now_s += TICK_S
        arrived = [each for each in self._under_way if each[0] <= self.now_s]
        self._under_way = [each for each in self._under_way if each[0] > self.now_s]
        self.draw.shuffle(arrived)
        for _, index, frame in arrived:
            self.ends[index].take(frame)

    def heal(self) -> None:
        """Let everything arrive, long enough for all that is still to be said."""
        self.loss, self.cut = 0.0, {0: False, 1: False}
        for _ in range(round((self.latest_s + 5.0) / TICK_S)):
            self.tick()


def rising(numbers: list[int]) -> bool:
    return all(one < other for one, other in pairwise(numbers))


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("say"), st.integers(0, 1)),
        st.tuples(st.just("restart"), st.integers(0, 1)),
        st.tuples(st.just("cut"), st.integers(0, 1)),
        st.tuples(st.just("mend"), st.integers(0, 1)),
        st.tuples(st.just("wait"), st.integers(1, 40)),
    ),
    max_size=60,
)


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(
    STEPS, st.integers(0, 2**32), st.sampled_from([0.0, 0.3, 0.8]), st.sampled_from([0.0, 0.5]),
    st.sampled_from([0.0, 0.3, 3.0]),
)  # fmt: skip
def test_letters_arrive_once_in_order_whatever_the_bus_does(
    steps: list[tuple[str, int]], seed: int, loss: float, twice: float, latest_s: float
) -> None:
    air = Air(seed, loss=loss, twice=twice, latest_s=latest_s)
    for what, number in steps:
        if what == "wait":
            for _ in range(number):
                air.tick()
            continue
        if what == "say":
            air.ends[number].say()
        elif what == "restart":
            air.ends[number].restart()
            air.ends[number].sent.clear()
        else:
            air.cut[number] = what == "cut"
        air.tick()
    air.heal()
    for end, other in (air.ends, air.ends[::-1]):
        assert all(rising(numbers) for start in end.heard for numbers in start), "once and in order"
        assert end.channel.there
        assert end.heard[-1][-1][-len(other.sent) or len(end.heard[-1][-1]) :] == other.sent, "nothing was lost"


def test_who_starts_anew_is_told_from_who_was_cut_off() -> None:
    air = Air()
    air.heal()
    one, other = air.ends
    assert one.heard == [[[]]]
    assert other.heard == [[[]]]
    air.cut = {0: True, 1: True}
    one.say()
    for _ in range(200):
        air.tick()
    air.heal()
    assert other.heard == [[[1]]], "the same start: the letter was kept"
    other.restart()
    one.say()
    air.heal()
    assert other.heard == [[[1]], [[]]], "what was meant for the earlier start is gone"
    assert one.heard == [[[], []]]
    one.say()
    air.heal()
    assert other.heard[-1] == [[3]]


def test_late_frames_of_an_ended_start_change_nothing() -> None:
    air = Air()
    air.heal()
    one, other = air.ends
    one.say()
    stale = one.channel.due(air.now_s)
    one.restart()
    air.heal()
    one.say()
    air.heal()
    assert other.heard == [[[], [2]]]
    for _ in range(3):
        for frame in stale:
            other.take(frame)
        air.heal()
    one.say()
    air.heal()
    assert other.heard == [[[], [2, 3]]]


def test_an_idle_channel_says_that_it_is_alive_and_little_more() -> None:
    air = Air()
    air.heal()
    frames = 0
    for _ in range(200):
        frames += len(air.ends[0].channel.due(air.now_s))
        air.now_s += TICK_S
    assert frames == round(200 * TICK_S / ALIVE_S)


def test_what_is_not_acknowledged_is_repeated_and_many_letters_go_in_several_frames() -> None:
    air = Air()
    air.heal()
    one, other = air.ends
    for _ in range(MAX_MESSAGES + 3):
        one.say()
    first = one.channel.due(air.now_s)
    assert [len(frame.messages) for frame in first] == [MAX_MESSAGES]
    assert one.channel.due(air.now_s + REPEAT_S / 2) == []
    assert one.channel.due(air.now_s + REPEAT_S) == first
    air.heal()
    assert other.heard == [[list(range(1, MAX_MESSAGES + 4))]]


def test_a_message_to_nobody_is_dropped_and_too_many_are_refused() -> None:
    channel = Channel(1, MISSION, lambda: 2)
    channel.send(message(1))
    (frame,) = channel.due(0.0)
    assert frame.messages == ()
    air = Air()
    air.heal()
    for _ in range(MAX_WAITING):
        air.ends[0].say()
    with pytest.raises(OverflowError, match="1000 messages"):
        air.ends[0].say()


def test_another_mission_is_not_talked_to() -> None:
    mine, theirs = Channel(1, MISSION, lambda: 2), Channel(3, "another", lambda: 4)
    for tick in range(100):
        for frame in theirs.due(tick * TICK_S):
            assert mine.take(frame) == []
    assert not mine.there
    assert mine.foreign == "another"


@given(st.binary(max_size=200))
def test_garbage_is_refused(data: bytes) -> None:
    try:
        frame = decode_frame(data)
    except Garbage:
        return
    messages: tuple[ReliableMessage, ...] = frame.messages
    assert len(messages) <= MAX_MESSAGES


@pytest.mark.parametrize("bad", [
    ChannelFrame(1, 2, MISSION, messages=(VisitMessage(1, 2, float("nan"), 0.0, None, 3),)),
    ChannelFrame(1, 2, MISSION, messages=(VisitMessage(1, 2, 1e9, 0.0, None, 3),)),
    ChannelFrame(-1, 2, MISSION),
    ChannelFrame(1, 2, "x" * 1000),
    ChannelFrame(1, 2, MISSION, messages=(message(1),) * (MAX_MESSAGES + 1)),
    ChannelFrame(1, 2, MISSION, messages=(message(1),) * 5000),
])  # fmt: skip
def test_what_was_not_agreed_is_garbage(bad: ChannelFrame) -> None:
    with pytest.raises(Garbage):
        decode_frame(encode(bad))
