"""Vehicles in workspaces with places on earth: which are taken, and where they drive. In virtual time."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.fence import fence_items
from soter.adapters.mavlink.options import MavlinkConfig
from soter.config import load_mission
from soter.errors import RobotUnavailable
from soter.geometry.earth import Projection
from soter.geometry.reading import read_workspace
from soter.geometry.site import GeoOrigin
from soter.geometry.workspace import Workspace
from soter.runner import Follower, run_mission
from soter.sdk import Controller, Fleet, RobotSpec, Waypoint
from tests.adapters.mavlink.puppet import Puppet, ready, tick
from tests.adapters.mavlink.test_missions import EXAMPLES, SAFE, options
from tests.adapters.mavlink.test_spheres import on_plane, px4, whole
from tests.adapters.mavlink.virtual import BACKEND, VirtualBackend, VirtualConfig, Wire

GIVEN = {"connection": "udpin:127.0.0.1:14550"}

# --- which workspaces and vehicles are taken -----------------------------------------------------------------


def square(tmp_path: Path, at: tuple[float, float], origin: tuple[float, float] | None = None) -> Workspace:
    """Return a quay of 40 x 40 m around a place, given as latitude and longitude, with two stations."""
    there = Projection(GeoOrigin(*at), "test")

    def position(x_m: float, y_m: float) -> list[float]:
        lat_deg, lon_deg = there.place(x_m, y_m)
        return [lon_deg, lat_deg]

    ring = [position(*corner) for corner in ((-20, -20), (20, -20), (20, 20), (-20, 20), (-20, -20))]
    features: list[dict[str, Any]] = [
        {"type": "Feature", "properties": {"soter": kind}, "geometry": {"type": shape, "coordinates": where}}
        for kind, shape, where in (
            ("fence", "Polygon", [ring]),
            ("station", "Point", position(-10.0, -10.0)),
            ("station", "Point", position(10.0, 10.0)),
        )
    ]
    made: dict[str, Any] = {"type": "FeatureCollection", "features": features}
    if origin is not None:
        made["origin"] = [origin[1], origin[0]]
    path = tmp_path / "quay.geojson"
    path.write_text(json.dumps(made), encoding="utf-8")
    return read_workspace(path)


@contextmanager
def opened(
    workspace: Workspace, happens: Callable[[Wire], object] = lambda _: None, **given: Any
) -> Iterator[tuple[Fleet, Wire]]:
    config = VirtualConfig.model_validate({"workspace": workspace, **GIVEN, **given})
    start = workspace.robots[0]
    with VirtualBackend().open(config, [RobotSpec(start.id, start.x_m, start.y_m, 0.3)]) as fleet:
        wire = VirtualBackend.wire
        happens(wire)
        yield fleet, wire


def test_a_workspace_on_earth_is_for_given_vehicles_too(tmp_path: Path) -> None:
    workspace = square(tmp_path, (53.5, 9.9))
    assert isinstance(MavlinkConfig.model_validate({"workspace": workspace, **GIVEN}).geo_origin, Projection)
    with pytest.raises(ValidationError, match="says itself where on earth it is; leave origin out"):
        MavlinkConfig.model_validate({"workspace": workspace, **GIVEN, "origin": {"lat_deg": 53.5, "lon_deg": 9.9}})


def test_beyond_what_was_tried_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="allowed: 80 north to 80 south"):
        MavlinkConfig.model_validate({"workspace": square(tmp_path, (-80.1, 9.9)), **GIVEN})


def begins_elsewhere(wire: Wire) -> None:
    autopilot = wire.autopilot(1)
    lat_e7, lon_e7 = autopilot.reckoning.origin_e7
    autopilot.reckoning.origin_e7 = lat_e7 + 3_000_000, lon_e7


def reckons_otherwise(wire: Wire) -> None:
    """As autopilots did before: metres of longitude by the latitude of the origin alone."""
    reckoning = wire.autopilot(1).reckoning
    begins_at = reckoning.origin_e7
    reckoning.origin_e7 = begins_at[0] - 200_000, begins_at[1] - 200_000
    right = reckoning.local_m

    def local(x_m: float, y_m: float) -> tuple[float, float]:
        east_m, north_m = right(x_m, y_m)
        lat_0 = reckoning.origin_e7[0] * 1e-7
        return east_m * math.cos(math.radians(lat_0)) / math.cos(math.radians(lat_0 + 0.01)), north_m

    reckoning.local_m = local  # type: ignore[method-assign]


@pytest.mark.parametrize(
    ("happens", "promise", "says"),
    [
        (begins_elsewhere, {}, "its EKF has its origin 33 km from that of the workspace, allowed: 28 km"),
        (lambda _: None, {"position_noise_m": 0.001}, "off by up to 0.0020 m.*position_noise_m is 0.001"),
        (
            reckons_otherwise,
            {"position_noise_m": 0.05},
            "is 0.3. m from its reported place relative to its EKF's origin",
        ),
    ],
    ids=["far", "noise", "otherwise"],
)
def test_a_vehicle_whose_places_are_not_those_of_the_workspace_is_not_armed(
    happens: Callable[[Wire], object], promise: dict[str, float], says: str, tmp_path: Path
) -> None:
    with opened(square(tmp_path, (53.5, 9.9)), happens, promise=promise) as (fleet, wire):
        with pytest.raises(RobotUnavailable, match=says):
            fleet.robots[0].init(30.0)
        assert not wire.autopilot(1).armed


def test_a_px4_is_known_and_led_by_its_own_sphere(puppet: Puppet, tmp_path: Path) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_PX4), False
    puppet.yaw_rad = 0.5
    at, origin, ekf = (47.45, 8.6), (47.4, 8.5), (47.397742, 8.545594)
    workspace = square(tmp_path, at, origin)
    puppet.place_e7 = whole(*at)
    puppet.y_m, puppet.x_m = map(float, px4(*ekf, *at))
    robot = ready(puppet, workspace=workspace, promise={"position_noise_m": 0.03})
    state = robot.read_state()
    x_m, y_m = on_plane(GeoOrigin(*origin), *at)
    assert (state.x_m, state.y_m) == pytest.approx((x_m, y_m), abs=0.003)
    # The north of the workspace is turned by the meridians' way to each other.
    meets_rad = math.radians(0.1) * math.sin(math.radians(47.45))
    assert state.heading_rad == pytest.approx(0.5 * math.pi - 0.5 + meets_rad, abs=2e-5)
    robot.goto(Waypoint(x_m + 0.01, y_m, radius_m=0.005), Controller.SC)
    tick(puppet, robot)
    north, east = px4(*ekf, *Projection(GeoOrigin(*origin), "test").place(x_m + 0.01, y_m))
    fields = puppet.targets()[-1][1]
    assert (fields["x"], fields["y"]) == pytest.approx((float(north), float(east)), abs=0.002)
    robot.close(0.1)


def test_a_px4_tells_its_origin_too_roughly_for_what_a_simulated_vehicle_promises(
    puppet: Puppet, tmp_path: Path
) -> None:
    puppet.kind, puppet.gate = (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_PX4), False
    with pytest.raises(RobotUnavailable, match=r"off by up to 0\.0181 m.*position_noise_m is 0\.003"):
        ready(puppet, workspace=square(tmp_path, (47.4, 8.55)))
    assert not puppet.armed


# --- driving -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", ["rover", "copter"])
@pytest.mark.parametrize(
    ("at", "origin"),
    [
        ((53.5, 9.9), None),
        ((53.6, 10.1), (53.5, 9.9)),
        ((-16.9, -179.95), (-17.0, 179.9)),
        ((79.9, 20.7), (79.8, 20.0)),
    ],
    ids=["at its origin", "far from it", "over the date line", "far north"],
)
def test_it_drives_where_it_is_told_and_says_where_it_is(
    at: tuple[float, float], origin: tuple[float, float] | None, vehicle: str, tmp_path: Path
) -> None:
    workspace = square(tmp_path, at, origin)
    with opened(workspace, vehicle=vehicle, upload_fence=True, promise={"position_noise_m": 0.01}) as (fleet, wire):
        (robot,) = fleet.robots
        robot.init(60.0)
        robot.switch_ac_sc(Controller.AC, "test")
        start = workspace.robots[0]
        target = Waypoint(start.x_m + 1.2, start.y_m + 0.5, radius_m=0.02, heading_rad=0.8)
        robot.goto(target, Controller.AC)
        state, (x_m, y_m, heading_rad) = robot.read_state(), wire.world.truth.pose(1)
        for _ in range(400):
            fleet.clock.sleep_until(fleet.clock.now() + 0.05)
            state = robot.read_state()
            robot.renew_lease()
            # By then it has moved on for as long as the sample is old, which is less than a tick.
            x_m, y_m, heading_rad = wire.world.truth.pose(1)
            late_s = fleet.clock.now() - state.stamp_s
            expected = state.x_m + state.vx_m_s * late_s, state.y_m + state.vy_m_s * late_s
            assert math.dist(expected, (x_m, y_m)) <= 0.012
            turned_rad = heading_rad - state.heading_rad - state.yaw_rate_rad_s * late_s
            assert math.remainder(turned_rad, math.tau) == pytest.approx(0.0, abs=0.15)
        assert math.dist((x_m, y_m), (target.x_m, target.y_m)) <= 0.02
        assert math.remainder(heading_rad - 0.8, math.tau) == pytest.approx(0.0, abs=0.02)
        assert state.heading_rad == pytest.approx(heading_rad, abs=1e-3)
        autopilot = wire.autopilot(1)
        held = [autopilot.origin.local_m(item.x, item.y) for item in autopilot.fence.items]
        fence, _ = workspace.outlines()
        assert held == [pytest.approx(corner, abs=0.008) for corner in fence or ()]
        assert len(held) == len(fence_items(workspace, Projection(GeoOrigin(*(origin or at)), "test"))) == 4


def moved(tmp_path: Path, origin: tuple[float, float] | None) -> Path:
    """Return the harbour, with its origin elsewhere."""
    path = EXAMPLES / "worlds" / "harbour.geojson"
    if origin is not None:
        made = json.loads(path.read_text(encoding="utf-8")) | {"origin": [origin[1], origin[0]]}
        path = tmp_path / path.name
        path.write_text(json.dumps(made), encoding="utf-8")
    return path


@pytest.mark.parametrize("origin", [None, (53.45, 9.75)], ids=["its own origin", "an origin 18 km away"])
def test_given_vehicles_keep_every_rule_in_a_harbour(origin: tuple[float, float] | None, tmp_path: Path) -> None:
    given = {key: value for key, value in options("ardurover").items() if key != "origin"} | {"like": "ardurover"}
    overrides = {
        "workspace": str(moved(tmp_path, origin)), "backend": BACKEND, "duration_s": 20.0, "targets": "hostile",
        "backends": {BACKEND: given},
    }  # fmt: skip
    assert given["connection"]
    ways_m: dict[int, float] = {}

    def looks(_now_s: float) -> None:
        for autopilot in VirtualBackend.wire.autopilots:
            way_m = math.hypot(*autopilot.said()[:2])
            ways_m[autopilot.id] = max(ways_m.get(autopilot.id, 0.0), way_m)

    result = run_mission(
        load_mission(EXAMPLES / "ardurover" / "mission.toml", overrides), follower=Follower(pace=looks)
    ).result
    assert (result.status, result.violations, result.uncontrolled) == ("completed", SAFE, {})
    assert result.assumptions == {}
    assert result.ac_share >= 0.4
    # From the origin of its EKF, which is where it began.
    assert min(ways_m.values()) >= 1.0
    assert max(ways_m.values()) >= 10.0
