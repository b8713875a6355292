"""What may be run: what is refused before a robot is opened, and what is run although it is not proved."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NoReturn

import pytest
from typer.testing import CliRunner

from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import Admission, admit, declare_all
from soter.check.conditions import Certainty, Finding
from soter.cli import app
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError, IllFormedModule
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.record.reader import Recording
from soter.runner import run_mission
from soter.sdk import Capabilities
from soter.stack.assembly import Study
from soter.stack.own_rules import broken_on
from tests.project.source import ROOT

SURVEILLANCE = ROOT / "examples" / "surveillance.toml"
QUICK: dict[str, object] = {"backend": "kinematic", "planner": "straight-line", "duration_s": 1.0}
GAP = Finding("battery", "P2b", Certainty.PARTLY, "2 robots wait for up to 812 s, and 700 s are paid for")


class NeverOpened(KinematicBackend):
    def open(self, config: Any, robots: Any) -> NoReturn:
        raise AssertionError("it was opened")


def mission(**changes: object) -> MissionFile:
    return load_mission(SURVEILLANCE, {**QUICK, **changes})


def promised(loaded: MissionFile) -> dict[int, Capabilities]:
    return {place.id: KinematicBackend.robot_class.declared for place in loaded.read_workspace().robots}


@pytest.fixture
def gap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every mission is well-formed, and has a gap in one proof."""
    monkeypatch.setattr("soter.check.mission.admit_declared", lambda *_: Admission([], [GAP]))


@pytest.mark.parametrize("example", ["surveillance", "warehouse", "thesis", "modules/zone"])
@pytest.mark.parametrize("collision_s", [0.1, 0.5, 3.0])
def test_what_is_admitted_is_run_and_the_rest_is_refused_with_the_same_words(example: str, collision_s: float) -> None:
    loaded = load_mission(
        ROOT / "examples" / f"{example}.toml", {**QUICK, "robots": 1, "rta.collision.delta_s": collision_s}
    )
    admitted = admit(loaded, loaded.read_workspace(), promised(loaded))
    assert admitted.refused is (admitted.ill_formed is not None)
    if admitted.ill_formed is None:
        # Trials of the zone would take longer than all the rest.
        done = run_mission(loaded, accept_unproved=example == "modules/zone")
        assert done.result.status == "completed"
        return
    with pytest.raises(IllFormedModule, match=re.escape(admitted.ill_formed.text)):
        run_mission(loaded)


def test_a_station_that_no_way_leads_to_is_rejected_before_anything_is_opened() -> None:
    wall, station = Box(0.0, 1.9, 5.0, 2.1), Box(0.8, 2.8, 1.2, 3.2)
    room = Workspace(5.0, 5.0, (wall,), (RobotPlace(1, 1.0, 1.0, station),))
    admitted = admit(mission(robots=1), room, {1: KinematicBackend.robot_class.declared})
    assert admitted.ill_formed is not None
    assert (admitted.ill_formed.module, admitted.ill_formed.condition) == ("battery", "P2b")
    assert "(1, 1)" in admitted.ill_formed.text, "it names the place"


def test_a_rule_of_the_users_that_stations_are_too_near_for_is_rejected_with_the_margin() -> None:
    own = {"declare": "soter.campaign.random.attackers:declare_far", "options": {"far_m": 1.0, "spare_m": 0.3}}
    stations = (Box(0.8, 0.8, 1.2, 1.2), Box(1.95, 0.8, 2.35, 1.2))
    near = Workspace(5.0, 5.0, (), (RobotPlace(1, 1.0, 1.0, stations[0]), RobotPlace(2, 3.0, 3.0, stations[1])))
    loaded = mission(**{"rta.module.far": own})
    found = admit(loaded, near, {1: KinematicBackend.robot_class.declared, 2: KinematicBackend.robot_class.declared})
    assert found.ill_formed is not None
    assert (found.ill_formed.module, found.ill_formed.condition) == ("far", "P2b")
    assert "-0.150 m" in found.ill_formed.text


def _gaps(loaded: MissionFile, room: Workspace) -> set[tuple[str, str]]:
    capabilities = {each.id: KinematicBackend.robot_class.declared for each in room.robots}
    unproved = admit(loaded, room, capabilities).unproved
    return {(each.module, each.condition) for each in unproved if each.verdict is Certainty.PARTLY}


def _hall(*places: tuple[float, float]) -> Workspace:
    robots = [
        RobotPlace(number, x_m, y_m, Box(x_m - 0.2, y_m - 0.2, x_m + 0.2, y_m + 0.2))
        for number, (x_m, y_m) in enumerate(places, start=1)
    ]
    return Workspace(2.4, 2.4, (), tuple(robots))


@pytest.mark.parametrize(
    ("modules", "gap"),
    [(["geofence"], ("geofence", "P2b")), (["geofence", "battery"], ("battery", "P2a")), (["collision"], None)],
)
def test_several_robots_of_whom_none_makes_way_are_a_gap(modules: list[str], gap: tuple[str, str] | None) -> None:
    loaded = mission(**{"rta.modules": modules})
    assert _gaps(loaded, _hall((0.5, 0.5), (1.9, 1.9))) == ({gap} if gap else set())
    assert _gaps(loaded, _hall((0.5, 0.5))) == set()


@pytest.mark.parametrize(("phi_safer_m", "far_m", "gap"), [(0.6, None, False), (2.2, None, True), (0.6, 1.3, True)])
def test_a_room_needs_one_place_more_than_robots(phi_safer_m: float, far_m: float | None, gap: bool) -> None:
    """2.2 m apart two robots have room in opposite corners, and no third place to get past each other by."""
    keys: dict[str, object] = {"rta.collision.phi_safer_m": phi_safer_m}
    if far_m is not None:
        own = {"declare": "soter.campaign.random.attackers:declare_far", "options": {"far_m": far_m, "spare_m": 0.9}}
        keys["rta.module.far"] = own
    assert (("collision", "P2b") in _gaps(mission(**keys), _hall((0.35, 0.35), (2.05, 2.05)))) is gap


DISC = "soter.campaign.random.attackers:declare_keep_out"


@pytest.mark.parametrize("radius_m", [0.1, 0.3, 0.5])
def test_return_paths_lead_around_what_a_rule_of_the_users_forbids(radius_m: float) -> None:
    """A disc in the middle of the hall, from behind which the straight way to the station would lead through it."""
    room = Workspace(5.0, 5.0, (), (RobotPlace(1, 1.0, 2.5, Box(0.8, 2.3, 1.2, 2.7)),))
    options = {"x_m": 2.5, "y_m": 2.5, "radius_m": radius_m, "spare_m": 0.3}
    loaded = mission(robots=1, **{"rta.module.disc": {"declare": DISC, "options": options}})
    assert _gaps(loaded, room) == set()
    (made,) = declare_all(loaded, room, {1: KinematicBackend.robot_class.declared}).values()
    rule = made.module("disc").phi_safe
    assert rule is not None
    assert broken_on(rule, 1, [(4.0, 2.5), (1.0, 2.5)]) is not None
    for y_m in (2.0, 2.5, 2.6, 3.1):
        line = [(4.0, y_m), *made.dock.path.legs(4.0, y_m)]
        assert line[-1] == (1.0, 2.5)
        assert broken_on(rule, 1, line) is None


@pytest.mark.parametrize("x_m", [0.6, 2.4])
def test_a_robot_that_a_rule_of_the_users_cuts_off_from_its_station_is_refused(x_m: float) -> None:
    """The disc fills the only gap in a wall; who starts in front of it never gets behind it."""
    room = Workspace(3.0, 2.0, (Box(1.2, 0.0, 1.4, 0.8), Box(1.2, 1.2, 1.4, 2.0)), (
        RobotPlace(1, x_m, 1.0, Box(0.3, 0.8, 0.7, 1.2)),))  # fmt: skip
    options = {"x_m": 1.3, "y_m": 1.0, "radius_m": 0.15, "spare_m": 0.2}
    loaded = mission(robots=1, **{"rta.module.disc": {"declare": DISC, "options": options}})
    refused = admit(loaded, room, {1: KinematicBackend.robot_class.declared}).ill_formed
    assert (refused is not None) is (x_m > 1.3)
    if refused is not None:
        assert (refused.module, refused.condition) == ("battery", "P2b")
        assert f"({x_m:g}, 1)" in refused.text


def test_a_refused_mission_opens_nothing() -> None:
    name = f"{__name__}:NeverOpened"
    with pytest.raises(IllFormedModule, match="P3"):
        run_mission(mission(backend=name, **{"rta.collision.delta_s": 1.0}))
    with pytest.raises(AssertionError, match="it was opened"):
        run_mission(mission(backend=name))


@pytest.mark.usefixtures("gap")
def test_a_gap_is_refused_with_the_place_and_the_numbers_unless_it_is_accepted(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"surveillance.toml.*rta.battery: P2b of .* PARTLY: 2 robots wait .* 812 s"):
        run_mission(mission(backend=f"{__name__}:NeverOpened"))
    path = tmp_path / "run.mcap"
    accepted = run_mission(mission(), accept_unproved=True, record=path).result.accepted_unproved
    assert accepted == (f"P2b of module 'battery' is PARTLY: {GAP.text}",)
    assert Recording(path).about.accepted_unproved == accepted
    assert run_mission(mission(), study=Study()).result.accepted_unproved == accepted, "studies are questions"


def test_a_module_of_predicates_is_run_only_if_what_its_author_claims_is_accepted() -> None:
    own = {"rta.module.own": {"declare": "tests.check.planted:predicates"}}
    with pytest.raises(ConfigError, match=r"rta\.module\.own: P3 of module 'own' is ASSUMED: given by predicates"):
        run_mission(mission(backend=f"{__name__}:NeverOpened", **own))
    accepted = run_mission(mission(duration_s=1.0, **own), accept_unproved=True).result.accepted_unproved
    # Of ways home through its rule nobody knows anything either; and what is accepted is not tried.
    assert [each.partition(":")[0] for each in accepted] == [
        "P3 of module 'own' is ASSUMED", "P2c of module 'own' is PARTLY",
        "P2a of module 'own' is ASSUMED", "P2b of module 'own' is ASSUMED",
    ]  # fmt: skip


@pytest.mark.usefixtures("gap")
def test_the_command_line_refuses_a_gap_with_2_and_says_what_was_accepted(tmp_path: Path) -> None:
    words = ["run", str(SURVEILLANCE), "--backend", "kinematic", "--planner", "straight-line", "--duration", "1"]
    words += ["--json", str(tmp_path / "result.json")]
    recording = str(tmp_path / "run.mcap")
    refused = CliRunner().invoke(app, [*words, "--no-record"])
    assert refused.exit_code == 2
    assert "--accept-unproved" in refused.stderr
    done = CliRunner().invoke(app, [*words, "--record", recording, "--accept-unproved"])
    assert done.exit_code == 0, done.output
    assert "not proved" in done.stdout
    assert GAP.text in json.loads((tmp_path / "result.json").read_text())["accepted_unproved"][0]
    assert f"{GAP.text} (accepted)" in CliRunner().invoke(app, ["info", recording]).stdout


def test_without_modules_there_is_nothing_to_prove() -> None:
    loaded = mission(**{"rta.enabled": False})
    assert admit(loaded, loaded.read_workspace(), promised(loaded)) == Admission([], [])


def test_verdicts_of_an_admission() -> None:
    def of(*verdicts: Certainty) -> Admission:
        return Admission([], [Finding("battery", "P2a", verdict, "") for verdict in verdicts])

    assert (of(Certainty.PROVED).refused, of(Certainty.PROVED).unproved) == (False, [])
    assert not of(Certainty.PARTLY).refused
    assert of(Certainty.REJECTED).refused
    assert len(of(Certainty.PROVED, Certainty.PARTLY, Certainty.ASSUMED, Certainty.REJECTED).unproved) == 3
