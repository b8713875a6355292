"""Many robots ticked together: what one of them does costs the others nothing."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from soter.rta import RobotSupervisor, Supervisor, Topic
from soter.sdk import Controller
from tests.rta.doubles import TICK_S, At, Rig


def fleet(*rigs: Rig) -> Supervisor:
    return Supervisor([rig.robot for rig in rigs], TICK_S, 2.5)


def run(supervisor: Supervisor, rigs: list[Rig], count: int) -> None:
    for _ in range(count):
        for number, rig in enumerate(rigs, start=1):
            rig.actuator.calls.clear()
            if rig.fresh:
                rig.actuator.sample = At(10.0 * number, stamp_s=rig.now_s, robot_id=number)
        supervisor.tick(rigs[0].now_s)
        for rig in rigs:
            rig.ticks += 1


def fail(rig: Rig, failure: str) -> None:
    if failure == "AC raises":
        rig.ac.failing = True
    elif failure == "decision module raises":
        rig.rules["a"].value = OSError("broken")
    elif failure == "safe controller raises":
        rig.rules["a"].value, rig.scs["a"].failing = 0.0, True
    elif failure == "no state":
        rig.fresh, rig.actuator.sample = False, OSError("link lost")
    elif failure == "interface raises":
        rig.actuator.failing |= {"drive", "renew", "hand_over"}
    else:
        rig.rules["a"].value, rig.watch.failing = 0.0, True


FAILURES = (
    "AC raises",
    "decision module raises",
    "safe controller raises",
    "no state",
    "interface raises",
    "watch raises",
)


@pytest.mark.parametrize("failure", FAILURES)
@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_robot_that_fails_costs_the_others_nothing(failure: str, which: int) -> None:
    rigs = [Rig("a", robot_id=number) for number in (1, 2, 3)]
    supervisor = fleet(*rigs)
    run(supervisor, rigs, 20)
    assert [rig.driver() for rig in rigs] == [None] * 3
    fail(rigs[which], failure)
    for _ in range(20):
        run(supervisor, rigs, 1)
        for index, rig in enumerate(rigs):
            if index != which:
                assert rig.driver() is None
                assert rig.names() == ["drive", "renew"]
    assert rigs[which].driver() == "a"
    assert rigs[which].robot.mode is Controller.SC


def test_the_arbiter_sees_all_robots_sensed_and_none_decided() -> None:
    rigs = [Rig("a", robot_id=1), Rig("a", robot_id=2)]
    seen: list[tuple[float, list[float]]] = []

    def look(now_s: float, robots: Mapping[int, RobotSupervisor]) -> None:
        seen.append((now_s, [robot.situation.own.stamp_s for robot in robots.values()]))
        assert all(not rig.actuator.calls for rig in rigs)

    supervisor = fleet(*rigs)
    supervisor._before_decisions = look
    run(supervisor, rigs, 3)
    assert [now_s for now_s, _ in seen] == pytest.approx([0.0, 0.05, 0.1])
    assert all(stamps == [now_s, now_s] for now_s, stamps in seen)


def test_a_topic_counts_what_is_published() -> None:
    topic: Topic[int] = Topic("t")
    assert (topic.value, topic.count) == (None, 0)
    topic.publish(1)
    topic.publish(None)
    assert (topic.value, topic.count) == (None, 2)
