"""The kit outlives what it judges: crashes, hangs and robots that are not there cost no more than their clauses."""

from __future__ import annotations

import resource
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.conformance import (
    CLAUSES,
    Harness,
    Outcome,
    Overall,
    Record,
    Verdict,
    Workshop,
    find_harness,
    judge,
    kit,
    select,
    try_clause,
)
from soter.errors import BackendError
from soter.sdk import Fleet
from tests.broken.strangers import STRANGERS_ON_WIRE
from tests.broken.table import BROKEN
from tests.conformance.failing import Complaining, Dead, Hanging
from tests.conformance.simulated import SimulatedHarness
from tests.conformance.wire import WireHarness

HERE = "tests.conformance.failing"
SOME = select(["state.start", "goal.cancel", "lifecycle.init"])


def verdicts(record: Record) -> dict[str, str]:
    return {each.clause.id: each.verdict.value for each in record.outcomes}


def reason(record: Record, clause: str) -> str:
    return next(each.reason for each in record.outcomes if each.clause.id == clause)


@pytest.mark.parametrize(("harness", "how"), [("Crashing", "signal SIGSEGV"), ("Exiting", "exit code 7")])
def test_a_crash_fails_its_clause_and_no_other(harness: str, how: str) -> None:
    with Workshop(f"{HERE}:{harness}Harness") as workshop:
        record = workshop.judge(SOME)
    assert verdicts(record) == {
        "lifecycle.init": "PASS",
        "state.start": "PASS",
        "truth.state.start": "PASS",
        "goal.cancel": "FAIL",
        "truth.goal.cancel": "FAIL",
    }
    assert f"ended with {how}" in reason(record, "goal.cancel")
    assert record.overall is Overall.FAILS


def test_what_an_adapter_raises_again_while_it_is_looked_at_is_told_once() -> None:
    record = judge(SimulatedHarness(Complaining), select(["capabilities.unsupported", "goto.radius"]))
    told = reason(record, "capabilities.unsupported")
    assert verdicts(record)["capabilities.unsupported"] == "FAIL"
    assert "LookupError: no active task (raised in Complaining._halt" in told
    assert "index" not in told


class Unwatched(WireHarness):
    """Has nobody who tells the truth."""

    def second(self) -> Fleet:
        fleet = super().second()
        fleet.truth = None
        return fleet

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        raise AssertionError(robot_id)


def test_a_truth_that_is_not_told_hides_nothing_that_was_found() -> None:
    (kind,) = (each for each in STRANGERS_ON_WIRE if each.__name__ == "WaitsForAnswers")
    outcome, _ = try_clause(CLAUSES["link.returns"], Unwatched(kind))
    assert "as a rule: they wait" in outcome.reason


def test_an_adapter_that_opens_more_than_its_process_may_is_told_that_it_closes_nothing() -> None:
    (kind,) = (each for each in BROKEN if each.__name__ == "LogsGoals")
    assert issubclass(kind, SimulatedRobot)
    least, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (len([*Path("/proc/self/fd").iterdir()]) + 50, most))
        # Not by `outcome_of`, which remembers what came of it with files enough.
        outcome, _ = try_clause(CLAUSES[kind.caught_by], SimulatedHarness(kind))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (least, most))
    assert "Too many open files" in outcome.reason
    assert "opened again and again, and not closed" in outcome.reason


def test_what_hangs_outside_of_python_is_killed_and_costs_its_clause() -> None:
    with Workshop(f"{HERE}:StuckHarness", stuck_s=6.0) as workshop:
        record = workshop.judge([CLAUSES["lifecycle.init"], CLAUSES["goal.cancel"]])
    assert verdicts(record) == {"lifecycle.init": "PASS", "goal.cancel": "FAIL"}
    assert "had to be killed after 6 s" in reason(record, "goal.cancel")


def test_what_clauses_leave_behind_does_not_add_up() -> None:
    with Workshop(f"{HERE}:LeakingToDeathHarness") as workshop:
        record = workshop.judge(select(["lifecycle.init", "state.start", "goal.ids", "resources"]))
    assert {key for key, verdict in verdicts(record).items() if verdict == "FAIL"} == {"resources.given_back"}


def test_a_harness_that_cannot_even_be_made_is_refused() -> None:
    with pytest.raises(BackendError, match="ended with signal SIGABRT"):
        Workshop(f"{HERE}:CrashingAtImportHarness")


def test_side_by_side_and_in_this_process_the_same_comes_out() -> None:
    clauses = select(["goal", "deadman", "link.age"])
    heard: list[tuple[str, int]] = []

    def note(outcome: Outcome, record: Record) -> None:
        heard.append((outcome.clause.id, len(record.outcomes)))

    records = [judge(find_harness("kinematic"), clauses)]
    for jobs in (1, 2):
        with Workshop("kinematic", jobs) as workshop:
            assert workshop.jobs == jobs
            records.append(workshop.judge(clauses, note))
    assert len({record.as_dict()["sha256"] for record in records}) == 1
    assert [count for _, count in heard] == [*range(1, len(clauses) + 1)] * 2


def test_robots_side_by_side_are_opened_only_where_the_harness_says_so() -> None:
    with Workshop(f"{HERE}:OneAtATime", 4) as workshop:
        assert workshop.jobs == 1


def test_a_robot_that_is_never_there_costs_two_clauses() -> None:
    record = judge(SimulatedHarness(Dead))
    failed = [each for each in record.outcomes if each.verdict is Verdict.FAIL]
    assert len(failed) == 2
    assert all("nobody answers at tcp://127.0.0.1:1" in each.reason for each in failed)
    rest = {each.reason for each in record.outcomes if each.verdict is Verdict.NOT_TESTED}
    names = " and ".join(each.clause.id for each in failed)
    assert f"no robot was ever ready, as {names} found" in rest
    assert len(record.outcomes) == len(CLAUSES)
    assert record.overall is Overall.FAILS


def test_one_that_never_gets_ready_has_less_time_for_that_than_a_clause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kit, "_START_S", 0.1)
    harness = SimulatedHarness(Hanging)
    harness.connect_timeout_s = 0.05
    record = judge(harness, SOME)
    assert reason(record, "lifecycle.init").startswith("TimeoutError: not done after 0.2 s on the host")
    assert sum(each.host_s for each in record.outcomes) < Harness.clause_limit_s / 10


class ClosedForEver(SimulatedHarness):
    """Its fleets wait, as they are closed, for a thread that nobody ends."""

    def open(self, robots: int) -> Fleet:
        fleet = super().open(robots)
        thread = threading.Thread(target=threading.Event().wait, daemon=True)
        thread.start()
        fleet.close = self.wait_for(thread)  # type: ignore[method-assign]
        return fleet

    @staticmethod
    def wait_for(thread: threading.Thread) -> Callable[[], None]:
        return lambda: thread.join()


def test_what_hangs_is_told_by_where_the_adapter_called_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kit, "CLOSE_LIMIT_S", 0.1)
    outcome, _ = try_clause(CLAUSES["lifecycle.init"], ClosedForEver(SimulatedRobot))
    assert "not done after 0.1 s on the host" in outcome.reason
    assert "raised in ClosedForEver.wait_for" in outcome.reason


def test_a_run_that_is_stopped_has_what_there_is() -> None:
    heard: list[Outcome] = []
    with Workshop("kinematic", stop=lambda: len(heard) >= 2) as workshop:
        record = workshop.judge(SOME, lambda outcome, _: heard.append(outcome))
    assert record.outcomes == tuple(heard)
    assert record.overall is Overall.UNFINISHED


def test_those_that_hang_get_the_time_of_one_to_close(monkeypatch: pytest.MonkeyPatch) -> None:
    passed_s, graces_s = [0.0], []

    def end(worker: Any, grace_s: float = 0.0) -> None:
        graces_s.append(grace_s)
        passed_s[0] += grace_s
        worker._child = None

    with Workshop("kinematic", jobs=3) as workshop:
        for worker in workshop._workers:
            worker.end()
            worker.clause = CLAUSES["goal.cancel"]
        monkeypatch.setattr("soter.conformance.workshop.time", SimpleNamespace(monotonic=lambda: passed_s[0]))
        monkeypatch.setattr("soter.conformance.workshop._Worker.end", end)
    assert graces_s == [10.0, 0.0, 0.0]
