"""What viewers are told: everything, in order, at their own pace; who is too slow is told so."""

from __future__ import annotations

import threading

import pytest

from soter.live.reel import FellBehind, Reel


def test_everybody_hears_everything_in_order() -> None:
    reel = Reel()
    for part in (b"a", b"b", b"c"):
        reel.add(part)
    assert reel.after(0, 0.0) == ([b"a", b"b", b"c"], False)
    assert reel.after(2, 0.0) == ([b"c"], False)
    assert reel.after(3, 0.0) == ([], False)


def test_who_falls_behind_by_more_than_is_kept_is_told_so() -> None:
    reel = Reel(most_bytes=10)
    for number in range(5):
        reel.add(b"%04d" % number)
    assert reel.count == 5
    assert reel.after(3, 0.0) == ([b"0003", b"0004"], False)
    with pytest.raises(FellBehind):
        reel.after(2, 0.0)


def test_a_part_that_never_was_is_not_waited_for() -> None:
    with pytest.raises(FellBehind):
        Reel().after(7, 10.0)


def test_one_part_is_kept_however_large_it_is() -> None:
    reel = Reel(most_bytes=2)
    reel.add(b"large")
    assert reel.after(0, 0.0) == ([b"large"], False)


def test_who_waits_is_woken_by_the_next_part_and_by_the_end() -> None:
    reel = Reel()
    heard: list[tuple[list[bytes], bool]] = []
    waiting = threading.Thread(target=lambda: heard.extend([reel.after(0, 60.0), reel.after(1, 60.0)]))
    waiting.start()
    reel.add(b"a")
    reel.end()
    waiting.join(30.0)
    assert heard[0][0] == [b"a"]
    assert heard[1] == ([], True)
