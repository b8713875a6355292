"""Commands and samples that come late, not at all, or twice."""

from __future__ import annotations

from typing import Any

import pytest

from soter.sdk import Controller, GoalStatus, Waypoint
from tests.faults.bench import TICK_S, Bench

PLACE = Waypoint(1.0, 2.0)
SC = Controller.SC


def test_late_commands_arrive_at_their_time_and_in_order() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.12})
    bench.run(0.5)
    bench.behind.calls.clear()
    bench.robot.goto(PLACE, SC)
    bench.robot.switch_ac_sc(Controller.AC, "go on")
    bench.run(0.61)
    assert bench.behind.calls == []
    bench.run(0.62)
    assert bench.behind.calls == ["send", "hand over AC", "renew", "renew"]


def test_a_late_goal_that_looks_reached_before_it_arrives_is_stopped_behind_it() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.12})
    bench.run(0.5)
    goal = bench.robot.goto(PLACE, SC)
    bench.look(0.55, x_m=PLACE.x_m - 0.09, y_m=PLACE.y_m)
    assert goal.status is GoalStatus.REACHED
    goal.cancel()
    bench.behind.calls.clear()
    bench.run(0.7)
    assert bench.behind.calls == ["send", "halt"]
    assert goal.status is GoalStatus.REACHED


def test_a_command_that_is_sent_after_the_delay_ends_waits_for_those_before_it() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.1, "start_s": 1.0, "duration_s": 0.5})
    bench.run(1.45)
    bench.robot.goto(PLACE, SC)
    bench.run(1.5)
    bench.robot.goto(Waypoint(3.0, 3.0), SC)
    assert bench.behind.sent == []
    bench.run(1.55)
    assert [goal.target.x_m for goal in bench.behind.sent] == [1.0, 3.0]
    bench.run(2.0)
    bench.robot.goto(PLACE, SC)
    assert len(bench.behind.sent) == 3


def test_late_samples_are_as_old_as_they_are_late() -> None:
    bench = Bench({"kind": "delay", "samples_s": 0.1})
    states = bench.seen(20)
    assert [round(0.05 * k - state.stamp_s, 9) for k, state in enumerate(states, start=1)][2:] == [0.1] * 18
    assert bench.robot.capabilities.sample_age_s == pytest.approx(0.1)
    assert bench.robot.capabilities.latency_s == bench.behind.capabilities.latency_s


def test_a_delay_of_samples_is_promised_in_whole_ticks() -> None:
    bench = Bench({"kind": "delay", "samples_s": 0.03})
    oldest_s = max(0.05 * k - state.stamp_s for k, state in enumerate(bench.seen(20), start=1))
    assert oldest_s == pytest.approx(TICK_S)
    assert bench.robot.capabilities.sample_age_s == pytest.approx(TICK_S)


@pytest.mark.parametrize(
    ("table", "latency_s", "age_s"),
    [
        ({"kind": "delay", "commands_s": 0.03}, 0.03, 0.0),
        ({"kind": "delay", "commands_s": 0.03, "jitter_s": 0.01}, 0.04, 0.0),
        ({"kind": "delay", "commands_s": 0.03, "samples_s": 0.05, "jitter_s": 0.01}, 0.04, 0.1),
        ({"kind": "delay", "jitter_s": 0.01}, 0.01, 0.05),
        ({"kind": "delay", "commands_s": 0.03, "declared": False}, 0.0, 0.0),
        ({"kind": "loss", "commands": 0.5, "burst": 2}, 0.1, 0.0),
        ({"kind": "loss", "samples": 0.5, "burst": 2}, 0.0, 0.1),
        ({"kind": "duplicate", "commands": 0.5, "after_s": 0.02}, 0.02, 0.0),
        ({"kind": "duplicate", "samples": 0.5}, 0.0, 0.05),
    ],
)
def test_what_is_declared_widens_the_promises_and_is_kept(
    table: dict[str, Any], latency_s: float, age_s: float
) -> None:
    bench = Bench(table, seed=4)
    promised, before = bench.robot.capabilities, bench.behind.capabilities
    assert promised.latency_s - before.latency_s == pytest.approx(latency_s)
    assert promised.sample_age_s - before.sample_age_s == pytest.approx(age_s)
    assert promised.widened_beyond(bench.robot.declared) is None
    if not table.get("declared", True):
        return
    for tick in range(1, 400):
        state = bench.look(tick * TICK_S)
        assert state.age_s(bench.now_s) <= promised.sample_age_s + 1e-9
        goal = bench.robot.goto(Waypoint(float(tick), 0.0), SC)
        bench.run(bench.now_s + latency_s)
        assert bench.behind.sent[-1].target == goal.target, "it has arrived within the latency that was added"


def test_losses_are_made_up_for_within_the_burst() -> None:
    bench = Bench({"kind": "loss", "samples": 0.9, "burst": 2}, seed=1)
    states = bench.seen(200)
    ages = {round((0.05 * k - state.stamp_s) / TICK_S) for k, state in enumerate(states, start=1)}
    assert ages == {0, 1, 2}
    assert 120 < bench.fleet.injected()[0].affected < 140


def test_a_command_that_is_not_sent_again_is_gone() -> None:
    bench = Bench({"kind": "loss", "commands": 1.0, "burst": 0, "resend": False, "declared": False, "duration_s": 1.0})
    goal = bench.robot.goto(PLACE, SC)
    bench.run(2.0)
    assert bench.behind.sent == []
    assert goal.status is GoalStatus.ACTIVE, "who sent it does not know"
    bench.robot.goto(PLACE, SC)
    assert len(bench.behind.sent) == 1


def test_what_waits_for_a_link_that_is_cut_gets_through_when_it_is_mended() -> None:
    cut = {"kind": "loss", "commands": 1.0, "burst": 0, "declared": False, "start_s": 1.0}
    bench = Bench({**cut, "duration_s": 2.0, "every_s": 10.0})
    for now_s, mended_s in ((1.5, 3.0), (12.0, 13.0)):
        bench.run(now_s)
        bench.robot.goto(PLACE, SC)
        bench.run(mended_s - 0.01)
        before = len(bench.behind.sent)
        bench.run(mended_s + 0.01)
        assert len(bench.behind.sent) == before + 1
    bench = Bench(cut)
    bench.run(1.5)
    bench.robot.goto(PLACE, SC)
    bench.run(1000.0)
    assert bench.behind.sent == []


def test_a_copy_comes_after_its_original_and_holds_up_what_follows() -> None:
    bench = Bench({"kind": "duplicate", "commands": 1.0, "after_s": 0.02})
    bench.run(1.0)
    bench.robot.goto(PLACE, SC)
    bench.robot.goto(Waypoint(3.0, 3.0), SC)
    bench.run(2.0)
    assert [goal.target.x_m for goal in bench.behind.sent] == [1.0, 1.0, 3.0, 3.0]


def test_a_copy_out_of_order_overtakes_what_is_newer() -> None:
    bench = Bench({"kind": "duplicate", "commands": 1.0, "after_s": 0.2, "reorder": True, "declared": False})
    bench.robot.goto(PLACE, SC)
    bench.run(0.1)
    bench.robot.goto(Waypoint(3.0, 3.0), SC)
    bench.run(2.0)
    assert [goal.target.x_m for goal in bench.behind.sent] == [1.0, 3.0, 1.0, 3.0]


def test_an_old_sample_again_makes_the_state_older_once() -> None:
    bench = Bench({"kind": "duplicate", "samples": 1.0})
    ages = [round((0.05 * k - state.stamp_s) / TICK_S) for k, state in enumerate(bench.seen(10), start=1)]
    assert ages == [1, 0] * 5


def test_a_command_of_a_controller_that_was_replaced_on_the_way_moves_nothing() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.1})
    bench.robot.switch_ac_sc(Controller.AC, "go on")
    bench.run(1.0)
    bench.robot.goto(PLACE, Controller.AC)
    bench.robot.switch_ac_sc(SC, "danger")
    late = bench.robot.goto(PLACE, Controller.AC)
    bench.run(2.0)
    assert late.status is GoalStatus.REJECTED
    assert [goal.status for goal in bench.behind.sent] == [GoalStatus.PREEMPTED]


def test_a_late_command_that_fails_is_told_at_the_next_look() -> None:
    bench = Bench({"kind": "delay", "commands_s": 0.1})
    bench.look(0.5)
    bench.behind.failing.add("send")
    bench.robot.goto(PLACE, SC)
    bench.run(1.0)
    with pytest.raises(OSError, match="send failed"):
        bench.look(1.05)
    bench.look(1.1)


def test_the_same_seed_gives_the_same_faults() -> None:
    def stamps(seed: int) -> list[float]:
        return [state.stamp_s for state in Bench({"kind": "loss", "samples": 0.5}, seed=seed).seen(100)]

    assert stamps(1) == stamps(1)
    assert stamps(1) != stamps(2)
