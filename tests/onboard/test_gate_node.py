"""The gate at work, with a host's clock that the test moves."""

from __future__ import annotations

import pytest

from soter.onboard.gate_node import GateNode
from soter.onboard.velocity import REST, Velocity, VelocityGate
from soter.onboard.wire import AC, SC, GateReport, Order

AHEAD = Velocity(0.2, 0.0)


class Bench(GateNode):
    """A station that keeps what it says."""

    def __init__(self, rate: float = 1.0) -> None:
        self.host_s = 50.0
        super().__init__(VelocityGate(0.13, 0.25, 0.22, 2.84), rate, lambda: self.host_s)
        self.clock_s: float | None = 1000.0
        self.passed: list[Velocity] = []
        self.reports: list[GateReport] = []
        self._seq = 0

    def order(self, controller: str, renewed_s: float | None) -> None:
        self._seq += 1
        self.hear_order(Order("me", self._seq, controller, renewed_s).encode())

    def _clock_s(self) -> float | None:
        return self.clock_s

    def _pass_on(self, velocity: Velocity) -> None:
        self.passed.append(velocity)

    def _say(self, report: str) -> None:
        self.reports.append(GateReport.decode(report))


def test_what_is_ordered_and_asked_for_passes_at_once_and_is_reported() -> None:
    bench = Bench()
    bench.look()
    assert (bench.passed, bench.reports) == ([REST], [])
    bench.order(AC, 1000.0)
    assert bench.reports == [GateReport("me", 1, AC, alive=True)]
    bench.hear(SC, AHEAD)
    assert bench.passed[-1] == REST
    bench.hear(AC, AHEAD)
    assert bench.passed[-1] == AHEAD
    assert len(bench.reports) == 2
    bench.host_s += 0.129
    bench.look()
    assert bench.passed[-1] == AHEAD
    bench.host_s += 0.002
    bench.look()
    assert bench.passed[-1] == REST
    assert bench.reports[-1] == GateReport("me", 1, AC, alive=False)


def test_in_a_world_that_runs_faster_a_lease_dies_sooner() -> None:
    bench = Bench(rate=2.0)
    bench.order(SC, 1000.0)
    bench.hear(SC, AHEAD)
    bench.host_s += 0.064
    bench.look()
    assert bench.passed[-1] == AHEAD
    bench.host_s += 0.002
    bench.look()
    assert bench.passed[-1] == REST


def test_without_a_clock_and_after_a_wait_nothing_is_renewed() -> None:
    bench = Bench()
    bench.clock_s = None
    bench.order(SC, 1000.0)
    bench.hear(SC, AHEAD)
    assert bench.passed[-1] == REST
    bench.clock_s = 1000.2
    bench.order(SC, 1000.0)
    assert bench.passed[-1] == REST


def test_what_is_no_order_changes_nothing_and_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    bench.order(SC, 1000.0)
    bench.hear(SC, AHEAD)
    before = [*bench.passed]
    nonsense: tuple[str | bytes, ...] = (
        '{"session": "me", "seq": 9, "controller": "both", "renewed_s": 1000.0}',
        '{"session": "me", "seq": 9' + "9" * 400 + "}", "[" * 2000, "[" * 100_000, b"\xff\xfe", "",
    )  # fmt: skip
    for each in nonsense:
        bench.hear_order(each)
    assert bench.passed == before
    assert bench.senseless == len(nonsense)
    assert [record.message for record in caplog.records] == [
        "dropped an order that makes no sense: controller is 'both', allowed: AC or SC"
    ]
    # Nor does one that came before.
    bench.hear_order(Order("me", 1, AC, 1000.0).encode())
    assert bench.passed == before
