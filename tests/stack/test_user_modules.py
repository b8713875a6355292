"""Modules of a user's own: declared from the mission file, driven by certified legs, judged by true poses."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from soter.campaign.random.attackers import Outside
from soter.config import MissionFile, load_mission, parse_mission
from soter.errors import ConfigError
from soter.rta import Node, Region, Situation, SpeedBound, Topic
from soter.rta.models import PairBound
from soter.runner import RunResult, run_mission
from soter.sdk import Waypoint
from soter.stack.battery import GoHome
from soter.stack.certified_controller import CertifiedController
from soter.stack.module_kit import GoTo, ModuleKit
from soter.stack.own_rules import OwnRule
from soter.stack.refuge import RefugeFinder
from tests.project.source import ROOT
from tests.rta.doubles import At, module
from tests.stack.ground import dock, planner, seen

ZONE = ROOT / "examples" / "modules" / "zone.toml"
OWN = '[rta.module.own]\ndeclare = "tests.check.planted:right"\n'


def mission(tables: str) -> MissionFile:
    return parse_mission(f'workspace = "w.xml"\n{tables}'.encode(), "m.toml")


def zone_run(**overrides: object) -> RunResult:
    given = {"duration_s": 240.0, "planner": "straight-line", **overrides}
    return run_mission(load_mission(ZONE, given), accept_unproved=True).result  # trials would take longer


@pytest.fixture(scope="module")
def kept() -> RunResult:
    return zone_run()


# --- in a mission ------------------------------------------------------------------------------------------


def test_truth_says_that_the_limit_is_kept_with_the_module_and_broken_without(kept: RunResult) -> None:
    assert kept.violations is not None
    assert kept.violations["zone-speed"] == 0
    assert not any(kept.violations.values())
    assert kept.min_margin is not None
    assert kept.min_margin["zone-speed"] >= 0.0
    without = zone_run(**{"rta.module.zone-speed.enabled": False})
    assert without.violations is not None
    assert without.violations["zone-speed"] > 2
    assert without.violated


def test_it_appears_by_name_wherever_modules_do(kept: RunResult) -> None:
    assert kept.modules == ("zone-speed", "collision", "obstacle", "geofence", "battery")
    assert kept.disengagements["zone-speed"] > 0
    assert kept.monitors["zone-speed"].looks > 0
    assert kept.monitors["zone-speed"].broken == 0
    assert kept.monitors["zone-speed"].least_margin is not None


def test_a_mission_without_modules_of_its_own_has_no_further_rules() -> None:
    run = run_mission(
        load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic", "duration_s": 5.0})
    )
    assert run.result.violations == {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}


def test_it_is_thirty_lines_at_most() -> None:
    text = (ROOT / "examples" / "modules" / "zone_speed.py").read_text()
    lines = [line.strip() for line in text.splitlines()]
    assert len([line for line in lines if line and not line.startswith('"""')]) <= 30


# --- the order ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tables", "order"),
    [
        (OWN, ("own", "collision", "obstacle", "geofence", "battery")),
        (OWN + 'before = "geofence"\n', ("collision", "obstacle", "own", "geofence", "battery")),
        (OWN + "enabled = false\n", ("collision", "obstacle", "geofence", "battery")),
        (OWN + '[rta]\nmodules = ["battery"]\n', ("own", "battery")),
        (
            OWN + '[rta.module.other]\ndeclare = "a:b"\nbefore = "own"\n',
            ("other", "own", "collision", "obstacle", "geofence", "battery"),
        ),
        (OWN + "[rta]\nenabled = false\n", ()),
    ],
)
def test_modules_have_an_order(tables: str, order: tuple[str, ...]) -> None:
    assert mission(tables).rta.order == order


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ('[rta.module.own]\ndeclare = "a.b"\n', "m.toml:3: rta.module.own.declare: it is 'a.b', allowed: a function"),
        (OWN + 'before = "batery"\n', "m.toml:4: rta.module.own.before: it is 'batery', allowed: collision"),
        (OWN + 'before = "own"\n', "m.toml:4: rta.module.own.before: it is 'own'"),
        ('[rta.module.battery]\ndeclare = "a:b"\n', "m.toml:2: rta.module.battery: it is 'battery', allowed: a name"),
        ('[rta.module.Own]\ndeclare = "a:b"\n', "m.toml:2: rta.module.Own: it is 'Own', allowed: a name"),
        (OWN + "optons = {}\n", "unknown key, did you mean 'options'?; allowed: declare, before, enabled, options"),
        ("[rta.module.own]\n", "m.toml:2: rta.module.own.declare: it is missing"),
    ],
)
def test_what_is_wrong_in_the_file_is_named(tables: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        mission(tables)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "rihgt",
            "zone.toml:11: rta.module.zone-speed.declare: it is 'tests.check.planted:rihgt', but there is no 'rihgt'",
        ),
        ("right", "takes no options, but `rta.module.zone-speed.options` gives zone, limit_m_s"),
        ("with_options", "rta.module.zone-speed.options.zone: unknown key"),
        ("without_sc", "rta.module.zone-speed.declare: 'tests.check.planted:without_sc' failed: AttributeError"),
        (
            "with_unchecked_options",
            "zone-speed.options: these options cannot be checked: KeyError('no table')",
        ),
    ],
)
def test_what_is_wrong_with_a_declaration_is_named_before_anything_moves(
    name: str, message: str, tmp_path: Path
) -> None:
    text = ZONE.read_text().replace("zone_speed.py:declare", f"tests.check.planted:{name}")
    text = text.replace("../surveillance.xml", str(ROOT / "examples" / "surveillance.xml"))
    file = tmp_path / "zone.toml"
    file.write_text(text)
    assert tomllib.loads(text)
    with pytest.raises(ConfigError) as caught:
        run_mission(load_mission(file))
    assert message in str(caught.value)


# --- certified legs ----------------------------------------------------------------------------------------


class Wants(Node):
    """Publishes what the test wants, if anything."""

    name, publishes, period_s = "wants", ("waypoint",), 0.05

    def __init__(self, topic: Topic[object], wanted: object) -> None:
        self.topic, self.wanted = topic, wanted
        self.engaged = 0
        self.failure: BaseException | None = None

    def engage(self, situation: Situation) -> None:
        self.engaged += 1

    def step(self, situation: Situation) -> None:
        if self.failure is not None:
            raise self.failure
        self.topic.publish(self.wanted)


def certified(wanted: Any, **declared: Any) -> tuple[CertifiedController, Topic[Waypoint], Wants]:
    inner_topic: Topic[object] = Topic("waypoint")
    out: Topic[Waypoint] = Topic("waypoint")
    inner = Wants(inner_topic, wanted)
    station = dock()
    kit = SimpleNamespace(recovery=planner(), dock=station, home=GoHome(0.05, out, planner(), station))
    made = replace(module(sc=inner), **{"phi_safe": None, "lets_go_s": 30.0, **declared})
    if made.phi_safe is not None:
        for each in (kit.recovery, kit.home.recovery):
            each.own_rules = [OwnRule(made.phi_safe, of_pairs=False)]
    return CertifiedController(made, cast("ModuleKit", kit), inner_topic, out), out, inner


def test_a_wish_becomes_a_short_certified_leg_with_its_cap() -> None:
    node, out, _ = certified(Waypoint(4.0, 4.5, speed_m_s=0.1))
    node.step(seen(At(4.0, 2.0)))
    assert out.value is not None
    assert out.value.speed_m_s == 0.1
    assert math.dist((out.value.x_m, out.value.y_m), (4.0, 2.0)) < 0.1


def test_a_wish_that_leads_into_a_box_or_out_of_the_fence_is_held_back() -> None:
    for start, wish in (((4.9, 2.5), (9.0, 2.5)), ((3.2, 3.5), (2.5, 3.5))):
        node, out, _ = certified(Waypoint(*wish))
        x_m, y_m = start
        for _ in range(200):
            node.step(seen(At(x_m, y_m)))
            if out.value is None:
                break
            x_m, y_m = out.value.x_m, out.value.y_m
        assert node.recovery.terrain.fence_m(x_m, y_m) >= 0.0
        assert node.recovery.terrain.clearance_m(x_m, y_m) >= 0.0


@given(st.floats(0.0, math.tau), st.floats(0.0, 0.5), st.tuples(st.floats(-1.0, 6.0), st.floats(-1.0, 6.0)))
def test_whatever_its_controller_wishes_its_own_rule_is_kept(
    bearing_rad: float, away_m: float, wish: tuple[float, float]
) -> None:
    disc = Outside(4.0, 2.0, 0.3)
    node, out, _ = certified(Waypoint(*wish), phi_safe=disc, lets_go_s=math.inf)
    off_m = 0.3 + away_m
    x_m, y_m = 4.0 + off_m * math.cos(bearing_rad), 2.0 + off_m * math.sin(bearing_rad)
    # The robot may have to get away from where it cannot even stand.
    assume(node.recovery.hold_margin(seen(At(x_m, y_m))) >= 0.0)
    for _ in range(60):
        situation = seen(At(x_m, y_m))
        node.step(situation)
        if out.value is None:
            break
        leg = out.value
        for part in range(11):
            on_the_way = At(x_m + part * (leg.x_m - x_m) / 10.0, y_m + part * (leg.y_m - y_m) / 10.0)
            # Between two looks at the margin a leg may pass a round edge a little nearer.
            assert disc.margin(seen(on_the_way)) >= -0.002
        x_m, y_m = leg.x_m, leg.y_m


def test_no_wish_is_a_hold_and_nonsense_fails_the_node() -> None:
    node, out, _ = certified(None)
    node.step(seen(At(4.0, 2.0)))
    assert out.value is None
    for nonsense, error in ((3, TypeError), (Waypoint(math.nan, 0.0), ValueError)):
        with pytest.raises(error):
            certified(nonsense)[0].step(seen(At(4.0, 2.0)))


def test_the_first_driver_of_a_run_takes_charge_too() -> None:
    node, _, inner = certified(Waypoint(4.0, 4.0))
    node.step(seen(At(4.0, 2.0)))
    assert inner.engaged == 1
    node.engage(seen(At(4.0, 2.0)))
    node.step(seen(At(4.0, 2.0)))
    assert inner.engaged == 2


def test_of_two_that_block_each_other_the_later_one_gives_way() -> None:
    for robot_id, gives_way in ((1, False), (2, True)):
        node, out, _ = certified(Waypoint(4.0, 4.5))
        own, peer = At(4.0, 2.0, robot_id=robot_id), At(4.0, 2.34, robot_id=3 - robot_id)
        node.engage(seen(own, [peer]))
        node.step(seen(own, [peer], now_s=1.0))
        blocked = out.value
        assert blocked is None, "the peer is in the way"
        later = [each._replace(stamp_s=9.0) for each in (own, peer)]
        node.step(seen(later[0], later, now_s=9.0))
        assert (out.value is not None) == gives_way
        if out.value is not None:
            assert out.value.y_m < 2.0


def test_under_a_rule_about_pairs_each_gives_way_in_its_turn_though_the_rule_lets_go_in_between() -> None:
    gave_way = set()
    for robot_id in (1, 2):
        node, out, _ = certified(None, model=PairBound(SpeedBound(0.22, 1.0), SpeedBound(0.22, 1.0)))
        for now_s in range(0, 100, 2):
            own, peer = At(4.0, 2.0, robot_id=robot_id), At(4.0, 2.4, robot_id=3 - robot_id)
            at = seen(own._replace(stamp_s=now_s), [peer._replace(stamp_s=now_s)], now_s=float(now_s))
            if now_s % 10 == 0:
                # It was content for a moment, until another rule brought the two together again.
                node.engage(at)
            node.step(at)
            if out.value is not None:
                assert out.value.y_m < 2.0
                gave_way.add((robot_id, now_s // 20))
    assert gave_way == {(1, 2), (1, 4), (2, 1), (2, 3)}


class Room(Region):
    """The robot is west of a line."""

    def __init__(self, east_m: float) -> None:
        self.east_m = east_m

    def margin(self, situation: Situation) -> float:
        return self.east_m - situation.own.x_m

    def edge_margin(self, safer: Region) -> float:
        return 0.0


@pytest.mark.parametrize("starves", [True, False])
def test_one_that_stands_lets_the_robot_go_home_after_as_long_as_its_contract_says(starves: bool) -> None:
    node, out, _ = certified(None)
    node._dock.wants_charge = starves
    own = At(4.0, 1.5)
    node.engage(seen(own))
    for now_s, goes in ((0.0, False), (29.9, False), (30.2, True)):
        node.step(seen(own._replace(stamp_s=now_s), now_s=now_s))
        assert (out.value is not None) == goes
    assert out.value is not None
    assert math.dist((out.value.x_m, out.value.y_m), (1.0, 1.0)) < math.dist((4.0, 1.5), (1.0, 1.0))


def test_one_that_raises_at_every_step_lets_the_robot_go_home_all_the_same() -> None:
    node, out, inner = certified(None)
    inner.failure = ZeroDivisionError("at every step")
    own = At(4.0, 1.5)
    node.engage(seen(own))
    for now_s in (0.0, 29.9):
        with pytest.raises(ZeroDivisionError):
            node.step(seen(own._replace(stamp_s=now_s), now_s=now_s))
    node.step(seen(own._replace(stamp_s=30.2), now_s=30.2))
    assert out.value is not None


def test_one_that_publishes_on_the_robots_own_topic_is_refused() -> None:
    node, out, inner = certified(None)
    inner.topic = cast("Topic[object]", out)
    inner.wanted = Waypoint(9.0, 9.0)
    with pytest.raises(PermissionError, match="published on the robot's own topic"):
        node.step(seen(At(4.0, 1.5)))


@pytest.mark.parametrize("starves", [True, False])
def test_going_to_and_fro_between_it_and_the_battery_counts_as_being_kept_from_charging(starves: bool) -> None:
    node, out, _ = certified(None)
    node._dock.wants_charge = starves
    own = At(4.0, 1.5)
    for now_s in range(0, 40, 4):
        # In between the battery's safe controller brings it back to where this module takes it.
        at = seen(own._replace(stamp_s=float(now_s)), now_s=float(now_s))
        node.engage(at)
        node.step(at)
        assert (out.value is not None) == (starves and now_s > 30)


@pytest.mark.parametrize(("east_m", "goes"), [(4.5, True), (3.99, True), (0.0, False)])
def test_it_does_so_only_where_its_own_rule_allows(east_m: float, goes: bool) -> None:
    # From (1.0, 4.0) the return path leads south, past a box in the west: no farther east, and no farther west.
    node, out, _ = certified(None, phi_safe=Room(east_m))
    own = At(0.5, 4.0)
    node.engage(seen(own))
    node.step(seen(own._replace(stamp_s=31.0), now_s=31.0))
    assert (out.value is not None) == goes


# --- what it asks for -------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", ["0", "-0.1", "nan", "inf", "1e-400"])
def test_a_speed_that_nobody_can_drive_at_is_refused_before_anything_moves(tmp_path: Path, limit: str) -> None:
    text = ZONE.read_text().replace("limit_m_s = 0.1", f"limit_m_s = {limit}")
    text = text.replace("zone_speed.py", str(ZONE.parent / "zone_speed.py"))
    path = tmp_path / "zone.toml"
    path.write_text(text.replace("../surveillance.xml", str(ROOT / "examples" / "surveillance.xml")))
    with pytest.raises(ConfigError, match="speed_m_s is"):
        run_mission(load_mission(path))


def test_a_place_is_chosen_anew_once_the_robot_has_stood_for_a_while() -> None:
    places = [(0.0, 0.0), (3.0, 3.0), (4.0, 4.0)]
    out: Topic[Any] = Topic("wish")
    kit = SimpleNamespace(tick_s=0.05, waypoint=out, recovery=planner())
    node = GoTo(cast("ModuleKit", kit), lambda _: places.pop(0), None)
    node.engage(seen(At(1.0, 1.0)))
    wanted = []
    for now_s, vx_m_s in ((0.0, 0.0), (4.9, 0.0), (5.1, 0.0), (5.2, 0.2), (10.1, 0.2), (15.0, 0.0), (15.2, 0.0)):
        node.step(seen(At(1.0, 1.0, vx_m_s=vx_m_s), now_s=now_s))
        assert out.value is not None
        wanted.append((out.value.x_m, out.value.y_m))
    assert wanted == [(0.0, 0.0)] * 2 + [(3.0, 3.0)] * 4 + [(4.0, 4.0)]


def test_going_to_a_place_that_cannot_be_chosen_says_why_each_time() -> None:
    kit = SimpleNamespace(tick_s=0.05, waypoint=Topic("wanted"), recovery=SimpleNamespace(moves=lambda _: True))

    def chooses(_: object) -> tuple[float, float]:
        raise ZeroDivisionError

    node = GoTo(cast("ModuleKit", kit), chooses, None)
    for ask in (node.engage, node.step, node.step):
        with pytest.raises(ZeroDivisionError):
            ask(seen(At(4.0, 1.5)))
    assert kit.waypoint.value is None


# --- refuges -----------------------------------------------------------------------------------------------


def refuges_beside(rule: OwnRule) -> RefugeFinder:
    recovery = planner()
    recovery.own_rules = [rule]
    finder = RefugeFinder(recovery.terrain, recovery, 0.5, 0.2)
    region = rule.region
    assert isinstance(region, Outside)
    finder.around = [(region.x_m - 0.6, region.y_m - 0.6, region.x_m + 0.6, region.y_m + 0.6)]
    return finder


@pytest.mark.parametrize("x_m", [1.0, 1.3, 1.7])
def test_a_refuge_is_where_no_module_of_the_users_takes_the_robot(x_m: float) -> None:
    safe, safer = Outside(x_m, 0.6, 0.3), Outside(x_m, 0.6, 0.5)
    finder = refuges_beside(OwnRule(safe, of_pairs=False, safer=safer, noise=0.02, needs=0.1, name="keep-out"))
    situation = seen(At(x_m, 0.12))
    legs = finder.kept_way(situation, 0.0)
    assert legs == finder.way(situation, 0.0)
    assert math.dist(legs[-1], (x_m, 0.6)) >= 0.5 + 0.02
    plain = RefugeFinder(finder._terrain, planner(), 0.5, 0.2).way(situation, 0.0)
    assert math.dist(plain[-1], (x_m, 0.6)) < 0.5


def test_if_none_is_anywhere_else_will_do() -> None:
    rule = OwnRule(Outside(2.5, 2.5, 5.0), of_pairs=False, safer=Outside(2.5, 2.5, 6.0), name="keep-out")
    finder, situation = refuges_beside(rule), seen(At(1.0, 0.12))
    assert finder.kept_way(situation, 0.0) == []
    assert finder.way(situation, 0.0)
    assert rule.outside(1, [(1.0, 0.1), *finder.way(situation, 0.0)]).startswith(
        "(1, 0.1), where the margin of phi_safer"
    )
