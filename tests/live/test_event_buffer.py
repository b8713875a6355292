"""What viewers are told: everything, in order, at their own pace; who is too slow is told so."""

from __future__ import annotations

import threading

import pytest

from soter.live.event_buffer import EventBuffer, FellBehind


def test_everybody_hears_everything_in_order() -> None:
    events = EventBuffer()
    for part in (b"a", b"b", b"c"):
        events.add(part)
    assert events.after(0, 0.0) == ([b"a", b"b", b"c"], False)
    assert events.after(2, 0.0) == ([b"c"], False)
    assert events.after(3, 0.0) == ([], False)


def test_who_falls_behind_by_more_than_is_kept_is_told_so() -> None:
    events = EventBuffer(most_bytes=10)
    for number in range(5):
        events.add(b"%04d" % number)
    assert events.count == 5
    assert events.after(3, 0.0) == ([b"0003", b"0004"], False)
    with pytest.raises(FellBehind):
        events.after(2, 0.0)


def test_a_part_that_never_was_is_not_waited_for() -> None:
    with pytest.raises(FellBehind):
        EventBuffer().after(7, 10.0)


def test_one_part_is_kept_however_large_it_is() -> None:
    events = EventBuffer(most_bytes=2)
    events.add(b"large")
    assert events.after(0, 0.0) == ([b"large"], False)


def test_who_waits_is_woken_by_the_next_part_and_by_the_end() -> None:
    events = EventBuffer()
    heard: list[tuple[list[bytes], bool]] = []
    waiting = threading.Thread(target=lambda: heard.extend([events.after(0, 60.0), events.after(1, 60.0)]))
    waiting.start()
    events.add(b"a")
    events.end()
    waiting.join(30.0)
    assert heard[0][0] == [b"a"]
    assert heard[1] == ([], True)
