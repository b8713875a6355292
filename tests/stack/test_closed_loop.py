"""A hostile AC straight through the port, for each module: with it no violation by truth, without it there is one."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any

import pytest

from soter.geometry.workspace_xml import read_workspace
from soter.rta import ControlReport, GoalReport
from soter.sdk import Waypoint
from soter.stack.kit import RobotPort
from tests.project.source import ROOT
from tests.stack.loop import AC, Loop, goto, where

MODULES = ("collision", "obstacle", "geofence", "battery")
MINUTES = 3.0
CHARGES = {"battery": (0.30, 0.35)}

Ports = Mapping[int, RobotPort]


def over_the_fence(now_s: float, ports: Ports) -> None:
    """To a place outside the fence, another one every 20 s, the shortest way over it first."""
    places = [(-1.0, 1.5), (1.0, -1.0), (4.5, 6.0), (6.0, 2.5), (0.5, 6.0)]
    for robot_id, port in ports.items():
        goto(port, *places[(int(now_s / 20.0) + robot_id) % len(places)])


def into_a_box(now_s: float, ports: Ports) -> None:
    """Into the middle of the nearest box."""
    for port in ports.values():
        goto(port, *min([(2.5, 0.5), (2.5, 3.5), (1.45, 2.5)], key=lambda box: math.dist(box, where(port))))


def ram(now_s: float, ports: Ports) -> None:
    """Straight at the other robot; both do."""
    goto(ports[1], *where(ports[2]))
    goto(ports[2], *where(ports[1]))


def ram_and_lead(now_s: float, ports: Ports) -> None:
    """One flees into a corner and turns on the other, which follows."""
    phase = int(now_s / 7.0) % 3
    goto(ports[1], *where(ports[2]))
    if phase == 0:
        goto(ports[2], *where(ports[1]))
    else:
        goto(ports[2], *((4.2, 4.2) if phase == 1 else (4.2, 0.8)))


def never_charge(now_s: float, ports: Ports) -> None:
    """Up and down in free space, for ever."""
    for robot_id, port in ports.items():
        goto(port, 3.6 + 0.7 * robot_id - 0.7, 1.0 if int(now_s / 15.0) % 2 else 4.0)


HOSTILE: dict[str, tuple[AC, ...]] = {
    "geofence": (over_the_fence,),
    "obstacle": (into_a_box,),
    "collision": (ram, ram_and_lead),
    "battery": (never_charge,),
}
CASES = [(module, ac) for module in MODULES for ac in HOSTILE[module]]


def loop(module: str, ac: AC, modules: tuple[str, ...]) -> Loop:
    # A battery that is empty after six minutes of driving, so that it matters within three.
    overrides: dict[str, Any] = {"battery__drive_s": 360.0} if module == "battery" else {}
    return Loop(ac, CHARGES.get(module, (1.0, 1.0)), rta__modules=list(modules), **overrides)


@pytest.mark.parametrize(("module", "ac"), CASES, ids=lambda value: getattr(value, "__name__", str(value)))
def test_a_hostile_ac_breaks_no_rule(module: str, ac: AC) -> None:
    made = loop(module, ac, MODULES)
    report = made.run(60.0 * MINUTES)
    assert report.violations == ()
    assert report.contacts == 0
    assert made.disengagements(module) > 0, "the module had to step in"


@pytest.mark.parametrize(("module", "ac"), CASES, ids=lambda value: getattr(value, "__name__", str(value)))
def test_without_its_module_the_same_ac_breaks_that_rule(module: str, ac: AC) -> None:
    report = loop(module, ac, tuple(name for name in MODULES if name != module)).run(60.0 * MINUTES)
    assert report.count(module) > 0


# The battery's rule is left out: its way home is kept free by the collision module.
@pytest.mark.parametrize(
    ("module", "ac"),
    [case for case in CASES if case[0] != "battery"],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_one_module_alone_keeps_its_rule(module: str, ac: AC) -> None:
    assert loop(module, ac, (module,)).run(60.0 * MINUTES).count(module) == 0


@pytest.mark.parametrize("seed", range(4))
def test_an_ac_that_changes_its_mind_all_the_time_breaks_no_rule(seed: int) -> None:
    stream = random.Random(seed)

    def restless(now_s: float, ports: Ports) -> None:
        for robot_id, port in ports.items():
            draw = stream.random()
            if draw < 0.02:
                goto(port, stream.uniform(-1.0, 6.0), stream.uniform(-1.0, 6.0))
            elif draw < 0.03:
                goto(port, *where(ports[3 - robot_id]))
            elif draw < 0.04:
                x, y = where(port)
                angle = stream.uniform(0.0, math.tau)
                port.goto(Waypoint(x + math.cos(angle), y + math.sin(angle), heading_rad=stream.uniform(-3.0, 3.0)))
            elif draw < 0.05:
                port.goto(Waypoint(math.nan, 0.0))

    report = Loop(restless, (0.5, 0.9), battery__drive_s=500.0).run(500.0)
    assert report.violations == ()
    assert report.contacts == 0


def test_goals_that_were_preempted_stay_so_and_nothing_old_moves_the_robot_after_reengagement() -> None:
    asked: list[int] = []

    def once(now_s: float, ports: Ports) -> None:
        if now_s == pytest.approx(5.0):
            asked.append(ports[1].goto(Waypoint(-1.0, 1.0)))

    made = Loop(once)
    made.run(60.0)
    assert made.disengagements("geofence") == 1
    ends = [report for report in made.reports if isinstance(report, GoalReport) and report.goal_id == asked[0]]
    assert [report.status for report in ends] == ["preempted"]
    control = [report.engaged for report in made.reports if isinstance(report, ControlReport) and report.robot_id == 1]
    assert control == [True, False, True]
    before = where(made.ports[1])
    made.run(10.0)
    assert where(made.ports[1]) == before


def test_what_is_asked_for_without_control_is_rejected_and_moves_nothing() -> None:
    def early(now_s: float, ports: Ports) -> None:
        if now_s < 0.2:
            ports[1].goto(Waypoint(1.0, 1.9))

    made = Loop(early)
    made.run(20.0)
    reports = [report for report in made.reports if isinstance(report, GoalReport)]
    assert reports
    assert {report.status for report in reports} == {"rejected"}
    assert math.dist(where(made.ports[1]), (1.0, 1.0)) < 0.05, "its safe controllers may have shifted it a little"


@pytest.mark.parametrize("command", [Waypoint(math.nan, 1.0), Waypoint(1e300, 0.0), None, "there", (1.0, 1.0)])
def test_garbage_is_rejected_and_what_was_going_on_goes_on(command: object) -> None:
    def garbage(now_s: float, ports: Ports) -> None:
        if now_s == pytest.approx(5.0):
            ports[1].goto(Waypoint(1.0, 1.5))
        elif now_s == pytest.approx(5.5):
            ports[1].goto(command)  # type: ignore[arg-type]

    made = Loop(garbage)
    made.run(15.0)
    assert [r.status for r in made.reports if isinstance(r, GoalReport)] == ["rejected", "reached"]


def test_a_supervisor_that_dies_leaves_the_robots_inside_every_rule() -> None:
    """Dead man: at whatever tick nobody renews any more, the lease runs out before a rule is broken."""
    made = Loop(into_a_box, rta__modules=["collision", "obstacle"])
    for _ in range(400):
        made.run(0.05)
        report = made.fleet.truth.report() if made.fleet.truth is not None else None
        assert report is not None
        if made.disengagements("obstacle"):
            break
    assert made.switches
    for steps in range(60):
        again = Loop(into_a_box, rta__modules=["collision", "obstacle"])
        again.run(made._tick * 0.05 - 0.05 * steps)
        # No more ticks: time goes on without the supervisor.
        again.fleet.clock.sleep_until(again.fleet.clock.now() + 2.0)
        assert again.fleet.truth is not None
        assert again.fleet.truth.report().violations == ()
        assert again.fleet.world.bodies.v == [0.0, 0.0]


def test_two_runs_are_one() -> None:
    def positions() -> list[tuple[float, float]]:
        made = Loop(ram_and_lead)
        made.run(60.0)
        return [where(port) for port in made.ports.values()]

    assert positions() == positions()


def test_robots_do_not_begin_by_driving_home_although_all_modules_begin_in_sc() -> None:
    # Both start away from their stations, and turned away from them.
    loop = Loop(lambda *_: None, workspace=read_workspace(ROOT / "examples" / "ros2_external_ac" / "hall.xml"))
    truth = loop.fleet.truth
    assert truth is not None
    begun = {robot_id: truth.pose(robot_id) for robot_id in loop.ports}
    loop.run(1.5)
    assert all(port.engaged for port in loop.ports.values())
    assert {robot_id: truth.pose(robot_id) for robot_id in loop.ports} == begun
