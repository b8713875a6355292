"""Controllers of one's own in a mission of several processes: each process drives its robots and is shown all."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest

from soter import Controller, Waypoint
from soter.controllers import ADVERSARIES, PREFIX
from soter.errors import ConfigError
from soter.rta import Report
from soter.sdk import RobotState
from tests.distribution.test_run import ALPHA, BETA, CUT_S, GROUND, HEALED_S, HOLDS_WITHIN_S, THREE, begun, moved
from tests.runner.lockstep import Site
from tools import distribution
from tools.distribution import Stage
from tools.distribution_hosts import make_hosts

ALL_IN_ONE = {ALPHA: ((1, 2), False), GROUND: ((), True)}
HERE = __name__


class Meets(Controller):
    """Drives at the nearest other robot, wherever its process is."""

    made: ClassVar[list[Meets]] = []

    def __init__(self, options: object) -> None:
        super().__init__(options)
        self.seen: set[int] = set()
        self.heard: list[Report] = []
        self.made.append(self)

    def step(self, own: RobotState, now_s: float) -> Waypoint | None:
        peers = self.arena.peers_of(own.robot_id)
        self.seen.update(peer.robot_id for peer in peers)
        return Waypoint(peers[0].x_m, peers[0].y_m) if peers else None

    def hear(self, report: Report) -> None:
        self.heard.append(report)


class Swarm(Meets):
    """Drives all robots together."""

    fleet = True


class Parts(Swarm):
    """Drives the robots of one process together."""

    per_process = True


class FailsAtOne(Meets):
    """Fails, but of robot 1 only."""

    def step(self, own: RobotState, now_s: float) -> Waypoint | None:
        if own.robot_id == 1 and now_s > self.arena.base_tick_s:
            raise ZeroDivisionError("of one")
        return super().step(own, now_s)


@pytest.fixture
def sites() -> Iterator[list[Site]]:
    """The sites that a test makes; none of their threads is left when it ends."""
    made: list[Site] = []
    Meets.made.clear()
    yield made
    for site in made:
        site.close()


@pytest.mark.parametrize("name", ["Meets", "Parts"])
def test_each_process_drives_its_own_robots_and_is_shown_those_of_others(name: str, sites: list[Site]) -> None:
    site = begun(sites, Site(THREE, ac=f"{HERE}:{name}", duration_s=40.0), (ALPHA, BETA))
    truth = site.run(45.0)
    assert not truth.violations
    assert truth.min_margin["collision"] < 0.25, "they came near each other"
    assert {name: result.status for name, result in site.results.items()} == dict.fromkeys((ALPHA, BETA), "completed")
    assert {(*each.arena.ports,): each.seen for each in Meets.made} == {(1,): {2}, (2,): {1}}
    for each in Meets.made:
        assert {report.robot_id for report in each.heard} == {*each.arena.ports}, "it hears of its own robots"
    assert all(result.ac_share > 0.1 and not result.assumptions for result in site.results.values())


def test_its_robots_hold_while_their_process_is_cut_off(sites: list[Site]) -> None:
    site = begun(sites, Site(THREE, ac=f"{HERE}:Meets", duration_s=80.0), (ALPHA, BETA))
    site.at(CUT_S, lambda: site.network.cut.update({(ALPHA, BETA)}))
    site.at(HEALED_S, site.network.cut.clear)
    assert not site.run(85.0).violations
    for robot_id in (1, 2):
        assert not moved(site, robot_id, CUT_S + HOLDS_WITHIN_S, HEALED_S)
        assert moved(site, robot_id, HEALED_S, 80.0)


def test_one_that_fails_costs_its_own_robot_the_ac_and_no_other_process(sites: list[Site]) -> None:
    site = begun(sites, Site(THREE, ac=f"{HERE}:FailsAtOne", duration_s=20.0), (ALPHA, BETA))
    assert not site.run(25.0).violations
    failed = {name: {*result.failed_robots} for name, result in site.results.items()}
    assert failed == {ALPHA: {1}, BETA: set()}


def test_one_for_the_fleet_needs_all_robots_in_its_process(sites: list[Site]) -> None:
    site = begun(sites, Site(ALL_IN_ONE, ac=f"{HERE}:Swarm", duration_s=5.0), (ALPHA,))
    assert not site.run(10.0).violations
    assert [{*each.arena.ports} for each in Meets.made] == [{1, 2}]
    apart = begun(sites, Site(THREE, ac=f"{HERE}:Swarm"), (ALPHA,))
    with pytest.raises(ConfigError, match=r"^.*ac: .*fleet = True.* robot 2 .*per_process") as refused:
        apart.run(5.0)
    assert refused.value.key == "ac"


@pytest.mark.parametrize("name", [*ADVERSARIES])
def test_every_adversary_does_its_worst_from_two_processes(name: str, sites: list[Site]) -> None:
    site = begun(sites, Site(THREE, ac=f"{PREFIX}{name}", duration_s=10.0), (ALPHA, BETA))
    assert not site.run(15.0).violations
    failed = {robot_id for result in site.results.values() for robot_id in result.failed_robots}
    assert failed == ({1, 2} if name == "raises" else set())


@pytest.mark.long
def test_real_processes_drive_their_robots_by_a_controller_in_a_file(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "from soter import Controller, Waypoint\n\n\n"
        "class Meets(Controller):\n"
        "    def step(self, own, now_s):\n"
        "        peers = self.arena.peers_of(own.robot_id)\n"
        "        return Waypoint(peers[0].x_m, peers[0].y_m) if peers else None\n"
    )
    hosts = make_hosts("loopback", [*distribution.ROBOTS], [distribution.PLANNER])
    try:
        with Stage(hosts, tmp_path, 8.0, "uniform", 1) as stage:
            for name in distribution.ROBOTS:
                stage.run(name, "--ac", str(tmp_path / "own.py:Meets"))
            stage.run(GROUND, "--ac", str(tmp_path / "own.py:Meets"))
            stage.processes.pop(GROUND).wait(distribution.START_LIMIT_S)
            stage.wait(distribution.START_LIMIT_S)
            truth = stage.truth
            assert not truth.latest["violations"]
            for name, robot_id in distribution.ROBOTS.items():
                result = json.loads((tmp_path / f"{name}.json").read_text())
                assert (result["status"], result["failed_robots"]) == ("completed", {}), stage.printed(name)
                assert truth.moved(robot_id, 0.0, math.inf)
            assert "need no task planner" in stage.printed(GROUND)
    finally:
        hosts.close()
