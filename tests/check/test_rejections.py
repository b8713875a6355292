"""Every text with which a module is rejected as ill-formed is brought about here, wherever in SOTER it stands."""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import declare_all, refused_at
from soter.check.conditions import Certainty, conditions
from soter.check.mission import admitted
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import load_backend
from soter.rta import PairBound, ReachModel, RTAModule, Sample, SpeedBound, Timing, Topic
from soter.specs import read_options
from soter.stack.collision import Separation, check_halves
from soter.stack.module_kit import ModuleKit
from soter.stack.reach import MotionLimits
from tests.check.planted import EastOf, right
from tests.project.source import ROOT
from tests.rta.doubles import TICK_S, Above, FakeNode, module
from tests.runner.test_speedup import HastyBackend, mission


class InFives(Above):
    """A region whose margins are in no unit that has a name."""

    unit = 5  # type: ignore[assignment]


PROMISED = KinematicBackend.robot_class.declared


class Other(ReachModel):
    """A model of a user's own, of pairs."""

    of_pairs = True

    def bound(self, time_s: float) -> float:
        return time_s

    def of_own(self) -> ReachModel:
        return self

    def admits(self, before: Sample, after: Sample, noise_m: float) -> bool:
        return True


def pair(brake_m_s2: float = 1.0) -> RTAModule:
    speed, node = SpeedBound(0.22, brake_m_s2), FakeNode("node")
    safe, safer = Separation(0.3, 0.22), Separation(0.5, 0.22)
    return RTAModule("collision", node, node, 0.1, safe, safer, PairBound(speed, speed))


def station(
    x_m: float, y_m: float, *boxes: Box, start: tuple[float, float] = (1.0, 1.0), half_m: float = 0.1,
    beside: tuple[RobotPlace, ...] = (),
) -> None:  # fmt: skip
    """Check a robot that charges around a place, in a room with some boxes and with other robots' stations."""
    asked = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic"})
    charger = Box(x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m)
    workspace = Workspace(5.0, 5.0, boxes, (RobotPlace(1, *start, charger), *beside))
    declared = declare_all(asked, workspace, {robot.id: PROMISED for robot in workspace.robots})
    declared[1].check(asked.base_tick_s)


@pytest.mark.parametrize(
    ("battery", "words"),
    [
        (
            {"drive_s": 0.1, "idle_s": 0.1},
            "no phi_safer would do, since .* battery.drive_s, or .*reserve_factor, would",
        ),
        ({"drive_s": 100.0, "idle_s": 100.0, "reserve_factor": 1.0, "phi_safer": 0.5}, "no phi_safer .*drive_s would"),
        ({"drive_s": 1000.0, "idle_s": 1000.0, "phi_safer": 0.1}, r"a phi_safer whose edge has .* 0\.\d+ of a charge"),
    ],
)
def test_what_would_do_for_a_battery_is_no_more_than_a_charge(battery: dict[str, float], words: str) -> None:
    tables = {f"{'rta.' * (name not in ('drive_s', 'idle_s'))}battery.{name}": value for name, value in battery.items()}
    asked = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic", **tables})
    declared = declare_all(asked, asked.read_workspace(), {1: PROMISED, 2: PROMISED})
    with pytest.raises(IllFormedModule, match=words):
        declared[1].module("battery").check(declared[1].timing, asked.base_tick_s)


def users_rule(modules: list[str], *robots: RobotPlace, name: str = "right", inset_m: float = 0.1) -> None:
    """Admit robots with a module of the user's; `right` wants them east of 1 m."""
    own = {"declare": f"tests.check.planted:{name}"}
    asked = load_mission(
        ROOT / "examples" / "surveillance.toml",
        {
            "backend": "kinematic", "rta.modules": modules, "rta.module": {"own": own},
            "rta.geofence.phi_safer_inset_m": inset_m,
        },
    )  # fmt: skip
    workspace = Workspace(5.0, 5.0, (), robots)
    backend = load_backend("kinematic")
    admitted(asked, workspace, backend, read_options(backend, asked, workspace), ill_formed=False, unproved=True)


def dwelling(dwell_s: float) -> None:
    """Admit two robots whose rule about pairs keeps them for so long once it holds again."""
    asked = load_mission(
        ROOT / "examples" / "surveillance.toml", {"backend": "kinematic", "rta.collision.dwell_s": dwell_s}
    )
    backend, workspace = load_backend("kinematic"), asked.read_workspace()
    admitted(asked, workspace, backend, read_options(backend, asked, workspace), ill_formed=False, unproved=True)


def users_pairs() -> None:
    """Declare a rule about pairs that takes a faster peer for one like the robot."""
    asked = load_mission(
        ROOT / "examples" / "surveillance.toml",
        {"backend": "kinematic", "rta.module": {"own": {"declare": "tests.check.planted:of_equals"}}},
    )
    fleet = {1: PROMISED, 2: replace(PROMISED, v_max_m_s=0.5)}
    declare_all(asked, asked.read_workspace(), fleet)


def hasty() -> None:
    asked = mission(HastyBackend, 20.0)
    workspace = asked.read_workspace()
    config = read_options(HastyBackend, asked, workspace)
    promised = HastyBackend.promises(config)
    declared = declare_all(asked, workspace, {1: promised, 2: promised})[1]
    with pytest.raises(IllFormedModule) as caught:
        declared.check(asked.base_tick_s)
    raise refused_at(caught.value, asked, workspace, HastyBackend, config)


def limits(**changes: object) -> MotionLimits:
    return MotionLimits.of(replace(PROMISED, **changes))  # type: ignore[arg-type]


SLOW, OTHER = FakeNode("slow", period_s=1.0), FakeNode("other")
OTHER.publishes = ("path",)
UNNAMED = FakeNode("unnamed")
UNNAMED.publishes = (Topic("waypoint"), Topic("path"))  # type: ignore[assignment] # what the user has got wrong

# Declarations that fail P1 or P3, by what the text says.
DECLARED: dict[str, tuple[str, RTAModule]] = {
    "delta_s is 0.0": ("P1a", module(delta_s=0.0)),
    "dwell_s is -1.0": ("P1a", module(dwell_s=-1.0)),
    "lets_go_s is -1.0": ("P2c", module(lets_go_s=-1.0)),
    "peers_within_m is -1.0": ("P1a", module(peers_within_m=-1.0)),
    "and not both": ("P3", module(model=None)),
    "the SC 'slow' has a period of 1 s": ("P1a", module(sc=SLOW)),
    "no multiple of the base tick": ("P1a", module(delta_s=0.12)),
    "both must publish the same topics": ("P1b", module(sc=OTHER)),
    "[\"Topic('path')\", \"Topic('waypoint')\"]; both must publish the same topics, at least one, and name them": (
        "P1b",
        module(sc=UNNAMED),
    ),
    "the unit of phi_safe is 5": ("P3", module(phi_safe=InFives())),
    "it fails when it is evaluated": ("P3", module(phi_safer=EastOf())),
    "at the edge of phi_safer it is only 0.010 m": ("P3", module(phi_safer=Above(0.01))),
    "edge_margin of Above returns nan": ("P3", module(phi_safer=Above(math.nan))),
}
EAST = RobotPlace(1, 2.0, 1.0, Box(1.8, 0.8, 2.2, 1.2))
# The others, which need more than a declaration.
OTHERS: dict[str, tuple[str, Callable[[], object]]] = {
    "its rule does not hold where robot 1 starts, at (0.5, 1): the margin is -0.500 m": (
        "A13", lambda: users_rule(["geofence"], RobotPlace(1, 0.5, 1.0, Box(0.8, 0.8, 1.2, 1.2))),
    ),
    "its rule depends on the time: where robot": (
        "P3", lambda: users_rule(["geofence"], EAST, name="grows_with_time"),
    ),
    "lets_go_s is 1e+06, allowed: 0 to 3600": (
        "P2c", lambda: users_rule(["geofence"], EAST, name="holds_for_ever"),
    ),
    "its rule looks at situation.peers, but its model": (
        "P3", lambda: users_rule(
            ["geofence"], RobotPlace(1, 2.0, 1.0, Box(1.8, 0.8, 2.2, 1.2)),
            RobotPlace(2, 4.0, 4.0, Box(3.8, 3.8, 4.2, 4.2)), name="alone",
        ),
    ),
    "keep is -5, allowed: 0 or more": ("P3", lambda: users_rule(["geofence"], EAST, name="adds_to_the_margin")),
    "its safe controller is kit.ac, the advanced controller": (
        "P2a", lambda: users_rule(["geofence"], EAST, name="exchanged"),
    ),
    "delta_s is 1e+09, allowed: above 0, at most 60": (
        "P1a", lambda: users_rule(["geofence"], EAST, name="hardly_ever"),
    ),
    "its rule cannot be judged where robot 1 starts, at (2, 1): KeyError('no map here')": (
        "A13", lambda: users_rule(["geofence"], EAST, name="unheard"),
    ),
    "with each on its station the margin of phi_safer fails: KeyError('no map here')": (
        "P2b", lambda: users_rule(["battery"], EAST, name="unheard_where_it_is_safer"),
    ),
    "with each on its station the margin of phi_safer is": (
        "P2b", lambda: users_rule(["battery"], RobotPlace(1, 2.0, 1.0, Box(0.8, 0.8, 1.2, 1.2))),
    ),
    "more than a quarter of the separation": ("P2a", lambda: check_halves(pair(), Timing(), 0.2)),
    "so that the AC has to lose control": (
        "P2a", lambda: check_halves(pair(brake_m_s2=0.1), Timing(tick_s=TICK_S), 0.05),
    ),
    "has no top speed": ("P2a", lambda: check_halves(replace(pair(), model=Other()), Timing(), 0.05)),
    "or backends.": ("P3", hasty),
    "kit.peer_model would do": ("P3", users_pairs),
    "there is no path for robot 1 from its start at (1, 1)": (
        "P2b", lambda: station(1.0, 3.0, Box(0.0, 1.9, 5.0, 2.1)),
    ),
    "0.015 m from a box": ("P2b", lambda: station(2.5, 1.12, Box(2.0, 0.0, 3.0, 1.0))),
    "0.040 m wide": ("P2b", lambda: station(2.5, 2.5, half_m=0.02)),
    "0.200 m apart": (
        "P2b", lambda: station(2.5, 2.5, beside=(RobotPlace(2, 4.0, 4.0, Box(2.6, 2.4, 2.8, 2.6)),)),
    ),
    "no place can be reached": ("P2b", lambda: station(3.0, 0.175, Box(0.0, 0.35, 5.0, 0.6), start=(1.0, 0.175))),
    "where the margin of phi_safer of 'own' is": (
        "P2b", lambda: users_rule(
            ["battery", "geofence"], RobotPlace(1, 0.15, 1.0, Box(0.0, 0.85, 0.3, 1.15)), name="beside_the_fence",
            inset_m=0.3,
        ),
    ),
    "robot 1 starts at (2.5, 0), 0.000 m from the fence": ("A13", lambda: station(2.5, 2.5, start=(2.5, 0.0))),
    "at most 24 s would do": ("P2b", lambda: dwelling(30.0)),
    "which a robot does not promise": (
        "P3", lambda: limits(heading_noise_rad=None).motion("geofence", "unicycle"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", DECLARED)
def test_a_declaration_that_fails(text: str) -> None:
    condition, made = DECLARED[text]
    found = conditions(made, Timing(), TICK_S)
    assert [each.verdict for each in found[:-1]] == [Certainty.PROVED] * (len(found) - 1)
    assert (found[-1].condition, found[-1].verdict) == (condition, Certainty.REJECTED)
    assert text in found[-1].text


@pytest.mark.parametrize("text", OTHERS)
def test_another_condition_that_fails(text: str) -> None:
    condition, fail = OTHERS[text]
    with pytest.raises(IllFormedModule) as caught:
        fail()
    assert caught.value.condition == condition
    assert text in str(caught.value)


@pytest.mark.parametrize("latency_s", [0.0, 0.05, 0.13])
def test_the_delta_that_would_do_for_two_that_brake_is_a_whole_number_of_ticks_and_does(latency_s: float) -> None:
    timing = Timing(tick_s=TICK_S, latency_s=latency_s)
    with pytest.raises(IllFormedModule) as caught:
        check_halves(pair(brake_m_s2=0.1), timing, 0.05)
    fits_s = caught.value.would_do["delta_s"]
    assert fits_s / TICK_S == pytest.approx(round(fits_s / TICK_S))
    assert f"Delta = {fits_s:g} s would do" in str(caught.value)
    check_halves(replace(pair(brake_m_s2=0.1), delta_s=fits_s), timing, 0.05)


def test_a_declaration_that_holds_says_by_how_much() -> None:
    found = {each.condition: each for each in conditions(module(), Timing(latency_s=0.05), TICK_S)}
    assert {each.verdict for each in found.values()} == {Certainty.PROVED}
    assert "is 2 base ticks;" in found["P1a"].text
    single = conditions(replace(module(), delta_s=TICK_S), Timing(), TICK_S)[0]
    assert "is 1 base tick;" in single.text
    assert found["P3"].figures["reach"] == pytest.approx(0.22 * found["P3"].figures["horizon_s"] + 0.0242)  # type: ignore[operator]
    predicate = conditions(replace(module(), phi_safer=lambda s: True), Timing(), TICK_S)[-1]
    assert "phi_safer is a predicate" in predicate.text
    claimed = replace(module(), model=None, ttf_2delta=lambda s: False)
    assert conditions(claimed, Timing(), TICK_S)[-1].verdict is Certainty.ASSUMED


@cache
def places() -> set[tuple[str, int]]:
    """Every place in SOTER that makes an `IllFormedModule`: file and line."""
    found = set()
    for path in sorted((ROOT / "soter").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "IllFormedModule":
                found.add((str(path), node.lineno))
    return found


def test_there_is_no_other_text(monkeypatch: pytest.MonkeyPatch) -> None:
    made: set[tuple[str, int]] = set()
    original = IllFormedModule.__init__

    def note(self: IllFormedModule, module: str, condition: str, message: str, *more: Any, **named: Any) -> None:
        caller = sys._getframe(1)
        # Where the call begins, whichever of its lines is being run.
        file = str(Path(caller.f_code.co_filename))
        made.add((file, max((line for path, line in places() if path == file and line <= caller.f_lineno), default=0)))
        original(self, module, condition, message, *more, **named)

    monkeypatch.setattr(IllFormedModule, "__init__", note)
    for _, declared in DECLARED.values():
        conditions(declared, Timing(), TICK_S)
    for _, fail in OTHERS.values():
        with pytest.raises(IllFormedModule):
            fail()
    assert made == places(), "a text without a test: add what brings it about to the tables above"


class BoundFails(SpeedBound):
    def bound(self, time_s: float) -> float:
        raise KeyError("no bound")


def fails(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), model=BoundFails(0.22, 1.0))


def test_a_users_model_that_fails_is_a_finding_and_no_fault_of_ours() -> None:
    asked = load_mission(
        ROOT / "examples" / "surveillance.toml",
        {"backend": "kinematic", "rta.module": {"own": {"declare": f"{__name__}:fails"}}},
    )
    declared = declare_all(asked, asked.read_workspace(), {1: PROMISED, 2: PROMISED})
    with pytest.raises(IllFormedModule, match="it fails when it is evaluated: KeyError"):
        declared[1].module("own").check(declared[1].timing, asked.base_tick_s)
