"""What is tuned is admitted, and a millimetre or a tick less is not."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import admit, declare_all
from soter.check.tune import SAFER, Choice, changed, tune, tune_for
from soter.cli.mission_text import mission_text
from soter.config import load_mission, make_mission
from soter.config.toml_text import toml
from soter.errors import ConfigError, IllFormedModule
from soter.geometry.workspace_xml import parse_workspace
from soter.sdk import Capabilities
from tests.project.source import ROOT

EXAMPLES = ROOT / "examples"
DECLARED = KinematicBackend.robot_class.declared
WORKSPACE = parse_workspace(
    b"""<configuration>
      <dimension x="12" y="8" z="1"/>
      <robots><robot id="1"><start x="2" y="2"/></robot><robot id="2"><start x="10" y="2"/></robot></robots>
      <obstacles><box><low x="5" y="5" z="0"/><high x="6" y="6" z="1"/></box></obstacles>
      <charging_stations>
        <box><low x="1.8" y="1.8" z="0"/><high x="2.2" y="2.2" z="0"/></box>
        <box><low x="9.8" y="1.8" z="0"/><high x="10.2" y="2.2" z="0"/></box>
      </charging_stations>
    </configuration>""",
    "room.xml",
)
# Far enough apart for all but the slowest links.
MISSION = make_mission(
    {"workspace": "room.xml", "rta": {"collision": {"phi_safe_m": 1.0, "phi_safer_m": 3.0}}}, "mission.toml"
)


@st.composite
def promises(draw: st.DrawFn) -> Capabilities:
    """What a robot promises; some promise all that the models need, and some only a top speed and a brake."""

    def between(least: float, most: float) -> float:
        return round(draw(st.floats(least, most)), 4)

    more: dict[str, Any] = {} if draw(st.booleans()) else {"accel_m_s2": None}
    return replace(
        DECLARED, v_max_m_s=between(0.05, 0.5), brake_m_s2=between(0.3, 3.0), latency_s=between(0.0, 0.2),
        sample_age_s=between(0.0, 0.1), jitter_s=between(0.0, 0.05), lease_s=between(0.05, 0.3),
        position_noise_m=between(0.0, 0.02), **more,
    )  # fmt: skip


def well_formed(choice: Choice, promised: Mapping[int, Capabilities]) -> bool:
    """Whether a module is, by itself, on every robot."""
    try:
        for made in declare_all(changed(MISSION, [choice]), WORKSPACE, promised).values():
            module = next(module for module in made.modules if module.name == choice.module)
            module.check(made.timing, MISSION.base_tick_s)
    except IllFormedModule:
        return False
    return True


def parted_m(name: str, promised: Mapping[int, Capabilities]) -> float:
    """What robots are given back at beyond what P3 asks: a body, between two of them."""
    return 2.0 * max(each.body_radius_m for each in promised.values()) if name == "collision" else 0.0


@settings(max_examples=6, deadline=None)
@given(promises(), promises())
def test_what_is_found_is_admitted_and_no_less_is_well_formed(one: Capabilities, other: Capabilities) -> None:
    promised = {1: one, 2: other}
    tuning = tune_for(MISSION, WORKSPACE, promised)
    admission = admit(tuning.mission, WORKSPACE, promised)
    assert bool(tuning.refused) == (admission.refused or bool(admission.unproved))
    for name in SAFER:
        for choice in tuning.trade[name][:1]:
            assert well_formed(choice, promised)
            less = replace(choice, phi_safer=choice.phi_safer - parted_m(name, promised) - 0.001)
            assert not well_formed(less, promised), "a millimetre less"
        shortest_s = min((each.delta_s for each in tuning.trade[name]), default=0.0)
        if shortest_s > MISSION.base_tick_s:
            # With as much room as there may be: it is not phi_safer that is in the way.
            sooner = replace(tuning.found[name], delta_s=shortest_s - MISSION.base_tick_s, phi_safer=3.0)
            assert not well_formed(sooner, promised), "a tick less"


@pytest.mark.parametrize("example", ["surveillance", "thesis", "faults/wrong"])
def test_the_examples_become_less_restrictive(example: str) -> None:
    tuning = tune(load_mission(EXAMPLES / f"{example}.toml", {"backend": "kinematic"}))
    assert not tuning.refused
    for name, found in tuning.found.items():
        today = tuning.today[name]
        assert found.phi_safer - parted_m(name, {1: DECLARED}) <= today.phi_safer
        assert found.usual <= today.usual or today.why_not
    assert tuning.found["battery"].settings == tuning.today["battery"].settings


@pytest.mark.parametrize(
    ("example", "backends"),
    [
        ("surveillance", ["pybullet", "kinematic", "mavlink", "mavsdk", "ros2", "zenoh"]),
        ("unlike-fleet", ["pybullet", "kinematic"]),
    ],
)
def test_the_shipped_numbers_are_the_least_for_all_their_backends_rounded_up(example: str, backends: list[str]) -> None:
    most: dict[str, float] = {}
    shipped = load_mission(EXAMPLES / f"{example}.toml").rta
    for name in backends:
        tuning = tune(load_mission(EXAMPLES / f"{example}.toml", {"backend": name}))
        for module, found in tuning.found.items():
            today = tuning.today[module]
            assert (today.why_not, today.delta_s) == ("", found.delta_s), name
            most[module] = max(most.get(module, 0.0), found.phi_safer)
    for module in SAFER:
        assert 0.0 <= getattr(getattr(shipped, module), SAFER[module]) - most[module] <= 0.02, module


@pytest.mark.parametrize("backend", ["kinematic", "pybullet"])
def test_the_campaign_of_tuned_missions_has_what_is_found(backend: str) -> None:
    campaign = tomllib.loads((EXAMPLES / "campaigns" / "tuned.toml").read_text())
    part = next(each for each in campaign["part"] if each["set"]["backend"] == backend)
    found = tune(load_mission(EXAMPLES / "surveillance.toml", {"backend": backend})).tables()["rta"]
    for module, key in SAFER.items():
        assert part["set"]["rta"][module][key] == found[module][key]
        assert campaign["set"]["rta"][module]["model"] == found[module]["model"]


def test_the_whole_mission_can_be_written_and_read(tmp_path: Path) -> None:
    given = {"backend": "kinematic", "battery.initial": {2: 0.17}, "fault": [{"kind": "bias", "x_m": 0.01}]}
    tuning = tune(load_mission(EXAMPLES / "surveillance.toml", given))
    path = tmp_path / "tuned.toml"
    path.write_text(mission_text(tuning.mission, tuning.changes(), path, "tuned"))
    read = load_mission(path)
    assert read.model_dump(exclude={"workspace"}) == tuning.mission.model_dump(exclude={"workspace"})
    assert read.workspace.resolve() == tuning.mission.workspace.resolve()


def test_a_battery_that_is_ill_formed_gets_what_p3_asks_for() -> None:
    given = {"backend": "kinematic", "rta.battery.phi_safer": 0.05}
    tuning = tune(load_mission(EXAMPLES / "surveillance.toml", given))
    assert tuning.today["battery"].why_not.startswith("P3")
    assert not tuning.refused
    assert 0.05 < tuning.found["battery"].phi_safer < 0.2


def test_where_nothing_would_do_it_says_why() -> None:
    late = {"backend": "kinematic", "fault": [{"kind": "delay", "commands_s": 0.5}]}
    tuning = tune(load_mission(EXAMPLES / "surveillance.toml", late))
    assert not tuning.trade["collision"]
    assert tuning.refused[0].module == "collision"


def test_a_phi_safer_that_starts_have_no_room_for_is_not_proposed(tmp_path: Path) -> None:
    (tmp_path / "room.xml").write_text(
        """<configuration>
          <dimension x="6" y="6" z="1"/>
          <robots><robot id="1"><start x="2.185" y="3"/></robot></robots>
          <obstacles><box><low x="1" y="1" z="0"/><high x="2" y="5" z="1"/></box></obstacles>
          <charging_stations><box><low x="4.8" y="2.8" z="0"/><high x="5.2" y="3.2" z="0"/></box></charging_stations>
        </configuration>"""
    )
    path = tmp_path / "mission.toml"
    path.write_text('workspace = "room.xml"\nbackend = "kinematic"\nrta.obstacle.phi_safer_m = 0.01\n')
    with pytest.raises(ConfigError, match=r"start of robot 1: .* only 0\.080 m from a box"):
        tune(load_mission(path))


TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False) | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(TEXTS, VALUES, max_size=4))
def test_tables_are_what_they_were_once_they_are_read(tables: dict[str, Any]) -> None:
    assert tomllib.loads(toml(tables)) == tables
