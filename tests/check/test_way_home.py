"""A way home is paid for whichever roadmap shows it, at the speed that is left, with the charge that there is."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from soter.check.admission import admit, declare_all
from soter.check.conditions import Certainty, Finding
from soter.config import MissionFile, load_mission
from soter.errors import ConfigError
from soter.runner import run_mission
from soter.specs import promises_of
from soter.stack.declaration import Declared

LANES = 12
LANE_M = 0.45
"""A body of 0.105 m fits, but no path that keeps the obstacle module from stepping in."""

FOLLOWS = """
import math

from pydantic import BaseModel

from soter import Controller, Waypoint


class Follows(Controller):
    class Options(BaseModel, extra="forbid"):
        points: list[tuple[float, float]]

    def begin(self, arena):
        super().begin(arena)
        self.at = 0

    def step(self, own, now_s):
        points = self.options.points
        if math.dist(points[self.at], (own.x_m, own.y_m)) < 0.03:
            self.at = min(self.at + 1, len(points) - 1)
        return Waypoint(*points[self.at], radius_m=0.02)
"""


def serpentine(folder: Path) -> Path:
    """Write a room in which a way leads up and down between walls; return its file."""
    pitch_m, depth_m = LANE_M + 0.1, 1.2
    walls = "".join(
        f'<box><low x="{1.0 + pitch_m * lane:.2f}" y="{LANE_M if lane % 2 == 0 else 0}" z="0"/>'
        f'<high x="{1.1 + pitch_m * lane:.2f}" y="{depth_m if lane % 2 == 0 else depth_m - LANE_M}" z="1"/></box>'
        for lane in range(LANES)
    )
    file = folder / "serpentine.xml"
    file.write_text(
        f'<configuration><dimension x="{1.0 + pitch_m * LANES:.2f}" y="{depth_m}" z="1"/><robots><robot id="1">'
        f'<start x="0.45" y="0.5" heading="0"/></robot></robots><obstacles>{walls}</obstacles><charging_stations>'
        '<box><low x="0.25" y="0.3" z="0"/><high x="0.65" y="0.7" z="0"/></box></charging_stations></configuration>'
    )
    return file


def open_room(folder: Path, x_m: float = 1.0, y_m: float = 1.0) -> Path:
    file = folder / "open.xml"
    file.write_text(
        '<configuration><dimension x="5.0" y="5.0" z="1"/><robots><robot id="1">'
        f'<start x="{x_m}" y="{y_m}" heading="0"/></robot></robots><obstacles/><charging_stations>'
        '<box><low x="0.8" y="3.8" z="0"/><high x="1.2" y="4.2" z="0"/></box></charging_stations></configuration>'
    )
    return file


def mission(folder: Path, workspace: Path, text: str = "", /, **changes: object) -> MissionFile:
    file = folder / "mission.toml"
    file.write_text(
        f'workspace = "{workspace.name}"\nbackend = "kinematic"\nplanner = "straight-line"\nduration_s = 60.0\n{text}'
    )
    return load_mission(file, {name.replace("__", "."): value for name, value in changes.items()})


def declared(asked: MissionFile) -> Declared:
    workspace = asked.read_workspace()
    return declare_all(asked, workspace, promises_of(asked, workspace))[1]


def found(asked: MissionFile, module: str, condition: str) -> Finding:
    workspace = asked.read_workspace()
    admission = admit(asked, workspace, promises_of(asked, workspace))
    return next(
        each
        for each in (*admission.findings, *admission.proofs)
        if each.module == module and (each.condition == condition or each.verdict is Certainty.REJECTED)
    )


def refused(asked: MissionFile, *texts: str) -> None:
    """It is refused before anything moves, for reasons that name these."""
    with pytest.raises(ConfigError) as caught:
        run_mission(asked)
    assert [text for text in texts if text not in str(caught.value)] == []


def test_paths_that_only_the_narrow_roadmap_shows_are_among_those_that_the_reserve_pays_for(tmp_path: Path) -> None:
    made = declared(mission(tmp_path, serpentine(tmp_path)))
    path = made.dock.path
    far = made.recovery.terrain.bounds[2] - 0.225, 0.225
    assert path.roomy.distance_m(*far) == math.inf
    assert path.longest_m >= path.narrow.distance_m(*far) > 5.0 * path.roomy.longest_m
    assert path.most_legs >= len(path.narrow.legs(*far)) > LANES
    keep = made.module("battery").keep
    assert isinstance(keep, float)
    assert keep >= 4.0 * path.longest_m * made.dock.cost_per_m


def test_a_robot_comes_home_through_many_turns_of_a_narrow_way(tmp_path: Path) -> None:
    (tmp_path / "acs.py").write_text(FOLLOWS)
    room = serpentine(tmp_path)
    points = [[0.5, 0.235]]
    for lane in range(LANES):
        points += [[1.325 + 0.55 * lane, y_m] for y_m in ((0.975, 0.225) if lane % 2 else (0.225, 0.975))]
    asked = mission(
        tmp_path,
        room,
        f"""
ac = "acs.py:Follows"
controllers = {{ Follows = {{ points = {points} }} }}
battery = {{ drive_s = 400.0, idle_s = 400.0, initial = {{ 1 = 1.0 }} }}
""",
        duration_s=700.0,
    )
    result = run_mission(asked).result
    assert result.violations == dict.fromkeys(("battery", "geofence", "collision", "obstacle"), 0)
    assert result.min_margin is not None
    assert result.min_margin["battery"] > 0.1


def test_speeding_up_after_every_turn_is_paid_for(tmp_path: Path) -> None:
    keys = {
        "backends__kinematic__promise": {"v_max_m_s": 1.0, "brake_m_s2": 4.0, "yaw_rate_max_rad_s": 6.0},
        "rta__geofence__phi_safer_inset_m": 0.6, "rta__modules": ["geofence", "battery"],
    }  # fmt: skip
    quick = found(mission(tmp_path, open_room(tmp_path), **keys), "battery", "P2a").figures["extra"]
    keys["backends__kinematic__promise"] = {**keys["backends__kinematic__promise"], "accel_m_s2": 0.1}  # type: ignore[dict-item]
    slow = found(mission(tmp_path, open_room(tmp_path), **keys), "battery", "P2a").figures["extra"]
    # From rest to 1 m/s in 10 s, half of which is lost in each leg; of the brake 0.25 s were accounted for.
    assert isinstance(slow, float)
    assert isinstance(quick, float)
    assert slow - quick >= (5.0 - 0.25) / 2700.0


@pytest.mark.parametrize("part", [0.6, 0.15])
def test_wheels_that_slip_make_the_way_home_longer(tmp_path: Path, part: float) -> None:
    slips = f"fault = [{{ kind = 'wheel_slip', left = {part}, right = {part} }}]"
    asked = mission(tmp_path, open_room(tmp_path), slips, rta__battery__reserve_factor=1.0)
    whole = mission(tmp_path, open_room(tmp_path), rta__battery__reserve_factor=1.0)
    one, other = (found(each, "battery", "P2a").figures for each in (whole, asked))
    longest_s = float(str(one["longest_m"])) / 0.22
    assert float(str(other["extra"])) >= longest_s * (1.0 / part - 1.0) / asked.battery.drive_s
    if part < 0.5:
        refused(asked, "rta.battery", "wheels that leave 15 % of the speed", "reserve_factor = ")


def test_what_is_said_to_do_for_wheels_that_slip_does(tmp_path: Path) -> None:
    slips = "fault = [{ kind = 'wheel_slip', left = 0.15, right = 0.15 }]"
    asked = mission(tmp_path, open_room(tmp_path), slips, rta__battery__reserve_factor=1.0)
    factor = float(found(asked, "battery", "P2a").text.partition("reserve_factor = ")[2].split()[0])
    more = mission(tmp_path, open_room(tmp_path), slips, rta__battery__reserve_factor=factor)
    assert found(more, "battery", "P2a").verdict is Certainty.PROVED


def test_a_first_charge_that_does_not_pay_for_the_way_home_is_refused(tmp_path: Path) -> None:
    low = mission(tmp_path, open_room(tmp_path), battery__initial={"1": 0.001})
    refused(low, "a charge of 0.0010", "battery.initial.1 = ")
    enough = float(found(low, "battery", "P2a").text.partition("battery.initial.1 = ")[2].split()[0])
    run = run_mission(mission(tmp_path, open_room(tmp_path), battery__initial={"1": enough}))
    assert run.result.violations == dict.fromkeys(("battery", "geofence", "collision", "obstacle"), 0)
    # Without the battery's module nobody promises that it comes home.
    alone = mission(tmp_path, open_room(tmp_path), battery__initial={"1": 0.001}, rta__modules=["geofence"])
    assert run_mission(alone).result.status == "completed"


def test_where_others_begin_on_the_way_too_a_first_charge_pays_for_the_whole_reserve(tmp_path: Path) -> None:
    room = open_room(tmp_path)
    two = room.read_text().replace("</robots>", '<robot id="2"><start x="4.0" y="1.0" heading="0"/></robot></robots>')
    station = '<box><low x="3.8" y="3.8" z="0"/><high x="4.2" y="4.2" z="0"/></box></charging_stations>'
    room.write_text(two.replace("</charging_stations>", station))
    asked = mission(tmp_path, room, battery__initial={"1": 0.02, "2": 1.0})
    refused(asked, "robot 1 starts with a charge of 0.0200", "waiting for others")
    enough = float(found(asked, "battery", "P2a").text.partition("battery.initial.1 = ")[2].split()[0])
    keep = declared(asked).module("battery").keep
    assert isinstance(keep, float)
    assert enough >= keep
    more = mission(tmp_path, room, battery__initial={"1": enough, "2": 1.0})
    assert found(more, "battery", "P2a").verdict is Certainty.PROVED


@pytest.mark.parametrize("modules", [["geofence"], ["geofence", "battery"]])
def test_a_start_at_the_fence_is_refused_with_and_without_a_battery(tmp_path: Path, modules: list[str]) -> None:
    asked = mission(tmp_path, open_room(tmp_path, 2.5, 0.0), rta__modules=modules)
    at_fence = found(asked, "geofence", "A13")
    assert at_fence.verdict is Certainty.REJECTED
    assert "starts at (2.5, 0), 0.000 m from the fence" in at_fence.text
    needed_m = float(at_fence.text.partition(" needs ")[2].split()[0])
    admitted = mission(tmp_path, open_room(tmp_path, 2.5, needed_m), rta__modules=modules)
    assert found(admitted, "geofence", "P2b").verdict is Certainty.PROVED


def test_modules_that_never_let_go_are_refused_without_a_battery_too(tmp_path: Path) -> None:
    keys = {"rta__modules": ["geofence"], "backends__kinematic__promise": {"position_noise_m": 0.02}}
    file = open_room(tmp_path, 1.0, 0.11)
    file.write_text(file.read_text().replace('y="5.0"', 'y="0.22"').replace("3.8", "0.01").replace("4.2", "0.21"))
    stuck = found(mission(tmp_path, file, **keys), "geofence", "P2b")
    assert stuck.verdict is Certainty.REJECTED
    assert "from its start at (1, 0.11)" in stuck.text


def test_a_dwell_as_long_as_others_wait_is_refused_where_there_are_others() -> None:
    example = Path(__file__).parents[2] / "examples" / "surveillance.toml"

    def judged(dwell_s: float, robots: int) -> Finding:
        keys = {"backend": "kinematic", "robots": robots, "rta.collision.dwell_s": dwell_s}
        asked = load_mission(example, keys)
        return found(asked, "collision", "P2b")

    assert judged(30.0, 2).verdict is Certainty.REJECTED
    assert "rta.collision.dwell_s is 30 s" in judged(30.0, 2).text
    assert "at most 24 s would do" in judged(30.0, 2).text
