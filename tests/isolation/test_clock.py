"""Fleet time as the mission sees it."""

from __future__ import annotations

import pytest

from soter.isolation.mission_end import FollowedClock


class Host:
    """A host whose time passes only when somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s


def test_it_shows_nothing_before_it_was_told() -> None:
    host = Host()
    clock = FollowedClock(steady=lambda: host.now_s)
    host.sleep(5.0)
    assert clock.now() == 0.0


def test_it_goes_on_at_the_rate_of_what_it_was_told() -> None:
    host = Host()
    clock = FollowedClock(steady=lambda: host.now_s)
    clock.follow(10.0, 50.0)
    host.sleep(0.5)
    assert clock.now() == pytest.approx(10.5)
    clock.follow(12.0, 50.5)
    host.sleep(0.25)
    assert clock.now() == pytest.approx(13.0)


def test_it_never_goes_back() -> None:
    host = Host()
    clock = FollowedClock(steady=lambda: host.now_s)
    clock.follow(10.0, 50.0)
    host.sleep(1.0)
    before_s = clock.now()
    clock.follow(10.2, 51.0)
    assert clock.now() == before_s
    clock.follow(9.0, 51.5)
    host.sleep(0.5)
    assert clock.now() == before_s


def test_what_was_told_later_than_now_counts_from_now() -> None:
    host = Host()
    clock = FollowedClock(steady=lambda: host.now_s)
    clock.follow(10.0, 51.0)
    assert clock.now() == 10.0


def test_it_sleeps_until_a_time() -> None:
    host = Host()
    clock = FollowedClock(steady=lambda: host.now_s, sleep=host.sleep)
    clock.follow(0.0, 50.0)
    clock.sleep_until(1.0)
    assert 1.0 <= clock.now() < 1.3
    assert clock.steady_s() == host.now_s
