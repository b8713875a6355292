"""Mission files: defaults, overrides, and options of others."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from soter.config import draw_charge, load_mission, validate_options
from soter.config.tables import MODULES
from soter.errors import ConfigError
from tests.config.text import HEAD, error, mission

ROOM = Path(__file__).parents[2] / "examples" / "surveillance.xml"


def test_defaults_are_those_of_the_design() -> None:
    made = mission()
    assert (made.mission.use, made.options, made.targets_from) == ("surveillance", {}, "grid")
    assert (made.backend, made.planner, made.robots.count) == ("pybullet", "ompl-bitstar", None)
    assert (made.target_timeout_s, made.base_tick_s) == (120.0, 0.05)
    assert (made.battery.drive_s, made.battery.idle_s, made.battery.charge_s) == (1800.0, 7200.0, 60.0)
    assert made.battery.initial is None
    assert made.rta.enabled
    assert made.rta.modules == MODULES == ("collision", "obstacle", "geofence", "battery")
    assert [getattr(made.rta, name).delta_s for name in MODULES] == [0.05, 0.05, 0.05, 1.0]
    assert {getattr(made.rta, name).dwell_s for name in MODULES} == {0.3}
    assert (made.rta.collision.phi_safe_m, made.rta.collision.phi_safer_m) == (0.3, 0.7)
    assert (made.rta.obstacle.phi_safe_m, made.rta.obstacle.phi_safer_m) == (0.0, 0.1)
    assert made.rta.geofence.phi_safer_inset_m == 0.1
    assert (made.rta.battery.phi_safer, made.rta.battery.reserve_factor) == (0.85, 4.0)
    assert (made.backends, made.planners) == ({}, {})


def test_a_mission_is_frozen() -> None:
    with pytest.raises(ValidationError):
        mission().seed = 2  # type: ignore[misc]


def test_a_mission_survives_the_way_to_another_process() -> None:
    made = mission("[battery.initial]\n2 = 0.5\n")
    assert pickle.loads(pickle.dumps(made)) == made  # noqa: S301 - our own bytes


def test_modules_have_one_order() -> None:
    assert mission('[rta]\nmodules = ["battery", "collision"]\n').rta.modules == ("collision", "battery")
    assert mission("[rta]\nmodules = []\n").rta.modules == ()


def test_initial_charge_as_a_table_or_a_list() -> None:
    assert mission("[battery.initial]\n2 = 0.17\n").battery.initial == {2: 0.17}
    assert mission("battery.initial = { 7 = 1 }\n").battery.initial == {7: 1.0}
    assert mission("[battery]\ninitial = [0.5, 0.6]\n").battery.initial == {1: 0.5, 2: 0.6}


def test_initial_charge_is_given_or_drawn() -> None:
    made = mission("seed = 3\n[battery.initial]\n2 = 0.17\n")
    assert made.initial_charge(2) == 0.17
    assert made.initial_charge(1) == draw_charge(3, 1)


def test_the_drawing_is_pinned() -> None:
    # A change here changes every run of every seed.
    drawn = [round(draw_charge(seed, robot_id), 6) for seed in (0, 1, 2) for robot_id in (1, 2)]
    assert drawn == [0.784394, 0.658594, 0.854303, 0.765457, 0.877734, 0.728341]
    many = [draw_charge(seed, robot_id) for seed in range(50) for robot_id in range(1, 7)]
    assert min(many) >= 0.60
    assert max(many) <= 1.00
    assert len(set(many)) == len(many)


# --- overrides ---------------------------------------------------------------------------------------------


def test_overrides_take_the_place_of_the_file() -> None:
    made = mission(
        "seed = 1\n[rta.collision]\ndelta_s = 0.1\n",
        {
            "seed": 4,
            "rta.collision.delta_s": 0.2,
            "rta.modules": ["collision"],
            "battery.initial": [0.5, 0.6],
            "backends.kinematic.rate_hz": 20,
            'planners."my.module:Planner".checks': 7,
        },
    )
    assert (made.seed, made.rta.collision.delta_s, made.rta.modules) == (4, 0.2, ("collision",))
    assert made.battery.initial == {1: 0.5, 2: 0.6}
    assert made.backends == {"kinematic": {"rate_hz": 20}}
    assert made.planners == {"my.module:Planner": {"checks": 7}}


@pytest.mark.parametrize(
    ("text", "overrides"),
    [("", {"robots": 2}), ("robots = 2\n", {}), ("robots.1.v_max_m_s = 0.2\n", {"robots": 2})],
)
def test_a_number_of_robots_goes_with_promises_of_single_ones(text: str, overrides: dict[str, object]) -> None:
    made = mission(text, {**overrides, "robots.2.v_max_m_s": 0.3})
    assert made.robots.count == 2
    assert made.robots.promises[2].v_max_m_s == 0.3


def test_none_is_not_given() -> None:
    assert mission("seed = 5\n", {"seed": None, "rta.enabled": None}).seed == 5


def test_overrides_are_not_changed() -> None:
    battery: dict[str, object] = {"drive_s": 900.0}
    mission("", {"battery": battery, "battery.idle_s": 3600.0})
    assert battery == {"drive_s": 900.0}


def test_an_override_mends_the_file() -> None:
    assert mission("seed = -1\n", {"seed": 1}).seed == 1


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        ({"seed": -1}, "command line: seed: it is -1, allowed: at least 0"),
        ({"sed": 1}, "command line: sed: unknown key, did you mean 'seed'?; allowed: mission, "),
        ({"seed.x": 1}, "command line: seed.x: there is no such key: its parent is not a table"),
        ({"": 1}, "command line: '': there is no such key"),
        ({"robots": 0, "robots.2.v_max_m_s": 0.3}, "command line: robots.count: it is 0, allowed: at least 1"),
        ({"robots": 1, "robots.count": 2}, "command line: robots: it is given twice, also as robots.count"),
        ({"rta.colision.delta_s": 1}, "command line: rta.colision: unknown key, did you mean 'collision'?; allowed: "),
        ({"rta.collision.delta_s": 0.07}, "command line: rta.collision.delta_s: it is 0.07, allowed: a multiple of"),
        (
            {"rta.modules": ["colision"]},
            (
                "command line: rta.modules.0: it is 'colision', allowed: 'collision', "
                "'obstacle', 'geofence' or 'battery', did you mean 'collision'?"
            ),
        ),
    ],
)
def test_a_wrong_override_is_blamed_on_the_command_line(overrides: dict[str, object], expected: str) -> None:
    assert error("seed = 1\n", overrides).startswith(expected)


def test_a_table_of_the_file_is_not_blamed_on_the_command_line() -> None:
    """An override in the same table does not make it one of the command line."""
    for text in ('[rta.collision]\nphi_safe_m = "x"\n', '\nrta.collision.phi_safe_m = "x"\n'):
        found = error(text, {"rta.collision.delta_s": 0.2})
        assert found.startswith("m.toml:3: rta.collision.phi_safe_m: it is 'x', allowed: a number")


# --- files -------------------------------------------------------------------------------------------------


def written(folder: Path, text: str) -> Path:
    (folder / "room.xml").write_text(ROOM.read_text())
    path = folder / "m.toml"
    path.write_text(HEAD + text)
    return path


def test_the_workspace_is_looked_for_beside_the_mission(tmp_path: Path) -> None:
    made = load_mission(written(tmp_path, ""))
    assert made.workspace == tmp_path / "room.xml"
    assert made.source == str(tmp_path / "m.toml")
    assert [place.id for place in made.read_workspace().robots] == [1, 2]


def test_robots_are_counted(tmp_path: Path) -> None:
    assert len(load_mission(written(tmp_path, "robots = 1\n")).read_workspace().robots) == 1
    with pytest.raises(
        ConfigError,
        match=r"m\.toml:2: robots: it is 3, but \S+room\.xml has 2; allowed: 1 to 2; for "
        r"more, add robots and charging stations to the workspace file$",
    ):
        load_mission(written(tmp_path, "robots = 3\n")).read_workspace()
    with pytest.raises(ConfigError, match=r"^command line: robots: it is 4, but"):
        load_mission(written(tmp_path, "robots = 1\n"), {"robots": 4}).read_workspace()


def test_charges_of_robots_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"m\.toml:3: battery\.initial\.3: it is 0\.5, but \S+room\.xml has no robot "
        r"3; allowed: 1, 2$",
    ):
        load_mission(written(tmp_path, "[battery.initial]\n3 = 0.5\n")).read_workspace()
    # Robot 2 is there, only left out.
    fewer = load_mission(written(tmp_path, "robots = 1\n[battery.initial]\n2 = 0.5\n")).read_workspace()
    assert [place.id for place in fewer.robots] == [1]


def test_a_fence_that_leaves_nothing(tmp_path: Path) -> None:
    path = written(tmp_path, "[rta.geofence]\nphi_safer_inset_m = 2.5\n")
    with pytest.raises(
        ConfigError,
        match=r"m\.toml:3: rta\.geofence\.phi_safer_inset_m: it is 2\.5, which leaves "
        r"nothing of a workspace 5 m wide; allowed: below 2\.5$",
    ):
        load_mission(path).read_workspace()


def test_clearance_follows_the_mission(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"room\.xml:10: start of robot 2: .* allowed: at least 0\.55 m"):
        load_mission(written(tmp_path, "[rta.obstacle]\nphi_safer_m = 0.5\n")).read_workspace()


@pytest.mark.parametrize("table", ["robots.2", "backends.pybullet.promise"])
def test_clearance_is_that_of_the_smallest_body(tmp_path: Path, table: str) -> None:
    def robots(radius_m: str) -> int:
        text = f"rta.obstacle.phi_safer_m = 0.5\n[{table}]\nbody_radius_m = {radius_m}\n"
        return len(load_mission(written(tmp_path, text)).read_workspace().robots)

    assert robots("0.05") == 2
    # Of a larger body, a TurtleBot's clearance is asked here, and its own where its promise is known.
    for radius_m, shown in (("0.08", "0.08"), ("0.2", "0.105"), ("-1.0" if "backends" in table else "0.3", "0.105")):
        with pytest.raises(ConfigError, match=rf"the body \(radius {shown} m\) would be only"):
            robots(radius_m)


def test_a_missing_mission_is_named_with_the_nearest(tmp_path: Path) -> None:
    written(tmp_path, "")
    with pytest.raises(ConfigError, match=r"n\.toml: this mission file does not exist, did you mean 'm\.toml'\?$"):
        load_mission(tmp_path / "n.toml")


def test_a_missing_workspace_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    (tmp_path / "room.xml").rename(tmp_path / "rooms.xml")
    with pytest.raises(ConfigError, match=r"room\.xml: this workspace file does not exist, did you mean 'rooms\.xml'"):
        load_mission(path).read_workspace()
    with pytest.raises(ConfigError, match=r"m\.toml:1: workspace: .*room\.xml: this workspace file does not exist"):
        load_mission(path).read_workspace()


# --- options of a backend or planner -----------------------------------------------------------------------


class Options(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    workspace: str
    rate_hz: float = Field(20.0, gt=0.0)
    gui: bool = False


def options(raw: dict[str, Any], source: str | None = None) -> Options:
    return validate_options(Options, raw, source, "backends.kinematic", {"workspace": "filled in"})


def test_options_are_checked_by_their_own_model() -> None:
    assert options({"rate_hz": 50.0}) == Options(workspace="filled in", rate_hz=50.0)


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        ({"rate_hz": 0}, "backends.kinematic.rate_hz: it is 0, allowed: above 0"),
        ({"gui": "yes"}, "backends.kinematic.gui: it is 'yes', allowed: true or false"),
        ({"gui": 1}, "backends.kinematic.gui: it is 1, allowed: true or false"),
        ({"rate": 1}, "backends.kinematic.rate: unknown key, did you mean 'rate_hz'?; allowed: rate_hz, gui"),
        ({"workspace": "x"}, "backends.kinematic.workspace: unknown key; allowed: rate_hz, gui"),
    ],
)
def test_wrong_options_are_named(raw: dict[str, Any], expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        options(raw)
    assert str(caught.value) == expected


def test_wrong_options_have_their_line(tmp_path: Path) -> None:
    path = written(tmp_path, "[backends.kinematic]\nrate_hz = 0\nworkspace = 'x'\n")
    made = load_mission(path)
    with pytest.raises(ConfigError) as caught:
        options(made.backends["kinematic"], made.source)
    assert str(caught.value).splitlines()[1:] == [
        f"  {path}:3: backends.kinematic.rate_hz: it is 0, allowed: above 0",
        f"  {path}:4: backends.kinematic.workspace: unknown key; allowed: rate_hz, gui",
    ]


def test_unknown_keys_of_models_inside_options_are_refused_unless_these_say_otherwise(tmp_path: Path) -> None:
    class Leg(BaseModel):
        x_m: float
        timeout_s: float = Field(30.0, alias="limit_s")

    class Notes(BaseModel, extra="allow"):
        by: str

    class Route(Options):
        legs: list[Leg]
        home: Leg | None = None
        named: dict[str, Leg] = Field(default_factory=dict)
        notes: Notes | None = None

    def route(text: str) -> Route:
        made = load_mission(written(tmp_path, text), {"backends.kinematic.home": {"x_m": 1, "limit": 2}})
        table = made.backends["kinematic"]
        given = {"workspace": "filled in"}
        return validate_options(Route, table, made.source, "backends.kinematic", given, made.overridden)

    legs = "[[backends.kinematic.legs]]\nx_m = 1\n[[backends.kinematic.legs]]\nx_m = 2\nlimit_s = 8\n"
    with pytest.raises(ConfigError) as caught:
        route(f"{legs}timeout = 8\n[backends.kinematic.named]\na = {{ x_m = 1, y_m = 2 }}\n")
    known = "allowed: x_m, limit_s"
    assert sorted(str(caught.value).splitlines()[1:]) == [
        f"  {tmp_path / 'm.toml'}:7: backends.kinematic.legs.1.timeout: unknown key; {known}",
        f"  {tmp_path / 'm.toml'}:9: backends.kinematic.named.a.y_m: unknown key, did you mean 'x_m'?; {known}",
        f"  command line: backends.kinematic.home.limit: unknown key, did you mean 'limit_s'?; {known}",
    ]
    assert options({"rate_hz": 1}).rate_hz == 1
    notes = validate_options(
        Route, {"legs": [], "notes": {"by": "me", "on": "Monday"}}, None, "route", {"workspace": "filled in"}
    ).notes
    assert notes is not None
    assert notes.model_extra == {"on": "Monday"}


def test_options_without_their_file_still_have_their_key(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gone\.toml: backends\.kinematic\.rate_hz: it is 0, allowed: above 0"):
        options({"rate_hz": 0}, str(tmp_path / "gone.toml"))


def test_options_of_the_command_line_are_blamed_on_it(tmp_path: Path) -> None:
    path = written(tmp_path, "[backends.kinematic]\nrate_hz = 0\n")
    made = load_mission(path, {"backends.kinematic.gui": "yes, please"})
    table = made.backends["kinematic"]
    with pytest.raises(ConfigError) as caught:
        validate_options(Options, table, made.source, "backends.kinematic", {"workspace": "filled in"}, made.overridden)
    assert str(caught.value).splitlines()[1:] == [
        f"  {path}:3: backends.kinematic.rate_hz: it is 0, allowed: above 0",
        "  command line: backends.kinematic.gui: it is 'yes, please', allowed: true or false",
    ]


def test_a_workspace_whose_name_no_system_takes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f'workspace = "{"x" * 300}"\n')
    with pytest.raises(ConfigError, match="File name too long"):
        load_mission(path).read_workspace()
