"""`soter workspace`: what it shows, draws and converts, and what it refuses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.hints import install_command
from tests.project.source import ROOT

WORLDS = ROOT / "examples" / "worlds"
WALLED = """
[fence]
polygon = [[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [0.0, 3.0]]

[[keep_out]]
name = "wall"
polygon = [[2.8, 0.0], [3.2, 0.0], [3.2, 3.0], [2.8, 3.0]]

[[station]]
x_m = 1.0
y_m = 1.0

[[station]]
x_m = 5.0
y_m = 1.0
"""


def workspace(*words: object) -> Result:
    return CliRunner().invoke(app, ["workspace", *map(str, words)])


def found(*words: object) -> dict[str, object]:
    done = workspace(*words, "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert isinstance(said, dict)
    return said


def test_a_rectangle() -> None:
    said = found(ROOT / "examples" / "surveillance.xml")
    assert (said["shape"], said["bounds_m"], said["keep_outs"]) == ("rectangle", [0.0, 0.0, 5.0, 5.0], 3)
    assert said["stations"] == {"1": [1.0, 1.0], "2": [2.5, 2.0]}
    assert said["unreachable"] == []
    assert 0.0 < float(str(said["free_percent"])) < 100.0


def test_a_place_on_earth_is_converted(tmp_path: Path) -> None:
    said = found(WORLDS / "harbour.geojson", "--to", tmp_path / "harbour.toml")
    assert said["origin"] == {"lat_deg": 53.5426, "lon_deg": 9.9769}
    again = found(tmp_path / "harbour.toml")
    assert said.pop("left_out") == ["origin"]
    assert again == {**said, "origin": None}


@pytest.mark.parametrize("ending", [".geojson", ".json", ".plan", ".kml", ".xml"])
def test_every_format_is_written(ending: str, tmp_path: Path) -> None:
    placed = () if ending == ".xml" else ("--origin", "-33.9,18.4")
    said = found(ROOT / "examples" / "surveillance.xml", "--to", tmp_path / f"room{ending}", *placed)
    again = found(tmp_path / f"room{ending}")
    assert (again["fence_corners"], again["keep_outs"], again["way_m"]) == (4, 3, said["way_m"])
    assert said["left_out"] == (["sides of stations"] if ending in (".plan", ".kml") else [])
    assert (again["origin"] is None) == (ending == ".xml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("harbour.geojson", "--to", "there.kml", "--origin", "1,2"), "says itself where it is: 53.5426,9.9769"),
        (("l-hall.toml", "--to", "there.kml"), "give --origin LAT,LON"),
        (("l-hall.toml", "--to", "there.plan", "--origin", "47.4"), "it is '47.4', allowed: LAT,LON"),
        (("l-hall.toml", "--to", "there.plan", "--origin", "147.4,8"), "latitude within +-90"),
        (
            ("l-hall.toml", "--to", "there.toml", "--origin", "47.4,8"),
            "allowed with --to: .geojson, .json, .plan, .kml",
        ),
        (("l-hall.toml", "--origin", "47.4,8"), "allowed with --to"),
        (("l-hall.toml", "--to", "there.xml"), "fence: it has 6 corners, not 4"),
    ],
)
def test_what_cannot_be_converted_is_refused(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = workspace(WORLDS / words[0], *words[1:])
    assert done.exit_code == 2
    assert said in done.stderr.replace("\n", " ")
    assert not list(tmp_path.iterdir())


def test_a_map_is_shown_and_drawn_without_stations(tmp_path: Path) -> None:
    said = found(WORLDS / "flat.yaml", "--picture", tmp_path / "flat.png")
    assert (said["shape"], said["cells"], said["cell_m"], said["stations"]) == ("map", [256, 216], 0.05, {})
    assert (tmp_path / "flat.png").read_bytes().startswith(b"\x89PNG")
    done = workspace(WORLDS / "flat.yaml", "--to", tmp_path / "flat.toml")
    assert done.exit_code == 2
    assert "--to" in done.output
    assert not (tmp_path / "flat.toml").exists()


def test_a_mission_file_shows_its_workspace_with_the_stations_that_it_gives(tmp_path: Path) -> None:
    said = found(WORLDS / "flat-patrol.toml", "--picture", tmp_path / "flat.png")
    assert said["shape"] == "map"
    assert said["stations"] == {"1": [-27.05, 16.79], "2": [-21.31, 20.56], "3": [-32.13, 23.07], "4": [-22.39, 24.41]}
    assert said["unreachable"] == []
    (tmp_path / "wrong.toml").write_text('workspace = "none.xml"\n')
    assert workspace(tmp_path / "wrong.toml").exit_code == 2


def test_a_station_that_no_way_leads_to(tmp_path: Path) -> None:
    (tmp_path / "walled.toml").write_text(WALLED)
    done = workspace(tmp_path / "walled.toml", "--json")
    assert done.exit_code == 1
    said = json.loads(done.stdout)
    assert (said["unreachable"], said["way_m"]) == ([2], {"1": 0.0})
    assert workspace(tmp_path / "walled.toml", "--clearance", "none").exit_code == 2


LABYRINTH = """
[fence]
polygon = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]

[[keep_out]]
name = "spiral"
polygon = [
    [1.5, 0.0], [1.8, 0.0], [1.8, 7.2], [7.2, 7.2], [7.2, 1.8], [3.5, 1.8], [3.5, 5.5], [3.2, 5.5], [3.2, 1.5],
    [7.5, 1.5], [7.5, 7.5], [1.5, 7.5],
]

[[station]]
x_m = 0.7
y_m = 0.7

[[station]]
x_m = 4.5
y_m = 4.5
"""


@pytest.mark.parametrize(("drive_s", "refused"), [(900.0, True), (14400.0, False)])
def test_a_battery_that_does_not_last_for_the_way_is_refused(drive_s: float, refused: bool, tmp_path: Path) -> None:
    (tmp_path / "labyrinth.toml").write_text(LABYRINTH)
    (tmp_path / "mission.toml").write_text(
        f'workspace = "labyrinth.toml"\nbackend = "kinematic"\n[battery]\ndrive_s = {drive_s}\nidle_s = 57600.0\n'
    )
    done = workspace(tmp_path / "mission.toml", "--picture", tmp_path / "room.png", "--json")
    said = json.loads(done.stdout)
    assert (done.exit_code, said["unreachable"], len(said["refused"])) == (int(refused), [], int(refused))
    assert (tmp_path / "room.png").exists()
    if refused:
        assert "P3 of module 'battery' is REJECTED" in said["refused"][0]
        checked = CliRunner().invoke(app, ["check", str(tmp_path / "mission.toml")])
        assert checked.exit_code == 1
        assert said["refused"][0].partition("REJECTED: ")[2] in checked.stdout
        shown = workspace(tmp_path / "mission.toml")
        assert f"refused            {said['refused'][0]}" in shown.stdout
    assert found(tmp_path / "labyrinth.toml")["refused"] == []


def test_promises_that_do_not_fit_are_refused_and_shown(tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(
        f'workspace = "{ROOT / "examples" / "surveillance.xml"}"\nbackend = "kinematic"\n'
        "[backends.kinematic]\npromise = { body_radius_m = 0.9 }\n"
    )
    done = workspace(tmp_path / "mission.toml", "--json")
    assert done.exit_code == 1
    assert "rta.collision.phi_safe_m: it is 0.3, but two bodies" in json.loads(done.stdout)["refused"][0]


def test_where_nothing_is_free_and_where_no_station_is_robots_cannot_be(tmp_path: Path) -> None:
    done = workspace(ROOT / "examples" / "surveillance.xml", "--radius", 5)
    assert done.exit_code == 1
    assert "nothing is free: no body of a radius of 5 m keeps 0.15 m" in done.stdout
    (tmp_path / "empty.toml").write_text(WALLED[: WALLED.index("[[station]]")])
    done = workspace(tmp_path / "empty.toml")
    assert done.exit_code == 1
    assert "there is no station in it" in done.stdout


def test_bad_input_is_refused_and_nothing_written(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text(WALLED.replace("5.0", "nan"))
    done = workspace(tmp_path / "bad.toml", "--to", tmp_path / "good.geojson")
    assert done.exit_code == 2
    assert "station.1.x_m" in done.output
    assert not (tmp_path / "good.geojson").exists()
    assert workspace(tmp_path / "none.toml").exit_code == 2
    (tmp_path / "walled.toml").write_text(WALLED)
    for words in (
        ("--to", "there.geojson"),
        ("--to", "there.pdf"),
        ("--to", "walled.toml"),
        ("--picture", "there.txt"),
    ):
        assert workspace(tmp_path / "walled.toml", words[0], tmp_path / words[1]).exit_code == 2
    assert (tmp_path / "walled.toml").read_text() == WALLED


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "walled.toml").write_text(WALLED)
    done = workspace(tmp_path / "walled.toml", "--to", tmp_path / "none" / "there.toml")
    assert done.exit_code in (2, 3)
    assert "there.toml" in done.output


def test_without_matplotlib_it_says_what_draws_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for drawing in ("soter.report.picture", "soter.report.ground"):
        monkeypatch.delitem(sys.modules, drawing, raising=False)
    done = workspace(ROOT / "examples" / "surveillance.xml", "--picture", tmp_path / "room.png")
    assert done.exit_code == 2
    assert f"install it with: {install_command('report')}" in done.stderr
    assert "Traceback" not in done.stderr
