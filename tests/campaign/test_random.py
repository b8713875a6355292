"""The generator of random configurations draws all of a mission file; its judge and shrinking work."""

from __future__ import annotations

import math
import re
import typing
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely  # type: ignore[import-untyped]
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel
from typer.testing import CliRunner

from soter.adapters.pybullet import SimulatedPromise
from soter.campaign.job import JUDGED, Done, Job, carry_out
from soter.campaign.random.configuration import Configuration
from soter.campaign.random.drawing import MOST_ROBOTS, draw
from soter.campaign.random.fleet import MOST_TIMES
from soter.campaign.random.floor import LEAST_M, MOST_M, STYLES
from soter.campaign.random.judge import PromisedLimits, Ways, judge
from soter.campaign.random.room import DrawnRoom, Patch, Start, patch_of
from soter.campaign.random.running import Judgement, in_sc_s
from soter.campaign.random.shrinking import shrunk
from soter.campaign.random.witness import WATCHED, witnesses
from soter.campaign.session import run_campaign
from soter.campaign.store import Store
from soter.campaign.summary import judge as judge_campaign
from soter.cli import app
from soter.config import MissionFile, load_mission
from soter.controllers import ADVERSARIES
from soter.errors import ConfigError
from soter.faults import BUILT_IN as FAULT_KINDS
from soter.registry import load_backend
from soter.runner import run_mission
from soter.stack.planners.names import BUILT_IN as PLANNERS
from soter.stack.planners.names import planner_class
from tests.campaign.here import Here, campaign
from tests.project.source import ROOT

SEEDS = range(250)

NEVER_DRAWN = {
    "workspace": "the generator's own file",
    "station": "that file has them",
    "start": "the same",
    **{f"reseed.*.{key}": "it repeats one branch of a split" for key in ("at_s", "seed")},
    "isolation.memory_mib": "a process of its own is for wall clocks; these runs are in virtual time",
    "isolation.silent_s": "the same",
    "isolation.real_time": "the same",
    "isolation.sandbox": "the same",
    "isolation.read": "the same",
    "distribution.processes": "a distributed mission runs on a wall clock",
    "distribution.via": "the same",
    "distribution.bus": "the same",
    "distribution.prefix": "the same",
    "distribution.wait_s": "the same",
    "backends.pybullet.window": "a run is the same with it",
    "rta.enabled": "without decision modules nothing is promised",
    "planners.ompl-bitstar": "slow; another sampling planner is drawn, and no planner is trusted",
    "planners.ompl-rrtstar": "the same",
    **{f"backends.{name}.promise": "drawn for the kinematic backend" for name in WATCHED if name != "kinematic"},
    **{
        f"{above}.{name}": "simulated robots have one value of it only"
        for name in ("pivots_first", "reverses", "setpoint_period_s")
        for above in ("backends.kinematic.promise", "robots.*")
    },
}
"""Keys that no seed gives, each with the reason."""


@cache
def drawn() -> tuple[Configuration, ...]:
    return tuple(draw(seed) for seed in SEEDS)


def keys_of(model: type[BaseModel], above: str = "") -> Iterator[str]:
    """Every key of a table, with those of the tables in it."""
    for name, field in model.model_fields.items():
        inner = [field.annotation, *typing.get_args(field.annotation)]
        tables = [each for each in inner if isinstance(each, type) and issubclass(each, BaseModel)]
        for table in tables:
            # Tables by a name that the user chooses are as good as one of them.
            yield from keys_of(table, f"{above}{name}." if table is field.annotation else f"{above}{name}.*.")
        if not tables:
            yield f"{above}{name}"


def known_keys() -> set[str]:
    found = {
        key
        for key in keys_of(MissionFile)
        if key not in ("fault", "backends", "planners", "adversaries", "controllers")
    }
    raw = {
        **{f"fault.{kind}": resolve_name(target).options_model for kind, target in FAULT_KINDS.items()},
        **{f"adversaries.{name}": resolve_name(target).Options for name, target in ADVERSARIES.items()},
        **{f"planners.{name}": planner_class(name).options_model for name in PLANNERS},
        **{f"backends.{name}": load_backend(name, to_open=False).config_model for name in WATCHED},
    }
    for name, model in raw.items():
        # What the runner fills in is no key, and the kinematic backend's engine is fixed. Facts are those of any.
        found |= {_any_name(f"{name}.{key}") for key in keys_of(model) if key not in ("workspace", "seed", "limits")}
    found |= {f"robots.*.{key}" for key in keys_of(SimulatedPromise)}
    return found - {"backends.kinematic.engine"}


def _any_name(key: str) -> str:
    return re.sub(r"^robots\.\d+\.", "robots.*.", re.sub(r"^adversaries\..*\.facts\.", "adversaries.*.facts.", key))


def given_keys(tables: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Every key that a configuration gives, named as `known_keys` does."""
    for key, value in tables.items():
        here = f"{above}{key}"
        if key == "fault":
            yield from (f"fault.{table['kind']}.{name}" for table in value for name in table)
        elif above == "rta.module.":
            yield from (f"rta.module.*.{name}" for name in value)
        elif isinstance(value, Mapping) and here not in ("battery.initial", "rta.module"):
            yield from given_keys(value, f"{here}.")
        elif here == "rta.module":
            yield from given_keys(value, "rta.module.")
        else:
            # A number of robots is short for a table of them.
            yield "robots.count" if here == "robots" else here


def test_every_key_of_a_mission_file_is_drawn_or_left_out_for_a_reason() -> None:
    found = {_any_name(key) for configuration in drawn() for key in given_keys(configuration.tables)}
    known = known_keys()

    def is_under(key: str, above: str) -> bool:
        return key == above or key.startswith(f"{above}.")

    assert {key for key in known - found if not any(is_under(key, each) for each in NEVER_DRAWN)} == set()
    assert {each for each in NEVER_DRAWN if any(is_under(key, each) for key in found)} == set()
    assert {each for each in NEVER_DRAWN if not any(is_under(key, each) for key in known)} == set()


def sides_m(room: DrawnRoom) -> tuple[float, float]:
    """How long and how wide a room is, whichever way it is turned."""
    around = np.array(room.inside.minimum_rotated_rectangle.exterior.coords)
    long_m, wide_m, *_ = np.hypot(*np.diff(around, axis=0).T)
    return float(long_m), float(wide_m)


def test_what_is_drawn_covers_what_there_is() -> None:
    acs = Counter(each.tables.get("ac", "mission") for each in drawn())
    assert {f"adversary:{name}" for name in ADVERSARIES} < set(acs)
    assert {fault["kind"] for each in drawn() for fault in each.tables.get("fault", ())} == set(FAULT_KINDS)
    robots = Counter(len(each.room.robots) for each in drawn())
    assert {*range(1, 7), MOST_ROBOTS} <= set(robots) <= set(range(1, MOST_ROBOTS + 1))
    rectangles = [side for each in drawn() if patch_of(each.room.fence) for side in sides_m(each.room)]
    assert LEAST_M <= min(rectangles) < 1.2
    assert 4.0 * MOST_M < max(side for each in drawn() for side in sides_m(each.room)) <= MOST_TIMES * MOST_M + 0.01
    shapes = [each.room for each in drawn() if patch_of(each.room.fence) is None]
    assert len(shapes) > 0.2 * len(drawn())
    assert any(not shapely.equals(each.inside, each.inside.convex_hull) for each in shapes)
    assert any(patch_of(box) is None for each in shapes for box in each.boxes)
    assert max(abs(corner) for each in shapes for corner in each.inside.bounds) > 5000.0
    tables = [each.tables.get("robots", 0) for each in drawn()]
    unlike = [{name: own for name, own in each.items() if name != "count"} for each in tables if isinstance(each, dict)]
    assert len(unlike) > 0.1 * len(drawn())
    assert {*range(1, 4)} <= {len(each) for each in unlike}
    speeds = [own.get("v_max_m_s", 0.22) for each in unlike for own in each.values()]
    assert min(speeds) < 0.08
    assert max(speeds) > 1.3
    faults = [len(each.tables.get("fault", ())) for each in drawn()]
    assert max(faults) == 3
    assert sum(count >= 2 for count in faults) > 0.4 * len(faults)
    assert len(STYLES) >= 10


def test_a_seed_gives_one_configuration_and_files_say_all_of_it(tmp_path: Path) -> None:
    for seed in (1, 2, 3, 4, 5):
        configuration = draw(seed)
        assert configuration == draw(seed)
        assert Configuration.read(configuration.write(tmp_path / str(seed), "A note.\nOf two lines.")) == configuration
    assert draw(1) != draw(2)


def test_the_loader_takes_most_of_what_is_drawn(tmp_path: Path) -> None:
    refused = 0
    for seed in range(40):
        mission = draw(seed).write(tmp_path / str(seed))
        try:
            load_mission(mission).read_workspace()
        except ConfigError:
            refused += 1
    assert refused <= 6


# --- the judge ---------------------------------------------------------------------------------------------------

ROOM = DrawnRoom(
    Patch(0.0, 0.0, 4.0, 3.0).ring, (Start(1, 1.0, 1.0, 0.0), Start(2, 3.0, 1.0, 0.0)), (Patch(0.9, 0.9, 1.1, 1.1),) * 2
)
LIMITS = PromisedLimits(("collision", "obstacle", "geofence", "battery"), {1: 0.1, 2: 0.1}, 0.0, 0.3, {}, {})


def ways_of(*robots: list[tuple[float, float]], charge: list[float] | None = None) -> Ways:
    x, y = (np.array([[at[axis] for at in robot] for robot in robots]).T for axis in (0, 1))
    level = np.ones_like(x) if charge is None else np.array([charge] * len(robots)).T
    return Ways(tuple(range(1, len(robots) + 1)), np.arange(len(x), dtype=np.float64), x, y, level)


def rules(room: DrawnRoom, ways: Ways, limits: PromisedLimits = LIMITS) -> list[str]:
    return [breach.rule for breach in judge(room, limits, ways)]


def test_the_judge_sees_each_rule_broken() -> None:
    assert rules(ROOM, ways_of([(1.0, 1.0), (0.0, 0.0), (4.0, 3.0)])) == []
    assert rules(ROOM, ways_of([(1.0, 1.0), (-0.001, 1.0), (1.0, 1.0), (4.1, 1.0)])) == ["geofence", "geofence"]
    boxed = replace(ROOM, boxes=(Patch(2.0, 0.0, 2.1, 2.0).ring,))
    assert rules(boxed, ways_of([(1.0, 1.0), (1.899, 1.0)])) == []
    assert rules(boxed, ways_of([(1.0, 1.0), (1.91, 1.0)])) == ["obstacle"]
    assert rules(boxed, ways_of([(1.91, 1.0)]), replace(LIMITS, obstacle_m=0.05)) == ["obstacle"]
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(1.31, 1.0)])) == []
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(1.29, 1.0)])) == ["collision"]
    assert rules(ROOM, ways_of([(2.0, 2.0)] * 3, charge=[0.1, 0.0, 0.0])) == ["battery"]
    assert rules(ROOM, ways_of([(1.0, 1.0)] * 3, charge=[0.1, 0.0, 0.0])) == []


def test_the_judge_sees_what_happens_between_two_poses() -> None:
    boxed = replace(ROOM, boxes=(Patch(2.0, 1.0, 2.02, 1.02).ring,))
    assert rules(boxed, ways_of([(1.88, 1.0), (2.14, 1.0)])) == ["obstacle"]
    assert rules(ROOM, ways_of([(1.0, 1.0), (1.4, 1.0)], [(1.4, 1.1), (1.0, 1.1)])) == ["collision"]


def test_rules_of_modules_that_are_off_are_not_promised() -> None:
    assert rules(ROOM, ways_of([(9.0, 9.0)], [(9.0, 9.0)]), replace(LIMITS, rules=("battery",))) == []


def test_bodies_that_overlap_collide_whatever_the_mission_says() -> None:
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(1.15, 1.0)]), replace(LIMITS, separation_m=0.1)) == ["collision"]


def test_each_body_is_judged_by_its_own_radius() -> None:
    unlike = replace(LIMITS, radius_m={1: 0.1, 2: 0.5})
    boxed = replace(ROOM, boxes=(Patch(2.0, 0.0, 2.1, 0.4).ring,))
    assert rules(boxed, ways_of([(1.8, 0.2)], [(3.0, 2.0)]), unlike) == []
    assert rules(boxed, ways_of([(3.0, 2.0)], [(1.8, 0.2)]), unlike) == ["obstacle"]
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(1.59, 1.0)]), unlike) == ["collision"]
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(1.61, 1.0)]), unlike) == []


def test_a_fence_of_any_shape_is_judged() -> None:
    fence = ((100.0, 0.0), (104.0, 0.0), (104.0, 2.0), (102.0, 2.0), (102.0, 4.0), (100.0, 4.0))
    bent = replace(ROOM, fence=fence, boxes=(((100.5, 0.5), (101.0, 0.5), (100.5, 1.0)),))
    assert rules(bent, ways_of([(103.9, 1.0), (101.0, 1.9), (101.0, 3.9)])) == []
    assert rules(bent, ways_of([(103.9, 1.0), (102.5, 2.01)])) == ["geofence"]
    assert rules(bent, ways_of([(100.9, 0.9)])) == []
    assert rules(bent, ways_of([(100.8, 0.8)])) == ["obstacle"]


def test_users_rules_are_judged() -> None:
    own = replace(LIMITS, far_m={"far": 2.0}, keep_out={"out": (2.0, 2.0, 0.5)})
    assert rules(ROOM, ways_of([(1.0, 1.0)], [(2.9, 1.0)]), own) == ["far"]
    assert rules(ROOM, ways_of([(2.0, 1.6)]), own) == ["out"]


point = st.tuples(st.floats(0.2, 3.8), st.floats(0.2, 2.8))


@given(st.lists(point, min_size=2, max_size=6), st.lists(point, min_size=2, max_size=6))
def test_the_judge_misses_nothing_that_dense_sampling_sees(first: list[Any], second: list[Any]) -> None:
    count = min(len(first), len(second))
    boxed = replace(ROOM, boxes=(Patch(1.5, 1.0, 2.5, 1.4).ring,))
    found = set(rules(boxed, ways_of(first[:count], second[:count])))

    def dense(places: list[Any]) -> list[tuple[float, float]]:
        return [
            (a[0] + (b[0] - a[0]) * part / 50.0, a[1] + (b[1] - a[1]) * part / 50.0)
            for a, b in pairwise(places)
            for part in range(51)
        ]

    here, there = dense(first[:count]), dense(second[:count])
    if any(math.dist(a, b) < 0.3 - 1e-5 for a, b in zip(here, there, strict=True)):
        assert "collision" in found
    if any(math.hypot(max(1.5 - x, 0, x - 2.5), max(1.0 - y, 0, y - 1.4)) < 0.1 - 1e-5 for x, y in here + there):
        assert "obstacle" in found


def test_both_judges_see_the_same_of_robots_without_protection() -> None:
    overrides = {
        "backend": WATCHED["kinematic"], "targets": "hostile", "planner": "straight-line", "rta.enabled": False,
        "duration_s": 200.0, "battery.drive_s": 100.0, "battery.idle_s": 150.0, "battery.initial": {},
    }  # fmt: skip
    mission = load_mission(ROOT / "examples" / "surveillance.toml", overrides)
    result, witness = run_mission(mission).result, witnesses[-1]
    room = DrawnRoom.read(mission.workspace)
    limits = PromisedLimits.of(mission.rta.model_dump(), dict.fromkeys(witness.ids, 0.105))
    assert limits.rules == ()
    limits = replace(limits, rules=LIMITS.rules)
    counts = Counter(rules(room, Ways(witness.ids, *witness.seen(result.duration_s)), limits))
    assert result.violations is not None
    assert set(counts) == {rule for rule, count in result.violations.items() if count}
    assert len(counts) >= 3


# --- runs --------------------------------------------------------------------------------------------------------


def easy(**tables: Any) -> Configuration:
    base = {"backend": "kinematic", "planner": "straight-line", "seed": 1, "duration_s": 5.0}
    stations = (Patch(0.8, 0.8, 1.2, 1.2), Patch(2.8, 0.8, 3.2, 1.2))
    return Configuration({**base, **tables}, replace(ROOM, stations=stations))


def judged(mission: Path) -> Done:
    return carry_out(Job("p0", 0, str(mission), {}, {}, judged=True), lambda: False)


def test_a_run_is_what_it_is_without_a_witness(tmp_path: Path) -> None:
    mission = easy().write(tmp_path)
    done = judged(mission)
    assert (done.status, done.findings) == ("done", [])
    assert done.result is not None
    assert done.result["robots"] == 2
    assert run_mission(load_mission(mission)).result.trace_sha256 == done.result["trace_sha256"]


def test_robots_with_figures_of_their_own_keep_to_them(tmp_path: Path) -> None:
    slow = {"v_max_m_s": 0.1, "brake_m_s2": 0.4, "position_noise_m": 0.01}
    judged(easy(backend="kinematic", backends={"kinematic": {"promise": slow}}, duration_s=30.0).write(tmp_path))
    _, x, y, _ = witnesses[-1].seen(30.0)
    steps_m = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    assert 0.09 < steps_m.max() / witnesses[-1].period_s <= 0.1 + 1e-9


def test_an_ill_formed_configuration_is_refused_and_the_condition_is_named(tmp_path: Path) -> None:
    ill_formed = judged(easy(rta={"collision": {"phi_safer_m": 0.31}}).write(tmp_path))
    assert ill_formed.status == "refused"
    assert "module 'collision'" in ill_formed.failure
    assert "P3" in ill_formed.failure


def test_a_robot_that_is_never_let_go_is_stuck(tmp_path: Path) -> None:
    assert Judgement({}, {}, in_sc_s={"1": 300.1}).findings == ["stuck"]
    assert Judgement({}, {}, in_sc_s={"1": 299.0}).findings == []
    dead = judged(easy(ac="adversary:raises", duration_s=305.0).write(tmp_path))
    # Robots whose AC has failed are their safe controllers' for good, and neither stuck nor expected to move.
    assert dead.findings == []
    assert dead.result is not None
    assert (dead.result[JUDGED]["in_sc_s"], dead.result[JUDGED]["never_moved"]) == ({}, [])


def test_a_robot_that_is_flat_is_not_stuck() -> None:
    times = np.arange(0.0, 400.0)
    charge = np.maximum(1.0 - times / 100.0, 0.0)[:, None]
    aside = np.full((400, 1), 2.0)
    # A safe controller has it all along.
    track = SimpleNamespace(time_s=array("d", times), driver=array("b", [1] * 400))
    run: Any = SimpleNamespace(
        result=SimpleNamespace(failed_robots={}), tracks=SimpleNamespace(tracks={1: track})
    )  # fmt: skip
    assert in_sc_s(ROOM, run, Ways((1,), times, aside, aside, charge), {1: 0.1}) == {"1": 99.0}
    assert in_sc_s(ROOM, run, Ways((1,), times, aside, aside, 0.5 + 0.5 * charge), {1: 0.1}) == {"1": 399.0}


def test_a_slow_robot_on_a_long_way_is_not_stuck_but_one_that_goes_to_and_fro_is() -> None:
    times = np.arange(0.0, 400.0)
    full, y = np.full((400, 1), 0.5), np.full((400, 1), 2.0)
    track = SimpleNamespace(time_s=array("d", times), driver=array("b", [1] * 400))
    run: Any = SimpleNamespace(
        result=SimpleNamespace(failed_robots={}), tracks=SimpleNamespace(tracks={1: track})
    )  # fmt: skip
    ahead = 2.0 + 0.05 * times[:, None]
    assert in_sc_s(ROOM, run, Ways((1,), times, ahead, y, full), {1: 0.05}) == {"1": 0.0}
    assert in_sc_s(ROOM, run, Ways((1,), times, ahead, y, full), {1: 0.1}) == {"1": 199.5}
    there_and_back = 2.0 + 0.05 * np.minimum(times, 398.0 - times)[:, None]
    assert in_sc_s(ROOM, run, Ways((1,), times, there_and_back, y, full), {1: 0.05}) == {"1": 398.0}


def test_judges_that_disagree_are_a_finding() -> None:
    judgement = Judgement({"collision": 1, "battery": 1}, {"collision": 0, "battery": 2})
    assert judgement.findings == ["collision", "battery", "judges disagree on collision"]


def test_a_campaign_draws_its_configurations(tmp_path: Path) -> None:
    read = campaign(
        tmp_path, {"seeds": {"count": 3}, "require": ["findings == 0", "mean accepted >= 0.6"], "may_refuse": True},
        mission="random", set={"duration_s": 1.0},
    )  # fmt: skip
    with Store(tmp_path / "kept.sqlite", write=True) as store:
        run_campaign(read, store, Here())
        rows = [*store.rows()]
        assert [(row.seed, row.mission) for row in rows] == [(1, ""), (2, ""), (3, "")]
        assert all(JUDGED in row.result for row in rows if row.status == "done")
        assert rows[1].command == "soter campaign draw 2 --engine kinematic"
        assert [judged.text for judged in judge_campaign(read, store)["p0"]] == list(map(str, read.parts["p0"].require))


def test_the_command_writes_what_a_seed_draws(tmp_path: Path) -> None:
    command = ["campaign", "draw", "7", "--out", str(tmp_path / "7")]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert Configuration.read(tmp_path / "7" / "mission.toml") == draw(7)
    assert CliRunner().invoke(app, command).exit_code == 2
    assert CliRunner().invoke(app, [*command, "--force", "--engine", "warp"]).exit_code == 2


# --- making failures smaller -------------------------------------------------------------------------------------


def test_shrinking_keeps_what_the_failure_needs_and_nothing_else() -> None:
    configuration = next(
        each for each in drawn() if len(each.room.robots) >= 3 and len(each.room.boxes) >= 3 and "fault" in each.tables
    )
    box, robot, fault = configuration.room.boxes[1], configuration.room.robots[1], configuration.tables["fault"][0]
    fault["robot"] = "all"

    def run(tried: Configuration) -> Done:
        fails = box in tried.room.boxes and robot in tried.room.robots and fault in tried.tables.get("fault", ())
        breaches = [{"rule": "battery", "robots": [1], "start_s": 100.0, "end_s": 120.0, "margin": -1.0}] * fails
        result = {"duration_s": tried.tables["duration_s"], JUDGED: {"breaches": breaches}}
        return Done("done", result=result, findings=["battery"] * fails)

    found, done = shrunk(configuration, run, "battery", lambda _: None)
    assert found.room.boxes == (box,)
    assert found.room.robots == (robot,)
    assert len(found.room.stations) == 1
    assert set(found.tables) <= {"seed", "duration_s", "backend", "backends", "fault"}
    assert found.tables["fault"] == [fault]
    assert found.tables["duration_s"] == 130.0
    assert done.findings == ["battery"]


def test_shrinking_refuses_what_does_not_fail() -> None:
    with pytest.raises(ValueError, match="does not fail"):
        shrunk(easy(), lambda _: Done("done"), "battery", lambda _: None)
