"""Shipped, registered and users' modules come through one seam: a kit and a table of options."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

import pytest

from soter import ModuleKit
from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import declare_all
from soter.config import MissionFile, load_mission
from soter.config.tables import MODULES, GeofenceTable
from soter.errors import ConfigError
from soter.rta import RTAModule, Situation, Topic
from soter.sdk import Waypoint
from soter.stack import modules
from soter.stack.battery import GoHome
from soter.stack.certified_controller import CertifiedController
from soter.stack.declaration import Declared
from soter.stack.modules import BUILT_IN, geofence
from soter.stack.recovery import Leg
from soter.stack.right_of_way import RightOfWay
from soter.stack.safe_controller import SafeController
from tests.project.source import ROOT
from tests.rta.doubles import At

MISSION = ROOT / "examples" / "surveillance.toml"


def declared(**overrides: object) -> Declared:
    mission = load_mission(str(MISSION), overrides)
    promised = {1: KinematicBackend.robot_class.declared, 2: KinematicBackend.robot_class.declared}
    return declare_all(mission, mission.read_workspace(), promised)[1]


def own(name: str, **options: object) -> dict[str, object]:
    return {"rta.module.mine": {"declare": name, "options": options}}


def within(kit: ModuleKit) -> RTAModule:
    """A geofence that goes to a refuge, as a distribution of somebody else's may have it."""
    return replace(geofence.declare(kit, GeofenceTable()), name="whatever")


def homing(kit: ModuleKit) -> RTAModule:
    return replace(within(kit), sc=kit.home)


class Elsewhere(GoHome):
    """Goes home by legs that nobody certified."""

    def motion(self, situation: Situation) -> Any:
        return Leg(4.0, 4.0)


def homing_elsewhere(kit: ModuleKit) -> RTAModule:
    return replace(within(kit), sc=Elsewhere(kit.tick_s, Topic("waypoint"), kit.recovery, kit.dock))


class Uncertified(SafeController):
    """Chooses a place that nobody has certified a leg to."""

    def motion(self, situation: Situation) -> Any:
        return Waypoint(4.0, 4.0)


def test_shipped_modules_are_registered_as_those_of_others_are() -> None:
    assert {each.name: each.value for each in entry_points(group=modules.ENTRY_POINT_GROUP)} == dict(BUILT_IN)
    assert tuple(BUILT_IN) == MODULES


def test_a_registered_module_is_declared_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    registered = EntryPoints([EntryPoint("within", f"{__name__}:within", modules.ENTRY_POINT_GROUP)])
    monkeypatch.setattr(modules, "entry_points", lambda **which: registered.select(**which))
    made = declared(**own("within"))
    mine = made.module("mine")
    assert mine.name == "mine"
    assert mine in made.own
    # Its safe controller drives by certified legs itself, and is held to the contract all the same.
    assert mine.sc.name == "move-inside"
    assert isinstance(mine.sc, CertifiedController)
    assert mine.lets_go_s == modules.LETS_GO_S


def test_one_whose_safe_controller_drives_home_needs_nobody_to_hold_it_to_the_contract() -> None:
    mine = declared(**own(f"{__name__}:homing")).module("mine")
    assert type(mine.sc) is GoHome
    other = declared(**own(f"{__name__}:homing_elsewhere")).module("mine")
    assert isinstance(other.sc, CertifiedController), "a subclass may do anything"


def test_a_shipped_module_may_be_had_twice_with_options_of_its_own() -> None:
    made = declared(**own("geofence", phi_safer_inset_m=0.4))
    shipped, mine = made.module("geofence"), made.module("mine")
    assert mine.edge_margin() == pytest.approx(0.4)
    assert shipped.edge_margin() == pytest.approx(0.1)
    made.check(0.05)


def test_a_name_that_nobody_registered_is_refused_with_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"rta\.module\.mine\.declare.*'geofense'.*battery, collision, geofence"):
        declared(**own("geofense"))


def test_a_safe_controller_that_chooses_what_nobody_certified_fails() -> None:
    made = declared()
    node = Uncertified("mine", 0.05, Topic("waypoint"), made.recovery)
    situation = Situation(1, At(1.0, 1.0), 0.0)
    with pytest.raises(TypeError, match="'mine' chose a Waypoint, which is no certified leg"):
        node.step(situation)
    assert node.waypoint.value is None


def test_the_kit_has_what_every_module_needs() -> None:
    kits: dict[str, ModuleKit] = {}
    mission: MissionFile = load_mission(str(MISSION))

    def keep(mission: MissionFile, kit: ModuleKit, waypoint: Topic[Any]) -> RTAModule:
        kits[kit.name] = kit
        return modules.declare_module(mission, kit, waypoint)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("soter.stack.declaration.declare_module", keep)
        declared()
    assert tuple(kits) == mission.rta.order
    assert all(isinstance(kit.right_of_way, RightOfWay) for kit in kits.values())
    assert len({id(kit.motion("speed")) for kit in kits.values()}) == 1
