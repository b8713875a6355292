"""Draws a configuration from a seed: a mission and its room, over all keys of mission files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from random import Random
from typing import Final

import shapely  # type: ignore[import-untyped]

from soter.adapters.pybullet import PERIOD_S
from soter.campaign.random.acs import draw_ac
from soter.campaign.random.configuration import Configuration, Tables
from soter.campaign.random.faults import draw_faults
from soter.campaign.random.figures import Figures, worst
from soter.campaign.random.fleet import DrawnFleet, draw_fleet
from soter.campaign.random.floor import Floor, draw_floor
from soter.campaign.random.modules import draw_rta
from soter.campaign.random.places import STATION_M, Needs, furnish

NASTY: Final = 0.45
"""Share of the configurations that are drawn at the edges of what is valid."""

DURATION_S: Final = (600.0, 1200.0)
MOST_ROBOTS: Final = 10

_TICKS: Final = (0.05, 0.05, 0.05, 0.05, 0.1)
_ODD_TICKS: Final = (0.01, 0.02, 0.025, 0.04, 0.15, 0.2)
_HOME_M: Final = 0.15
_SLACK_M: Final = 0.03
_STOPS_M: Final = 0.03


def draw(seed: int, engine: str = "kinematic") -> Configuration:
    """Return the configuration of a seed; the same seed gives the same one.

    `engine` is that of the backend `pybullet`; with `kinematic`, most missions use the backend `kinematic`.
    """
    rng = Random(f"configuration {seed}")
    nasty = rng.random() < NASTY
    while True:
        found = _drawn(rng, nasty, engine)
        if found is not None:
            return found


def _drawn(rng: Random, nasty: bool, engine: str) -> Configuration | None:
    """Return a configuration, or None if no robot fits into the drawn room."""
    tables: Tables = {"seed": rng.randrange(2**31), "duration_s": round(rng.uniform(*DURATION_S), 1)}
    fleet = draw_fleet(rng, nasty, engine)
    tables.update(fleet.tables)
    floor = draw_floor(rng, nasty).scaled(fleet.room(rng))
    if rng.random() < 0.35:
        floor = floor.reshaped(rng)
    tick_s = rng.choice((nasty and rng.random() < 0.2 and _odd_ticks(fleet)) or _TICKS)
    if tick_s != 0.05 or rng.random() < 0.1:
        tables["base_tick_s"] = tick_s
    wanted = min(rng.choices(range(1, MOST_ROBOTS + 1), (20, 22, 14, 12, 8, 7, 6, 5, 4, 4))[0], _room_for(floor, nasty))
    faults = draw_faults(rng, range(1, wanted + 1), nasty)
    promises = fleet.promises(faults, wanted, tick_s)
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
    if unlike := {str(robot_id): fleet.unlike[robot_id] for robot_id in ids if robot_id in fleet.unlike}:
        tables["robots"] = {**({"count": tables["robots"]} if "robots" in tables else {}), **unlike}
    rta.with_own_modules(rng, room, figures, nasty)
    tables["rta"] = rta.table
    tables["battery"] = _battery(rng, floor, figures, rta.battery, ids, nasty)
    tables.update(draw_ac(rng, room, figures, rta, nasty))
    if faults:
        tables["fault"] = faults
    return Configuration({key: value for key, value in tables.items() if value != {}}, room)


def _odd_ticks(fleet: DrawnFleet) -> list[float]:
    """Return unusual base ticks that suit the robots: short enough for their leases and the age of samples."""
    promises = fleet.promises((), MOST_ROBOTS, PERIOD_S)
    most_s, age_s = min(each.lease_s for each in promises), min(each.sample_age_s for each in promises)
    periods = [round(tick_s / PERIOD_S, 6) for tick_s in _ODD_TICKS]
    return [
        tick_s
        for tick_s, count in zip(_ODD_TICKS, periods, strict=True)
        if tick_s <= most_s and (count.is_integer() or age_s >= PERIOD_S)
    ]


def _room_for(floor: Floor, nasty: bool) -> int:
    """Return about how many robots the floor has room for."""
    boxes = sum(shapely.Polygon(box).area for box in floor.boxes)
    return max(1, int((floor.inside.area - boxes) / (0.6 if nasty else 1.2)))


def _battery(rng: Random, floor: Floor, figures: Figures, module: Tables, ids: Sequence[int], nasty: bool) -> Tables:
    """Return the batteries, and complete the table of the battery's module for them."""
    reserve = rng.uniform(1.0, 10.0) if nasty else rng.uniform(2.5, 6.0)
    if rng.random() < 0.3:
        reserve = 4.0
    else:
        reserve = module["reserve_factor"] = round(reserve, 2)
    drive_s = math.exp(rng.uniform(math.log(200.0), math.log(3600.0)))
    # Charge that the AC needs to get control: for the return path, its jump, and the reserve.
    needed_s = (reserve + 2.0) * floor.longest_m / figures.slowest_m_s
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
        # Some robots begin with hardly more than the return path costs, and several have to charge at once.
        low = min(0.9, needed * (0.6 if nasty else 0.9) + 0.02)
        high = low + (1.0 - low) * rng.choice((0.1, 0.4, 1.0))
        chosen = [robot_id for robot_id in ids if rng.random() < 0.8]
        initial = {str(robot_id): round(rng.uniform(low, high), 3) for robot_id in chosen}
        if initial:
            table["initial"] = initial
    return table
