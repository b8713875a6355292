"""From a seed to a configuration: a mission and its room, over everything that a mission file can say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pkgutil import resolve_name
from random import Random
from typing import Any, Final

import shapely  # type: ignore[import-untyped]

from soter.adapters.pybullet import PERIOD_S, SimulatedPromise
from soter.campaign.random.acs import draw_ac
from soter.campaign.random.configuration import Configuration, Tables
from soter.campaign.random.faults import draw_faults
from soter.campaign.random.figures import Figures, worst
from soter.campaign.random.floor import Floor, draw_floor
from soter.campaign.random.modules import draw_rta
from soter.campaign.random.places import STATION_M, Needs, furnish
from soter.faults import BUILT_IN as FAULT_KINDS
from soter.faults import Fault, FaultOptions
from soter.faults.fault import Context
from soter.faults.robot import widened
from soter.geometry.workspace import Workspace
from soter.onboard.drive import OVERSHOOT_M, tube_m
from soter.registry import load_backend
from soter.sdk import Capabilities

NASTY: Final = 0.45
"""Part of the configurations that are drawn at the edges of what is valid."""

DURATION_S: Final = (600.0, 1200.0)
MOST_ROBOTS: Final = 10
MOST_TIMES: Final = 8.0
"""How much larger rooms may be for large or fast robots."""

_TICKS: Final = (0.05, 0.05, 0.05, 0.05, 0.1)
_ODD_TICKS: Final = (0.01, 0.02, 0.025, 0.04, 0.15, 0.2)
_HOME_M: Final = 0.15
_SLACK_M: Final = 0.03
_STOPS_M: Final = 0.03


def draw(seed: int, engine: str = "kinematic") -> Configuration:
    """Return the configuration of a seed; the same seed gives the same one.

    Args:
        seed: any whole number.
        engine: of the backend `pybullet`; with `kinematic` half of the missions name the backend of that name.
    """
    rng = Random(f"configuration {seed}")
    nasty = rng.random() < NASTY
    while True:
        found = _drawn(rng, nasty, engine)
        if found is not None:
            return found


def _drawn(rng: Random, nasty: bool, engine: str) -> Configuration | None:
    """Return a configuration, or None where no robot fits into the room that was drawn."""
    tables: Tables = {"seed": rng.randrange(2**31), "duration_s": round(rng.uniform(*DURATION_S), 1)}
    promise: Tables = {}
    unlike: dict[str, Tables] = {}
    chance = rng.random()
    if engine == "kinematic" and chance < 0.7:
        tables["backend"] = "kinematic"
        if chance < 0.4:
            promise = _robot(rng, nasty)
            tables["backends"] = {"kinematic": {"promise": promise}}
        if chance > 0.25:
            ids = sorted(rng.sample(range(1, 5), rng.randint(1, 4)))
            unlike = {str(robot_id): _robot(rng, nasty, promise) for robot_id in ids}
    else:
        tables["backend"], tables["backends"] = "pybullet", {"pybullet": {"engine": engine}}
    floor = draw_floor(rng, nasty).scaled(_room(rng, [promise, *unlike.values()]))
    if rng.random() < 0.35:
        floor = floor.reshaped(rng)
    tick_s = rng.choice(_ODD_TICKS if nasty and rng.random() < 0.1 else _TICKS)
    if tick_s != 0.05 or rng.random() < 0.1:
        tables["base_tick_s"] = tick_s
    wanted = min(rng.choices(range(1, MOST_ROBOTS + 1), (20, 22, 14, 12, 8, 7, 6, 5, 4, 4))[0], _room_for(floor, nasty))
    unlike = {robot_id: own for robot_id, own in unlike.items() if int(robot_id) <= wanted}
    faults = draw_faults(rng, range(1, wanted + 1), nasty)
    promises = _promised(tables, unlike, faults, wanted, tick_s)
    figures = Figures(worst(promises), tick_s, min(each.v_max_m_s for each in promises))
    rta = draw_rta(rng, floor, figures, nasty)
    needs = Needs(
        fence=figures.spare_m(rta.geofence_delta_s) + _SLACK_M + figures.promise.v_max_m_s * 0.05,
        boxes=figures.promise.body_radius_m + max(_HOME_M, rta.obstacle_safe_m + rta.obstacle_reach_m) + _SLACK_M,
        spot=figures.promise.body_radius_m + rta.obstacle_safer_m + 0.05,
        apart=rta.apart_m * (1.0 if nasty else rng.uniform(1.0, 1.5)),
        passing=rta.passing_m,
        station=2.0 * (_STOPS_M + figures.promise.position_noise_m) + 0.01,
    )
    if nasty and rng.random() < 0.2:
        needs = replace(needs, station=STATION_M[0])
    if nasty and rng.random() < 0.15:
        needs = replace(needs, fence=0.05, boxes=figures.promise.body_radius_m + 0.05)
    room = furnish(rng, floor, wanted, needs, nasty)
    if room is None:
        return None
    ids = [start.id for start in room.robots]
    faults = [fault for fault in faults if fault.get("robot", "all") in ("all", *ids)]
    kept = rng.randint(1, len(ids)) if len(ids) > 1 and rng.random() < 0.05 else len(ids)
    if kept < len(ids) and all(fault.get("robot", "all") in ("all", *ids[:kept]) for fault in faults):
        tables["robots"], ids = kept, ids[:kept]
    if unlike := {robot_id: own for robot_id, own in unlike.items() if int(robot_id) in ids}:
        tables["robots"] = {**({"count": tables["robots"]} if "robots" in tables else {}), **unlike}
    rta.with_own_modules(rng, room, figures, nasty)
    tables["rta"] = rta.table
    tables["battery"] = _battery(rng, floor, figures, rta.battery, ids, nasty)
    tables.update(draw_ac(rng, room, figures, rta, nasty))
    if faults:
        tables["fault"] = faults
    return Configuration({key: value for key, value in tables.items() if value != {}}, room)


def _room_for(floor: Floor, nasty: bool) -> int:
    """Return about how many robots there is room for."""
    boxes = sum(shapely.Polygon(box).area for box in floor.boxes)
    return max(1, int((floor.inside.area - boxes) / (0.6 if nasty else 1.2)))


def _robot(rng: Random, nasty: bool, common: Tables | None = None) -> Tables:
    """Return what robots promise, some of it: slow ones, fast ones, weak brakes, late samples, large bodies.

    Args:
        rng: where from.
        nasty: at the edges of what is valid.
        common: what all robots promise, where this is what one of them promises in its place.
    """
    scale = 1.0 if nasty else 0.5
    slow = rng.random() < 0.5
    figures = {
        "v_max_m_s": 0.22 - rng.uniform(0.0, 0.18 if nasty else 0.14) if slow else _spread(rng, 0.22, 1.5),
        "brake_m_s2": 1.0 - rng.uniform(0.0, 0.85) * scale if slow else _spread(rng, 0.4, 3.0),
        "accel_m_s2": _spread(rng, 0.2, 3.0),
        "yaw_rate_max_rad_s": _spread(rng, 0.3, 5.0),
        "latency_s": 0.05 + rng.uniform(0.0, 0.2) * scale,
        "sample_age_s": rng.uniform(0.0, 0.2) * scale,
        "jitter_s": rng.uniform(0.0, 0.1) * scale,
        "lease_s": (0.05 if nasty and rng.random() < 0.3 else 0.1) + rng.uniform(0.0, 0.5) * scale,
        "position_noise_m": rng.uniform(0.0, 0.1) * scale,
        "speed_noise_m_s": rng.uniform(0.0, 0.05) * scale,
        "heading_noise_rad": rng.uniform(0.0, 0.2) * scale,
        "overshoot_m": OVERSHOOT_M + rng.uniform(0.0, 0.05) * scale,
        "body_radius_m": 0.105 + rng.uniform(0.0, 0.4) * scale,
    }
    kept = rng.sample([*figures], rng.randint(1, 6))
    found = {name: round(value, 3) for name, value in figures.items() if name in kept}
    promised = SimulatedPromise.model_validate({**(common or {}), **found, "tube_m": None})
    overshoot_m = 0.0 if nasty and rng.random() < 0.2 else promised.overshoot_m or 0.0
    if rng.random() < 0.4 or overshoot_m or "tube_m" in (common or {}):
        least_m = max(tube_m(promised.limits, PERIOD_S), overshoot_m)
        found["tube_m"] = round(least_m + 0.001 + rng.uniform(0.0, 0.08) * scale, 3)
    return found


def _spread(rng: Random, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _room(rng: Random, promises: Sequence[Tables]) -> float:
    """Return how many times as large rooms are for robots that are larger or faster than those that rooms are for."""
    times = 1.0
    for each in promises:
        top_m_s, brake_m_s2 = each.get("v_max_m_s", 0.22), each.get("brake_m_s2", 1.0)
        times = max(times, top_m_s / 0.22, top_m_s**2 / brake_m_s2 / 0.3, each.get("body_radius_m", 0.0) / 0.2)
    times = min(times, MOST_TIMES)
    return rng.uniform(max(1.0, 0.6 * times), times)


def _promised(
    tables: Tables, unlike: Mapping[str, Tables], faults: Sequence[dict[str, Any]], robots: int, tick_s: float
) -> list[Capabilities]:
    """Return what each robot promises under its faults."""
    name = tables["backend"]
    backend = load_backend(name, to_open=False)
    nowhere = Workspace(1.0, 1.0, (), ())
    options = tables.get("backends", {}).get(name, {})
    promises = []
    for robot_id in range(1, robots + 1):
        both = {**options.get("promise", {}), **unlike.get(str(robot_id), {})}
        declared = backend.promises(backend.config_model(workspace=nowhere, **{**options, "promise": both}))
        made = []
        for table in faults:
            if table.get("robot", "all") in ("all", robot_id):
                kind: type[Fault[Any]] = resolve_name(FAULT_KINDS[table["kind"]])
                fault_options: FaultOptions = kind.options_model.model_validate(table)
                made.append(kind(fault_options, Context(robot_id, tick_s, Random(0))))
        promises.append(widened(declared, made))
    return promises


def _battery(rng: Random, floor: Floor, figures: Figures, module: Tables, ids: Sequence[int], nasty: bool) -> Tables:
    """Return the batteries, and put into the battery's module what they ask for."""
    longest_m = (1.0 if not floor.boxes and len(floor.fence) == 4 else 2.0) * (floor.width + floor.depth)
    reserve = rng.uniform(1.0, 10.0) if nasty else rng.uniform(2.5, 6.0)
    if rng.random() < 0.3:
        reserve = 4.0
    else:
        reserve = module["reserve_factor"] = round(reserve, 2)
    drive_s = math.exp(rng.uniform(math.log(200.0), math.log(3600.0)))
    # What has to be in the battery before the AC may have the robot: the way home, its jump, and the reserve.
    needed_s = (reserve + 2.0) * longest_m / figures.slowest_m_s
    part = rng.uniform(0.3, 0.9) if nasty else rng.uniform(0.15, 0.7)
    table: Tables = {}
    if rng.random() < 0.15 and needed_s < part * 1800.0:
        drive_s = 1800.0
    else:
        drive_s = table["drive_s"] = round(max(drive_s, needed_s / part), 1)
    needed = needed_s / drive_s
    if rng.random() < 0.8 or needed > 0.75 or drive_s > 7200.0:
        module["phi_safer"] = round(rng.uniform(min(0.97, needed + 0.1), 1.0 if nasty else 0.97), 3)
    if drive_s > 7200.0 or rng.random() < 0.7:
        table["idle_s"] = round(drive_s * rng.uniform(1.0 if nasty else 2.0, 8.0), 1)
    if rng.random() < 0.7:
        table["charge_s"] = round(math.exp(rng.uniform(math.log(20.0), math.log(1800.0 if nasty else 600.0))), 1)
    if rng.random() < 0.5:
        # Some begin with hardly more than the way home asks for, and several have to charge at the same time.
        low = min(0.9, needed * (0.6 if nasty else 0.9) + 0.02)
        high = low + (1.0 - low) * rng.choice((0.1, 0.4, 1.0))
        chosen = [robot_id for robot_id in ids if rng.random() < 0.8]
        initial = {str(robot_id): round(rng.uniform(low, high), 3) for robot_id in chosen}
        if initial:
            table["initial"] = initial
    return table
