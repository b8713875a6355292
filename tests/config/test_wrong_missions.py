"""Each way in which a mission file can be wrong is refused, with line, key, value and what is allowed."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.campaign.plan import load_campaign
from soter.config import load_mission, parse_mission
from soter.errors import ConfigError
from soter.geometry.reading import read_workspace
from tests.config.text import CHEAP, HEAD, error

ALL_KEYS = (
    "mission, workspace, station, start, backend, duration_s, seed, targets, robots, ac, planner, "
    "target_timeout_s, base_tick_s, battery, rta, isolation, backends, planners, adversaries, controllers, fault, "
    "reseed, distribution"
)
WRONG: list[tuple[str, str]] = [
    # syntax
    ("seed = \n", "m.toml:2: not valid TOML: Invalid value (column 8)"),
    ("seed = 1\nseed = 2\n", "m.toml:3: not valid TOML: Cannot overwrite a value (column 9)"),
    (
        'mission = "a.py"\n[mission]\nvisits = 1\n',
        (
            'm.toml:3: not valid TOML: Cannot overwrite a value (column 9); mission = "NAME" is short for [mission] '
            'with use = "NAME": write only the table'
        ),
    ),
    ("x = [\n", "m.toml: not valid TOML: Invalid value (at end of document)"),
    ("x = " + 5000 * "[", "m.toml: tables or lists are nested too deeply, allowed: at most 20 levels"),
    (
        '[isolation]\nread = ["a", "\\u0000"]',
        "m.toml:3: isolation.read.1: it has the character U+0000, allowed: what a file can be called",
    ),
    (30 * "a." + "b = 1", "m.toml:2: tables or lists are nested too deeply, allowed: at most 20 levels"),
    # names
    (
        "[[station]]\nx_m = 1.0\ny_m = 2.0\nside = 1.0\n",
        "m.toml:5: station.0.side: unknown key, did you mean 'side_m'?; allowed: x_m, y_m, side_m",
    ),
    ("duration = 5\n", "m.toml:2: duration: unknown key, did you mean 'duration_s'?; allowed: " + ALL_KEYS),
    (
        "[rta]\nenable = true\n",
        (
            "m.toml:3: rta.enable: unknown key, did you mean 'enabled'?; allowed: enabled, modules, "
            "collision, obstacle, "
            "geofence, battery, path, module"
        ),
    ),
    (
        "[rta.colision]\ndelta_s = 0.1\n",
        (
            "m.toml:2: rta.colision: unknown key, did you mean 'collision'?; allowed: enabled, modules, "
            "collision, obstacle, "
            "geofence, battery, path, module"
        ),
    ),
    (
        "[rta.geofence]\nphi_safe_m = 0.0\n",
        (
            "m.toml:3: rta.geofence.phi_safe_m: unknown key, did you mean 'phi_safer_inset_m'?; allowed: "
            "delta_s, dwell_s, model, phi_safer_inset_m"
        ),
    ),
    (
        "[rta.collision]\nphi_saver_m = 1.0\n",
        (
            "m.toml:3: rta.collision.phi_saver_m: unknown key, did you mean 'phi_safer_m'?; allowed: delta_s, dwell_s, "
            "phi_safe_m, phi_safer_m, model"
        ),
    ),
    # kinds
    ('duration_s = "600"\n', "m.toml:2: duration_s: it is '600', allowed: a number"),
    ("seed = 1.5\n", "m.toml:2: seed: it is 1.5, allowed: a whole number"),
    ("seed = true\n", "m.toml:2: seed: it is True, allowed: a whole number"),
    ("backend = 3\n", "m.toml:2: backend: it is 3, allowed: a text in quotes"),
    ('planner = ""\n', "m.toml:2: planner: it is '', allowed: a text that is not empty"),
    (
        "rta = 3\n",
        (
            "m.toml:2: rta: it is 3, allowed: a table of enabled, modules, collision, obstacle, geofence, battery, "
            "path, module"
        ),
    ),
    ("rta.enabled = 1\n", "m.toml:2: rta.enabled: it is 1, allowed: true or false"),
    ('rta.modules = "battery"\n', "m.toml:2: rta.modules: it is 'battery', allowed: a list"),
    ("backends = 3\n", "m.toml:2: backends: it is 3, allowed: a table"),
    ("[planners]\nx = 3\n", "m.toml:3: planners.x: it is 3, allowed: a table"),
    ("fault = 3\n", "m.toml:2: fault: it is 3, allowed: a list"),
    ("fault = [{}, 3]\n", "m.toml:2: fault.1: it is 3, allowed: a table"),
    # choices
    (
        'targets = "gird"\n',
        "m.toml:2: targets: it is 'gird', allowed: 'grid', 'uniform' or 'hostile', did you mean 'grid'?",
    ),
    ("mission = 3\n", "m.toml:2: mission: it is 3, allowed: a table of use"),
    (
        '[rta]\nmodules = ["battery", "batery"]\n',
        (
            "m.toml:3: rta.modules.1: it is 'batery', allowed: 'collision', 'obstacle', 'geofence' or "
            "'battery', did you "
            "mean 'battery'?"
        ),
    ),
    (
        '[rta]\nmodules = ["battery", "battery"]\n',
        "m.toml:3: rta.modules: it is ['battery', 'battery'], allowed: each module once, 'battery' is there twice",
    ),
    # ranges
    ("duration_s = 0\n", "m.toml:2: duration_s: it is 0, allowed: at least 0.001"),
    ("duration_s = -1.0\n", "m.toml:2: duration_s: it is -1.0, allowed: at least 0.001"),
    ("duration_s = nan\n", "m.toml:2: duration_s: it is nan, allowed: a finite number"),
    ("duration_s = inf\n", "m.toml:2: duration_s: it is inf, allowed: a finite number"),
    ("duration_s = 1e8\n", "m.toml:2: duration_s: it is 100000000.0, allowed: at most 1e+07"),
    ("seed = -1\n", "m.toml:2: seed: it is -1, allowed: at least 0"),
    (
        "seed = 9223372036854775808\n",
        "m.toml:2: seed: it is 9223372036854775808, allowed: at most 9223372036854775807",
    ),
    ("robots = 0\n", "m.toml:2: robots: it is 0, allowed: at least 1"),
    ("robots = 255\n", "m.toml:2: robots: it is 255, allowed: at most 254"),
    ("target_timeout_s = 0\n", "m.toml:2: target_timeout_s: it is 0, allowed: at least 0.1"),
    ("[isolation]\nsilent_s = 0.1\n", "m.toml:3: isolation.silent_s: it is 0.1, allowed: at least 0.5"),
    ("[isolation]\nmemory_mib = 1\n", "m.toml:3: isolation.memory_mib: it is 1, allowed: at least 64"),
    (
        "[isolation]\nreal_time = 1\n",
        "m.toml:3: isolation.real_time: it is 1, allowed: 'auto', 'always' or 'never'",
    ),
    ("base_tick_s = 0.0\n", "m.toml:2: base_tick_s: it is 0.0, allowed: at least 0.001"),
    ("[battery]\ndrive_s = 0\n", "m.toml:3: battery.drive_s: it is 0, allowed: at least 0.1"),
    ("[battery]\nidle_s = 1799.0\n", CHEAP),
    ("[battery]\nidle_s = -2\n", "m.toml:3: battery.idle_s: it is -2, allowed: at least 0.1"),
    ("[battery]\ncharge_s = nan\n", "m.toml:3: battery.charge_s: it is nan, allowed: a finite number"),
    ("[battery.initial]\n2 = 0\n", "m.toml:3: battery.initial.2: it is 0, allowed: at least 0.001"),
    ("[battery]\ninitial = [0.5, 1.5]\n", "m.toml:3: battery.initial.2: it is 1.5, allowed: at most 1"),
    ("[battery]\ninitial = 0.5\n", "m.toml:3: battery.initial: it is 0.5, allowed: a table"),
    (
        "[battery.initial]\ntwo = 0.5\n",
        "m.toml:3: battery.initial.two: of its name: it is 'two', allowed: a whole number",
    ),
    ("[battery.initial]\n0 = 0.5\n", "m.toml:3: battery.initial.0: of its name: it is 0, allowed: at least 1"),
    ("[battery.initial]\n255 = 0.5\n", "m.toml:3: battery.initial.255: of its name: it is 255, allowed: at most 254"),
    ("[rta.collision]\nphi_safe_m = -0.1\n", "m.toml:3: rta.collision.phi_safe_m: it is -0.1, allowed: at least 0"),
    (
        "[rta.collision]\nphi_safer_m = 0.3\n",
        "m.toml:3: rta.collision.phi_safer_m: it is 0.3, allowed: above phi_safe_m, which is 0.3",
    ),
    (
        "[rta.obstacle]\nphi_safe_m = 0.2\n",
        "m.toml:2: rta.obstacle.phi_safer_m: it is 0.1, allowed: above phi_safe_m, which is 0.2",
    ),
    ("[rta.obstacle]\ndwell_s = -0.1\n", "m.toml:3: rta.obstacle.dwell_s: it is -0.1, allowed: at least 0"),
    (
        "[rta.geofence]\nphi_safer_inset_m = 0.0\n",
        "m.toml:3: rta.geofence.phi_safer_inset_m: it is 0.0, allowed: at least 0.001",
    ),
    ("[rta.battery]\nphi_safer = 85\n", "m.toml:3: rta.battery.phi_safer: it is 85, allowed: at most 1"),
    ("[rta.battery]\nreserve_factor = 0.5\n", "m.toml:3: rta.battery.reserve_factor: it is 0.5, allowed: at least 1"),
    ("[rta.battery]\ndelta_s = 0\n", "m.toml:3: rta.battery.delta_s: it is 0, allowed: at least 0.001"),
    (
        "[rta.geofence]\ndelta_s = 0.52\n",
        (
            "m.toml:3: rta.geofence.delta_s: it is 0.52, allowed: a multiple of base_tick_s, which is "
            "0.05; the nearest is "
            "0.5"
        ),
    ),
    (
        "[rta.collision]\ndelta_s = 0.01\n",
        (
            "m.toml:3: rta.collision.delta_s: it is 0.01, allowed: a multiple of base_tick_s, which is "
            "0.05; the nearest is "
            "0.05"
        ),
    ),
    (
        "base_tick_s = 0.1\n",
        (
            "m.toml: rta.collision.delta_s: it is 0.05, allowed: a multiple of base_tick_s, which is 0.1; the "
            "nearest is 0.1"
        ),
    ),
    (
        "base_tick_s = 0.05000001\n",
        (
            "m.toml: rta.collision.delta_s: it is 0.05, allowed: a multiple of base_tick_s, which is 0.05000001; the "
            "nearest is 0.05000001"
        ),
    ),
    (
        "[rta.collision]\nphi_safer_m = 0.5\nphi_safe_m = 0.50000001\n",
        "m.toml:3: rta.collision.phi_safer_m: it is 0.5, allowed: above phi_safe_m, which is 0.50000001",
    ),
    (
        "[battery]\ndrive_s = 600.00000001\nidle_s = 600\n",
        (
            "m.toml:4: battery.idle_s: it is 600.0, allowed: at least drive_s, which is 600.00000001: standing still "
            "costs no more than driving"
        ),
    ),
    (
        "[rta.path]\nenabled = true\ndelta_s = 0.12\n",
        "m.toml:4: rta.path.delta_s: it is 0.12, allowed: a multiple of base_tick_s, which is 0.05; the nearest is 0.1",
    ),
]


@pytest.mark.parametrize(("text", "expected"), WRONG, ids=[text[:40].strip() for text, _ in WRONG])
def test_what_is_wrong_is_named(text: str, expected: str) -> None:
    assert error(text) == expected


def test_the_period_of_what_is_off_is_not_looked_at() -> None:
    assert not parse_mission(b'workspace = "room.xml"\n[rta.path]\ndelta_s = 0.12\n', "m.toml").rta.path.enabled


def test_the_workspace_must_be_given() -> None:
    with pytest.raises(ConfigError, match=r"^m\.toml: workspace: it is missing, and has no default$"):
        parse_mission(b"seed = 1\n", "m.toml")


def test_a_byte_order_mark_is_ignored() -> None:
    assert parse_mission(b'\xef\xbb\xbfworkspace = "room.xml"\n', "m.toml").workspace == Path("room.xml")
    with pytest.raises(ConfigError, match=r"^m\.toml:2: seed: it is -1, allowed: at least 0$"):
        parse_mission(b'\xef\xbb\xbfworkspace = "room.xml"\nseed = -1\n', "m.toml")


def test_not_utf_8() -> None:
    with pytest.raises(ConfigError, match=r"^m\.toml:2: not UTF-8, as TOML must be; save it as UTF-8$"):
        parse_mission(b'seed = 1\nbackend = "\xff"\n', "m.toml")


def test_all_that_is_wrong_is_listed_in_the_order_of_the_file() -> None:
    text = 'seed = -1\ntargets = "gird"\n[rta.collision]\ndelta_s = "fast"\n[battery]\ndrives_s = 1\n'
    assert error(text, {"robots": 0}).splitlines() == [
        "m.toml: 5 things are wrong",
        "  m.toml:2: seed: it is -1, allowed: at least 0",
        "  m.toml:3: targets: it is 'gird', allowed: 'grid', 'uniform' or 'hostile', did you mean 'grid'?",
        "  m.toml:5: rta.collision.delta_s: it is 'fast', allowed: a number",
        (
            "  m.toml:7: battery.drives_s: unknown key, did you mean 'drive_s'?; allowed: drive_s, idle_s, charge_s, "
            "initial"
        ),
        "  command line: robots: it is 0, allowed: at least 1",
    ]


@pytest.mark.parametrize(
    ("name", "text", "kind", "use"),
    [
        ("room.toml", "[fence]\npolygon = [[0, 0], [4, 0], [4, 4]]\n", "workspace file", "workspace = 'room.toml'"),
        ("room.xml", "<configuration/>", "workspace file", "workspace = 'room.xml'"),
        ("park.geojson", "{}", "workspace file", "workspace = 'park.geojson'"),
        ("hello.py", "import soter\n", "script", "`soter run --mission hello.py`"),
        ("run.mcap", 10**6 * "x", "recording", "`soter info`"),
        ("grid.toml", "title = 'a'\n[[part]]\nname = 'b'\n", "campaign file", "`soter campaign grid.toml`"),
    ],
)
def test_a_file_of_another_kind_is_called_by_its_name(
    name: str, text: str, kind: str, use: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_mission(name)
    assert f"{name}: it is a {kind}, allowed: a mission file; " in str(refused.value)
    assert use in str(refused.value)


def test_a_mission_is_no_workspace_and_no_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text('workspace = "room.xml"\n')
    with pytest.raises(ConfigError, match=r"it is a mission file, allowed: a workspace file; `soter run m\.toml` runs"):
        read_workspace(Path("m.toml"))
    with pytest.raises(ConfigError, match=r"it is a mission file, allowed: a campaign file; `soter run m\.toml` runs"):
        load_campaign(Path("m.toml"))


def test_a_huge_value_and_a_huge_name_do_not_fill_the_screen() -> None:
    assert len(error(f'targets = "{10_000 * "x"}"\n')) < 200
    assert len(error(f"{10_000 * 'x'} = 1\n")) < 400


@pytest.mark.parametrize(("name", "command"), [("stations.py", "soter run --mission"), ("room.xml", "soter workspace")])
def test_the_command_for_a_file_of_another_kind_has_its_folder(name: str, command: str, tmp_path: Path) -> None:
    path = tmp_path / "my missions" / name
    path.parent.mkdir()
    path.write_text("")
    with pytest.raises(ConfigError) as refusal:
        load_mission(path)
    assert f"`{command} '{path}'`" in str(refusal.value)


SCRIPT = "class Visits:\n    class Options:\n        stations: list[int]\n        robots: int = 3\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            'mission = "stations.py"\nstations = [1]\n',
            r"m\.toml:3: stations: .*\[mission\].*'stations.py'",
        ),
        ('mission = "stations.py:Visits"\nstations = [1]\n', r"m\.toml:3: stations: .*\[mission\]"),
        ('mission = "waypoints"\npoints = [[1, 1]]\n', r"m\.toml:3: points: unknown key.*'waypoints'.*\[mission\]"),
    ],
)
def test_an_option_of_the_mission_at_the_first_level_belongs_into_its_table(
    text: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / "stations.py").write_text(SCRIPT)
    (tmp_path / "m.toml").write_text(HEAD + text)
    with pytest.raises(ConfigError, match=said) as refusal:
        load_mission(tmp_path / "m.toml")
    assert "did you mean" not in str(refusal.value)


@pytest.mark.parametrize("script", [SCRIPT, "class", None])
def test_a_key_that_no_mission_has_is_unknown(script: str | None, tmp_path: Path) -> None:
    if script is not None:
        (tmp_path / "stations.py").write_text(script)
    (tmp_path / "m.toml").write_text(f'{HEAD}mission = "stations.py"\nsed = 1\n')
    with pytest.raises(ConfigError, match=r"m\.toml:3: sed: unknown key, did you mean 'seed'\?; allowed: [^[]*$"):
        load_mission(tmp_path / "m.toml")
