"""Declarations of a user's own that no condition can be asked about, or whose figures would make one say nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest

from soter.check.admission import admit
from soter.config import load_mission
from soter.errors import ConfigError
from soter.rta import Region, RTAModule, Situation, SpeedBound
from soter.specs import promises_of
from soter.stack.module_kit import ModuleKit
from tests.check.planted import DECLARED, EastOf, right
from tests.project.source import ROOT

CHANGES: dict[str, Any] = {}
MADE = replace(DECLARED, keep="wide")  # type: ignore[arg-type]


def changed(kit: ModuleKit) -> RTAModule:
    return replace(right(kit), **CHANGES)


@dataclass(frozen=True)
class Noisy(EastOf):
    wrong_m: float = 0.0

    def noise(self, noise_m: float) -> float:
        return self.wrong_m


class Backwards(SpeedBound):
    def bound(self, time_s: float) -> float:
        return -1.0


class Silent(Region):
    """Its margin fails wherever it is asked."""

    def __init__(self, answer: object) -> None:
        self.answer = answer

    def margin(self, situation: Situation) -> Any:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def edge_margin(self, safer: Region) -> float:
        return 1.0


def verdict(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> str:
    """Return why a mission with the declaration is refused; empty if it is admitted."""
    monkeypatch.setattr("tests.stack.test_usable.CHANGES", changes)
    declared = {"declare": "tests.stack.test_usable:changed"}
    file = ROOT / "examples" / "surveillance.toml"
    mission = load_mission(file, {"backend": "kinematic", "rta.module": {"own": declared}})
    workspace = mission.read_workspace()
    admission = admit(mission, workspace, promises_of(mission, workspace))
    return "" if admission.ill_formed is None else f"{admission.ill_formed.condition}: {admission.ill_formed.text}"


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        *((each, "0.05", "a number") for each in ("delta_s", "dwell_s", "keep", "lets_go_s", "peers_within_m")),
        ("delta_s", None, "a number"),
        ("ac", None, "a soter.Node"),
        ("phi_safe", 0.5, "a soter.Region"),
        ("phi_safer", "far", "a soter.Region, or a function"),
        ("phi_safer", None, "a soter.Region, or a function"),
        ("model", "speed", "a reach model"),
    ],
)
def test_fields_of_other_types_are_named(
    monkeypatch: pytest.MonkeyPatch, field: str, value: object, allowed: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        verdict(monkeypatch, **{field: value})
    assert f"rta.module.own.declare: 'tests.stack.test_usable:changed' gives {value!r} as {field}" in str(caught.value)
    assert f"allowed: {allowed}" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "refused"),
    [
        ({"keep": -5.0}, "P3: keep is -5, allowed: 0 or more"),
        ({"keep": math.nan}, "P3: keep is nan, allowed: 0 or more"),
        ({"phi_safe": Noisy(wrong_m=-3.0)}, "P3: the noise of phi_safe is -3, allowed: 0 or more"),
        ({"phi_safe": Noisy(wrong_m=math.nan)}, "P3: the noise of phi_safe is nan, allowed: 0 or more"),
        ({"model": Backwards(0.22, 1.0)}, "P3: the bound of the model is -1, allowed: 0 or more"),
        ({"lets_go_s": math.nan}, "P2c: lets_go_s is nan, allowed: 0 or more"),
        ({"delta_s": 1e9}, "P1a: delta_s is 1e+09, allowed: above 0, at most 60"),
    ],
)
def test_figures_that_would_add_to_the_margin_or_take_for_ever_are_refused(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], refused: str
) -> None:
    assert verdict(monkeypatch, **changes) == refused


@pytest.mark.parametrize("answer", ["1", None, [1.0, 2.0], math.nan, RuntimeError("no map here")])
def test_a_rule_that_cannot_be_judged_where_robots_start_or_charge_is_refused(
    monkeypatch: pytest.MonkeyPatch, answer: object
) -> None:
    why = verdict(monkeypatch, phi_safe=Silent(answer), phi_safer=Silent(0.0))
    assert why.startswith("A13: its rule cannot be judged where robot 1 starts, at (1, 1): ")
    assert "no map here" in why or not isinstance(answer, Exception)
    why = verdict(monkeypatch, phi_safe=Silent(1.0), phi_safer=Silent(answer))
    assert why.startswith("P2b: ")
    assert "margin of phi_safer fails" in why or "margin of phi_safer of 'own' is nan" in why


def test_a_declaration_as_it_should_be_is_admitted(monkeypatch: pytest.MonkeyPatch) -> None:
    fits = {"phi_safe": EastOf(0.3), "phi_safer": EastOf(0.6)}
    assert verdict(monkeypatch, **fits) == ""
    assert verdict(monkeypatch, **fits, keep=0.02, dwell_s=1, peers_within_m=0) == ""


def test_a_declaration_made_beforehand_is_looked_at_as_well() -> None:
    declared = {"declare": "tests.stack.test_usable:MADE"}
    mission = load_mission(
        ROOT / "examples" / "surveillance.toml", {"backend": "kinematic", "rta.module": {"own": declared}}
    )
    workspace = mission.read_workspace()
    with pytest.raises(ConfigError, match="gives 'wide' as keep, allowed: a number"):
        admit(mission, workspace, promises_of(mission, workspace))
