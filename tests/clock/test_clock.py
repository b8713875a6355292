from __future__ import annotations

import math
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.clock import VehicleClock, VirtualClock


class Host:
    """The host's steady time, which passes only when a test says so or somebody sleeps."""

    def __init__(self, steady_s: float = 1000.0) -> None:
        self.steady_s = steady_s
        self.slept: list[float] = []

    def read(self) -> float:
        return self.steady_s

    def sleep(self, time_s: float) -> None:
        self.slept.append(time_s)
        self.steady_s += time_s

    def clock(self, rate: float = 1.0, rate_tolerance: float = 2e-4) -> VehicleClock:
        return VehicleClock(rate=rate, rate_tolerance=rate_tolerance, steady=self.read, sleep=self.sleep)


def hear(clock: VehicleClock, host: Host, stamps: list[float], every_s: float = 0.02, robot_id: int = 1) -> list[bool]:
    """Let a robot's samples arrive, one every so often."""
    rebooted = []
    for stamp in stamps:
        host.steady_s += every_s
        rebooted.append(clock.observe(robot_id, stamp, host.steady_s))
    return rebooted


# So short that no five samples in a row arrive behind a newer one: that would be a reboot.
delays = st.lists(st.floats(0.0, 0.08), min_size=2, max_size=60)


def test_a_virtual_clock_stands_still_until_somebody_sleeps() -> None:
    steps: list[float] = []
    clock = VirtualClock(steps.append)
    clock.sleep_until(1.5)
    clock.sleep_until(1.0)
    assert (clock.now(), steps) == (1.5, [1.5])


def test_fleet_time_begins_at_zero_and_needs_no_vehicle() -> None:
    host = Host()
    clock = host.clock()
    assert clock.now() == 0.0
    host.steady_s += 3.0
    assert clock.now() == pytest.approx(3.0)
    assert clock.steady_s() == host.steady_s


def test_sleeping_sleeps_on_the_host_at_the_vehicles_rate() -> None:
    host = Host()
    clock = host.clock(rate=4.0)
    clock.sleep_until(2.0)
    assert clock.now() >= 2.0
    assert sum(host.slept) == pytest.approx(0.5, abs=1e-5)
    slept = len(host.slept)
    clock.sleep_until(1.0)
    assert len(host.slept) == slept


@pytest.mark.parametrize("time_s", [math.nan, math.inf, -math.inf])
def test_nobody_sleeps_for_ever(time_s: float) -> None:
    with pytest.raises(ValueError, match="allowed: finite"):
        Host().clock().sleep_until(time_s)


@pytest.mark.parametrize("options", [{"rate": 0.0}, {"rate": math.inf}, {"rate_tolerance": 1.0}, {"window_s": -1.0},
                                     {"rate": math.nan}, {"rate_tolerance": math.nan}])  # fmt: skip
def test_options_out_of_range_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="allowed:"):
        VehicleClock(**options)  # type: ignore[arg-type]


def test_a_robot_that_was_never_heard_has_no_time() -> None:
    clock = Host().clock()
    with pytest.raises(LookupError, match="robot 7"):
        clock.to_fleet_s(7, 0.0)
    with pytest.raises(LookupError, match="robot 7"):
        clock.to_vehicle_s(7, 0.0)


@given(delays, st.floats(-1e6, 1e6))
def test_the_offset_is_that_of_the_sample_that_travelled_least(delays_s: list[float], began_s: float) -> None:
    """However the delays come: stamps are later than the truth by no more than the least delay and the drift."""
    host = Host()
    clock = host.clock()
    arrivals = sorted((0.02 * k + delay, 0.02 * k) for k, delay in enumerate(delays_s))
    for arrival_s, sent_s in arrivals:
        host.steady_s = 1000.0 + arrival_s
        clock.observe(1, began_s + sent_s, host.steady_s)
    # What came late behind something newer tells nothing.
    newest = -math.inf
    least_s = math.inf
    for arrival_s, sent_s in arrivals:
        if sent_s >= newest:
            newest, least_s = sent_s, min(least_s, arrival_s - sent_s)
    error_s = clock.to_fleet_s(1, began_s) - 0.0
    assert least_s - 1e-6 <= error_s <= least_s + 2e-4 * 2.0 + 1e-6
    assert clock.to_vehicle_s(1, clock.to_fleet_s(1, began_s + 1.0)) == pytest.approx(began_s + 1.0)


@given(st.lists(st.tuples(st.floats(0.0, 2.0), st.floats(-50.0, 50.0)), max_size=80), st.floats(0.0, 0.9))
def test_whatever_is_heard_fleet_time_goes_on_and_no_sample_is_from_the_future(
    heard: list[tuple[float, float]], tolerance: float
) -> None:
    host = Host()
    clock = host.clock(rate_tolerance=tolerance)
    stamp_s = 0.0
    for wait_s, step_s in heard:
        before_s = clock.now()
        host.steady_s += wait_s
        stamp_s += step_s
        newest_before_s = clock.now()
        clock.observe(1, stamp_s, host.steady_s)
        after_s = clock.now()
        assert after_s >= newest_before_s
        assert after_s - before_s >= wait_s * (1.0 - tolerance) - 1e-9
        assert 1.0 - tolerance - 1e-12 <= clock.rate <= 1.0 + tolerance + 1e-12


@given(st.lists(st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.2)), min_size=1, max_size=80))
def test_a_sample_that_was_heard_is_never_from_the_future(heard: list[tuple[float, float]]) -> None:
    host = Host()
    clock = host.clock()
    stamp_s = 5.0
    for wait_s, step_s in heard:
        host.steady_s += wait_s
        stamp_s += step_s
        clock.observe(1, stamp_s, host.steady_s)
        assert clock.to_fleet_s(1, stamp_s) <= clock.now() + 1e-9


def test_a_link_that_becomes_slow_shows_as_age() -> None:
    host = Host()
    clock = host.clock()
    hear(clock, host, [0.02 * k for k in range(100)])
    stamps = [2.0 + 0.02 * k for k in range(3000)]
    host.steady_s += 0.3
    for stamp in stamps:
        host.steady_s += 0.02
        clock.observe(1, stamp, host.steady_s)
    # After a minute most of the delay must still be seen.
    assert clock.now() - clock.to_fleet_s(1, stamps[-1]) > 0.26


def test_the_rate_follows_a_vehicle_whose_clock_is_slow() -> None:
    host = Host()
    clock = host.clock(rate=5.0, rate_tolerance=0.5)
    hear(clock, host, [4.0 * 0.02 * k for k in range(2000)])
    assert clock.rate == pytest.approx(4.0, rel=1e-6)
    before_s = clock.now()
    host.steady_s += 1.0
    assert clock.now() - before_s == pytest.approx(4.0)


def test_the_rate_is_that_of_the_robot_in_the_middle() -> None:
    host = Host()
    clock = host.clock(rate_tolerance=0.1)
    for k in range(1000):
        host.steady_s += 0.02
        for robot_id, rate in ((1, 0.99), (2, 1.02), (3, 1.01)):
            clock.observe(robot_id, rate * 0.02 * k, host.steady_s)
    assert clock.rate == pytest.approx(1.01)


def test_the_rate_stays_when_nobody_is_heard_any_more() -> None:
    host = Host()
    clock = host.clock(rate_tolerance=0.1)
    hear(clock, host, [1.05 * 0.02 * k for k in range(1000)])
    host.steady_s += 1000.0
    clock.observe(2, 0.0, host.steady_s)
    assert clock.rate == pytest.approx(1.05)


def test_a_clock_that_goes_back_and_stays_there_is_a_reboot() -> None:
    host = Host()
    clock = host.clock()
    hear(clock, host, [100.0 + 0.02 * k for k in range(50)])
    assert hear(clock, host, [0.02 * k for k in range(6)]) == [False] * 4 + [True, False]
    assert clock.to_fleet_s(1, 0.1) == pytest.approx(clock.now(), abs=1e-3)


def test_until_a_reboot_is_sure_stamps_are_old_and_never_young() -> None:
    host = Host()
    clock = host.clock()
    hear(clock, host, [100.0 + 0.02 * k for k in range(50)])
    hear(clock, host, [0.0, 0.02])
    assert clock.now() - clock.to_fleet_s(1, 0.02) > 100.0


def test_what_comes_late_or_twice_is_no_reboot() -> None:
    host = Host()
    clock = host.clock()
    hear(clock, host, [0.02 * k for k in range(50)])
    offset_s = clock.to_fleet_s(1, 0.0)
    assert not any(hear(clock, host, [0.98, 0.1, 0.98, 0.1, 0.98, 0.1, 0.2, 0.3, 1.1, 0.4, 0.5, 0.6, 0.7, 0.5]))
    assert clock.to_fleet_s(1, 0.0) == pytest.approx(offset_s, abs=1e-3)


def test_a_reboot_that_stamps_do_not_show_can_be_told() -> None:
    host = Host()
    clock = host.clock()
    hear(clock, host, [0.02, 0.04])
    host.steady_s += 5.0
    clock.forget(1)
    clock.forget(2)
    with pytest.raises(LookupError, match="robot 1"):
        clock.to_fleet_s(1, 0.0)
    hear(clock, host, [0.5])
    assert clock.to_fleet_s(1, 0.5) == pytest.approx(clock.now())


def test_a_measured_delay_is_taken_off() -> None:
    host = Host()
    clock = host.clock()
    host.steady_s += 0.5
    clock.observe(1, 7.0, host.steady_s, delay_s=0.2)
    assert clock.to_fleet_s(1, 7.0) == pytest.approx(0.3)


@pytest.mark.parametrize("stamp", [math.nan, math.inf, -math.inf])
def test_a_stamp_that_is_no_time_is_ignored(stamp: float) -> None:
    host = Host()
    clock = host.clock()
    clock.observe(1, 3.0, host.steady_s)
    assert clock.observe(1, stamp, host.steady_s) is False
    assert clock.to_fleet_s(1, 3.0) == pytest.approx(0.0)


def test_threads_agree_on_the_time() -> None:
    """One thread hears samples that change the rate while others read: time goes back for none of them."""
    clock = VehicleClock(rate_tolerance=0.5, window_s=0.01)
    done = threading.Event()
    went_back: list[float] = []

    def read() -> None:
        last = clock.now()
        while not done.is_set():
            now_s = clock.now()
            if now_s < last:
                went_back.append(last - now_s)
            last = now_s

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    stamp_s = 0.0
    until_s = clock.steady_s() + 0.3
    k = 0
    while clock.steady_s() < until_s:
        k += 1
        stamp_s += 1e-4 if k % 2000 < 1000 else 2e-5
        clock.observe(1, stamp_s, clock.steady_s())
    done.set()
    for thread in threads:
        thread.join()
    assert went_back == []
