"""The clock of a vehicle: measured by round trips, at any speed-up, and learned anew after a reboot."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.sampling import TimeSync
from soter.clock import VehicleClock
from tests.adapters.mavlink.puppet import HostTime


class Rig:
    """A vehicle whose clock runs `rate` times as fast as the host's, behind a link with delays."""

    def __init__(self, rate: float = 1.0) -> None:
        self.time = HostTime()
        self.rate = rate
        self.clock = VehicleClock(rate=rate, rate_tolerance=0.2, steady=self.time, sleep=self.time.sleep)
        self.inbox = Inbox()
        self.sync = TimeSync(1, self.clock, self.inbox)
        self.booted_s = self.time.now_s - 50.0

    @property
    def vehicle_s(self) -> float:
        return (self.time.now_s - self.booted_s) * self.rate

    def sample(self, message: str = "LOCAL_POSITION_NED") -> None:
        """Let the vehicle send a sample, which arrives at once."""
        self.inbox.put(message, SimpleNamespace(time_boot_ms=round(self.vehicle_s * 1e3)), self.time())

    def ask(self, there_s: float = 0.001, back_s: float = 0.001) -> None:
        """Ask for the time; the answer arrives."""
        fields = self.sync.request()
        self.time.now_s += there_s
        answer = SimpleNamespace(tc1=round(self.vehicle_s * 1e9), ts1=fields["ts1"])
        self.time.now_s += back_s
        self.inbox.put("TIMESYNC", answer, self.time())

    def settle(self, times: int = 6) -> None:
        for _ in range(times):
            self.sample()
            self.ask()
            self.time.now_s += 0.05

    @property
    def off_s(self) -> float:
        """How far the vehicle's clock is from what is believed of it."""
        believed_s = self.sync.to_vehicle_s(self.clock.now())
        assert believed_s is not None
        return believed_s - self.vehicle_s


@pytest.mark.parametrize("rate", [1.0, 4.0])
def test_the_clock_is_known_within_half_a_round_trip(rate: float) -> None:
    rig = Rig(rate)
    assert rig.sync.to_fleet_s(1.0) is None
    rig.settle()
    assert rig.sync.settled
    assert abs(rig.off_s) <= 0.0011 * rate
    # Slow answers, all of the delay on one side, are not believed.
    for _ in range(10):
        rig.sample()
        rig.ask(there_s=0.0, back_s=0.3)
    assert abs(rig.off_s) <= 0.01 * rate


def test_the_clock_is_known_before_the_vehicle_knows_where_it_is() -> None:
    rig = Rig()
    for _ in range(6):
        rig.sample("ATTITUDE")
        rig.ask()
        rig.time.now_s += 0.05
    assert rig.sync.settled
    assert abs(rig.off_s) <= 0.0011


def test_an_answer_that_comes_at_once_is_an_answer_whatever_marks_it_as_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    for token in (0, 1, 2048, 4095):
        monkeypatch.setattr("soter.adapters.mavlink.sampling.secrets.randbelow", lambda _, token=token: token)
        rig = Rig()
        for _ in range(6):
            rig.sample()
            rig.ask(there_s=0.0, back_s=0.0)
        assert rig.sync.settled
        assert abs(rig.off_s) <= 1e-5


def test_answers_to_others_are_not_ours() -> None:
    rig = Rig()
    rig.settle()
    before = rig.sync.to_vehicle_s(0.0)
    ours = rig.sync.request()["ts1"]
    for tc1, ts1 in (
        (0, ours),
        (10**9, ours + 1),
        (round(rig.vehicle_s * 1e9) + 10**10, ours),
        (10**9, ours + (1 << 40)),
    ):
        rig.inbox.put("TIMESYNC", SimpleNamespace(tc1=tc1, ts1=ts1), rig.time())
    assert rig.sync.to_vehicle_s(0.0) == before


def test_a_clock_that_stood_still_is_learned_anew_at_once() -> None:
    rig = Rig()
    rig.settle()
    rig.booted_s += 0.3
    rig.sample()
    assert rig.off_s == pytest.approx(0.3, abs=0.005)
    rig.ask()
    assert abs(rig.off_s) <= 0.002
    assert rig.sync.reboots == 0


def test_a_slow_answer_after_a_standstill_makes_no_sample_look_younger_than_it_is() -> None:
    rig = Rig()
    rig.settle(30)
    rig.booted_s += 0.3
    rig.sync._trips_s.clear()
    rig.ask(there_s=0.001, back_s=0.06)
    assert rig.off_s >= -0.002
    rig.settle(4)
    assert abs(rig.off_s) <= 0.002


def test_a_reboot_is_seen_by_the_first_sample_after_it() -> None:
    rig = Rig()
    rig.settle()
    rig.booted_s = rig.time.now_s - 0.2
    rig.sample()
    assert rig.sync.reboots == 1
    assert not rig.sync.settled
    assert rig.sync.to_fleet_s(0.2) is None
    rig.settle()
    assert abs(rig.off_s) <= 0.002


def test_two_vehicles_on_one_line_are_no_row_of_reboots(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig()
    rig.settle()
    first_s = rig.booted_s
    for number in range(60):
        rig.booted_s = first_s + (30.0 if number % 2 else 0.0)
        rig.time.now_s += 0.05
        rig.sample()
    assert rig.sync.two
    assert [record.message for record in caplog.records].count(
        "robot 1: two vehicles with its system id are heard; give each one of its own"
    ) == 1
    assert len(caplog.records) <= 4
    rig.time.now_s += 20.0
    rig.booted_s = rig.time.now_s - 0.1
    rig.sample()
    assert not rig.sync.two


def test_what_was_overtaken_is_no_reboot() -> None:
    rig = Rig()
    rig.settle()
    rig.inbox.put("LOCAL_POSITION_NED", SimpleNamespace(time_boot_ms=round((rig.vehicle_s - 0.5) * 1e3)), rig.time())
    assert rig.sync.reboots == 0
    assert rig.sync.settled


def test_samples_that_a_link_has_held_back_are_no_reboots_and_no_second_vehicle() -> None:
    rig = Rig()
    rig.settle(40)
    for number in range(60):
        # From here on samples come at once, beside those that were sent up to 1.5 s before them.
        rig.time.now_s += 1.5 if number == 0 else 0.05
        rig.sample()
        if number < 30:
            late_s = rig.vehicle_s - 1.45
            rig.inbox.put("ATTITUDE", SimpleNamespace(time_boot_ms=round(late_s * 1e3)), rig.time())
        rig.ask()
    assert (rig.sync.reboots, rig.sync.two) == (0, False)
    assert abs(rig.off_s) <= 0.002
    rig.booted_s = rig.time.now_s - 0.2
    rig.sample()
    assert rig.sync.reboots == 1


def test_a_second_vehicle_that_booted_a_little_earlier_is_not_taken_for_samples_held_back_for_long() -> None:
    rig = Rig()
    rig.settle()
    first_s = rig.booted_s
    for number in range(300):
        rig.booted_s = first_s - (5.0 if number % 2 else 0.0)
        rig.time.now_s += 0.05
        rig.sample()
    assert rig.sync.two


def test_who_does_not_answer_is_timed_by_samples() -> None:
    rig = Rig()
    for _ in range(20):
        rig.sync.request()
        rig.time.now_s += 0.05
        rig.sample()
    assert rig.sync.settled
    assert abs(rig.off_s) <= 0.002
