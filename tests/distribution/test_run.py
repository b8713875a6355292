"""A mission in several processes: real loops in virtual time, over a network that a test cuts as it likes."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from itertools import pairwise

import pytest

from soter.errors import ConfigError, RobotUnavailable
from soter.runner import RunResult
from soter.runner.machine_host import MachineHost
from soter.runner.mission_host import Scene
from tests.distribution.air import Network
from tests.missions import scripts
from tests.runner.lockstep import Site

ALPHA, BETA, GROUND = "alpha", "beta", "ground"
THREE = {ALPHA: ((1,), False), BETA: ((2,), False), GROUND: ((), True)}
CUT_S, HEALED_S, END_S = 15.0, 35.0, 70.0

HOLDS_WITHIN_S = 0.5 + 0.05 + 0.05 + 0.05 + 0.22
"""Silence, a tick's period, a sample's age, latency, braking from top speed."""

GOES_ON_WITHIN_S = 3.0
"""The dwell, and until the planner has planned anew."""

Sites = list[Site]


@pytest.fixture
def sites() -> Iterator[Sites]:
    """The sites that a test makes; none of their threads is left when it ends."""
    made: Sites = []
    yield made
    for site in made:
        site.close()


def begun(sites: Sites, site: Site, names: Sequence[str] = (ALPHA, BETA, GROUND)) -> Site:
    """Start processes one after the other, each at a time of its own between two ticks."""
    sites.append(site)
    for index, name in enumerate(names):
        site.start(name, 0.313 * index)
    return site


def moved(site: Site, robot_id: int, since_s: float, until_s: float) -> list[float]:
    """The ends of all periods between two times in which a robot really moved."""
    return [
        later_s
        for (_, before), (later_s, after) in pairwise(site.poses)
        if since_s < later_s <= until_s and before[robot_id] != after[robot_id]
    ]


def ended(result: RunResult) -> int:
    """How many targets have ended."""
    return sum(result.targets.model_dump().values())


def test_a_mission_goes_through_three_processes_as_through_one(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=60.0))
    truth = site.run(65.0)
    results = site.results
    assert not truth.violations
    assert {name: result.status for name, result in results.items()} == dict.fromkeys(THREE, "completed")
    assert {name: result.process for name, result in results.items()} == {name: name for name in THREE}
    assert results[GROUND].targets_reached == results[ALPHA].targets_reached + results[BETA].targets_reached >= 5
    assert ended(results[GROUND]) == ended(results[ALPHA]) + ended(results[BETA])
    for name in (ALPHA, BETA):
        assert results[name].ac_share > 0.7
        assert results[name].robots == 1
        assert not results[name].assumptions, "everybody was heard of in time"
    assert results[GROUND].robots == 0
    assert results[GROUND].violations is None


def test_scripts_run_beside_the_task_planner_for_robots_of_other_processes(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=40.0, script="tests.missions.scripts:Roams"))
    scripts.ARRIVALS.clear()
    truth = site.run(45.0)
    results = site.results
    assert not truth.violations
    assert {name: result.status for name, result in results.items()} == dict.fromkeys(THREE, "completed")
    assert results[GROUND].targets_reached == results[ALPHA].targets_reached + results[BETA].targets_reached >= 2
    assert {robot_id for robot_id, arrived in scripts.ARRIVALS if arrived} == {1, 2}
    assert any(arrived.why.startswith("taken over by ") for _, arrived in scripts.ARRIVALS)


def test_no_assumption_fails_because_a_process_takes_its_time_to_begin(
    sites: Sites, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = MachineHost.start

    def slow(host: MachineHost, scene: Scene) -> None:
        scene.clock.sleep_until(scene.clock.now() + 0.8)
        begin(host, scene)

    monkeypatch.setattr(MachineHost, "start", slow)
    site = begun(sites, Site(THREE, duration_s=5.0))
    site.run(15.0)
    for name in (ALPHA, BETA):
        assert site.results[name].status == "completed"
        assert not site.results[name].assumptions


def test_a_process_says_who_it_waits_for_and_why(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=1.0))
    site.run(5.0)
    first = site.said[ALPHA]
    assert first[0] == (
        "waiting for 'beta' with robot 2 (it has not been heard yet); "
        "'ground' with the task planner (it has not been heard yet)"
    )
    assert first[-1] == "all processes are there"
    assert "waiting for 'ground' with the task planner (it does not hear this one)" in site.said[BETA]


def test_the_task_planner_may_be_beside_robots(sites: Sites) -> None:
    site = begun(sites, Site({ALPHA: ((1,), True), BETA: ((2,), False)}, duration_s=60.0), (ALPHA, BETA))
    truth = site.run(65.0)
    assert not truth.violations
    results = site.results
    assert ended(results[ALPHA]) > ended(results[BETA]) >= 2, "whoever has the task planner counts all targets"


@pytest.mark.parametrize(
    "cut",
    [
        {(ALPHA, BETA), (BETA, ALPHA), (ALPHA, GROUND), (GROUND, ALPHA)},
        {(ALPHA, BETA), (BETA, ALPHA)},
        {(ALPHA, BETA)},
        {(BETA, ALPHA)},
    ],
    ids=["one of all", "both ways", "one way", "the other way"],
)
def test_robots_that_are_cut_off_hold_and_go_on_when_they_are_heard_again(
    cut: set[tuple[str, str]], sites: Sites
) -> None:
    site = begun(sites, Site(THREE, duration_s=END_S))
    site.at(CUT_S, lambda: site.network.cut.update(cut))
    site.at(HEALED_S, site.network.cut.clear)
    site.run(HEALED_S)
    before = {name: loop.metrics.outcomes.total() for name, loop in site.loops.items()}
    for robot_id in (1, 2):
        assert moved(site, robot_id, CUT_S - 1.0, CUT_S), "it drove when it was cut off"
        assert not moved(site, robot_id, CUT_S + HOLDS_WITHIN_S, HEALED_S)
    truth = site.run(END_S + 5.0)
    assert not truth.violations
    for robot_id in (1, 2):
        assert moved(site, robot_id, HEALED_S, HEALED_S + GOES_ON_WITHIN_S)
    results = site.results
    assert all(ended(results[name]) >= before[name] + 2 for name in (ALPHA, BETA)), "the mission went on"
    assert ended(results[GROUND]) == ended(results[ALPHA]) + ended(results[BETA]), "no target was lost or told twice"
    for name, robot_id in ((ALPHA, 1), (BETA, 2)):
        assert set(results[name].assumptions[robot_id]) == {"A7"}


def test_robots_that_cannot_reach_the_task_planner_finish_what_they_have_and_stand(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=END_S))
    site.at(CUT_S, lambda: site.network.isolate(GROUND, [ALPHA, BETA]))
    site.at(HEALED_S, site.network.cut.clear)
    truth = site.run(HEALED_S)
    assert moved(site, 1, CUT_S + HOLDS_WITHIN_S, HEALED_S), "what it had it finished"
    truth = site.run(END_S + 5.0)
    assert not truth.violations
    assert moved(site, 1, HEALED_S, END_S)
    results = site.results
    assert ended(results[GROUND]) == ended(results[ALPHA]) + ended(results[BETA])
    assert not results[ALPHA].assumptions, "a task planner is no peer"


def test_a_task_planner_that_is_started_anew_gives_new_targets(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=END_S))
    site.at(CUT_S, lambda: site.kill(GROUND))
    site.at(HEALED_S, lambda: site.start(GROUND))
    truth = site.run(HEALED_S)
    stood_s = max(moved(site, 1, CUT_S, HEALED_S))
    before = {name: loop.metrics.outcomes.total() for name, loop in site.loops.items()}
    assert stood_s < HEALED_S - 5.0, "without a task planner it has nothing to do in the end"
    truth = site.run(END_S)
    assert not truth.violations
    after = {name: loop.metrics.outcomes.total() for name, loop in site.loops.items()}
    assert all(after[name] >= before[name] + 2 for name in (ALPHA, BETA))
    assert site.planner is not None
    given = site.planner.metrics.outcomes.total()
    assert 0 < given <= sum(after.values()) - sum(before.values())


def test_a_robot_process_that_is_started_anew_is_given_its_target_again(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=END_S))
    site.at(CUT_S, lambda: site.kill(ALPHA))
    site.at(HEALED_S, lambda: site.start(ALPHA))
    truth = site.run(HEALED_S)
    assert site.planner is not None
    target = site.planner.metrics.targets[1]
    for robot_id in (1, 2):
        assert not moved(site, robot_id, CUT_S + HOLDS_WITHIN_S, HEALED_S), "one has no lease, the other holds"
    truth = site.run(HEALED_S + 2.0)
    assert site.loops[ALPHA].metrics.targets[1] == target
    truth = site.run(END_S)
    assert not truth.violations
    assert moved(site, 1, HEALED_S, END_S)
    assert moved(site, 2, HEALED_S, END_S)
    assert site.loops[ALPHA].metrics.outcomes.total() >= 2


RAMS = "adversary:chase"
"""The ACs of one process ram the robots of the others too, wherever they were seen last."""


@pytest.mark.parametrize("seed", range(2))
def test_robots_that_ram_each_other_are_safe_whatever_the_network_does(seed: int, sites: Sites) -> None:
    draw = random.Random(seed)
    delay_s = draw.choice([(0.001, 0.004), (0.0, 0.1), (0.05, 0.2)])
    network = Network(seed, delay_s, loss=draw.choice([0.0, 0.1, 0.5]))
    site = begun(sites, Site(THREE, network, ac=RAMS, duration_s=120.0, seed=seed), (ALPHA, BETA))
    time_s = 5.0
    while time_s < 115.0:
        cut = draw.choice([{(ALPHA, BETA)}, {(BETA, ALPHA)}, {(ALPHA, BETA), (BETA, ALPHA)}])
        site.at(time_s, lambda cut=cut: network.cut.update(cut))  # type: ignore[misc]
        time_s += draw.choice([0.1, 0.4, 0.6, 2.0, 10.0])
        site.at(time_s, network.cut.clear)
        time_s += draw.uniform(0.2, 8.0)
    truth = site.run(125.0)
    assert not truth.violations
    assert truth.min_margin["collision"] < 0.25, "they came near each other"
    assert site.results[ALPHA].disengagements_total > 5


def test_processes_may_have_several_robots_and_all_robots_hold_with_one(sites: Sites) -> None:
    processes = {ALPHA: ((1, 3), False), BETA: ((2, 4), False), "gamma": ((5,), False)}
    site = begun(sites, Site(processes, ac=RAMS, mission="warehouse", robots=5, duration_s=END_S), [*processes])
    site.at(CUT_S, lambda: site.network.isolate(BETA, [*processes]))
    site.at(HEALED_S, site.network.cut.clear)
    truth = site.run(END_S + 5.0)
    assert not truth.violations
    assert truth.min_margin["collision"] < 0.25, "they came near each other"
    assert {result.status for result in site.results.values()} == {"completed"}
    for robot_id in range(1, 6):
        assert not moved(site, robot_id, CUT_S + HOLDS_WITHIN_S, HEALED_S)
        assert moved(site, robot_id, HEALED_S, END_S)


def test_who_does_not_come_is_named_with_what_it_has(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=60.0, distribution__wait_s=7.0), (ALPHA, GROUND))
    with pytest.raises(RobotUnavailable, match=r"after 7 s .* 'beta' with robot 2 \(it has not been heard yet\)"):
        site.run(30.0)


def test_a_second_process_of_one_name_is_refused(sites: Sites) -> None:
    site = begun(sites, Site(THREE, duration_s=60.0))
    site.at(5.0, lambda: site.start_duplicate(GROUND))
    with pytest.raises(ConfigError, match=r"--process: another process 'ground' of this mission is running"):
        site.run(30.0)
