"""Draws advanced controllers and their options."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random
from typing import Any, Final, get_args

from shapely import LineString, Point  # type: ignore[import-untyped]

from soter.campaign.random.configuration import Tables
from soter.campaign.random.figures import Figures
from soter.campaign.random.modules import Rta
from soter.campaign.random.room import DrawnRoom
from soter.config.tables import Targets
from soter.controllers import ADVERSARIES

VISIT: Final = "soter.campaign.random.attackers:Visit"
_PLACES: Final = 10


def draw_ac(rng: Random, room: DrawnRoom, figures: Figures, rta: Rta, nasty: bool) -> Tables:
    """Return the keys of a mission for the AC, its targets and its planner."""
    if rta.kept_out is not None and rng.random() < 0.5:
        # To and fro across what a module of the user's own keeps robots out of.
        places = [each for place in _places(rng, room, figures, rta) for each in (place, [*rta.kept_out])]
        return {"ac": VISIT, "controllers": {"Visit": {"places": places, "stay_s": 0.0}}}
    chance = rng.random()
    if chance < 0.45:
        return _mission(rng)
    tables: Tables = _mission(rng) if rng.random() < 0.1 else {}
    if chance < 0.6:
        places, stay_s = _places(rng, room, figures, rta), round(rng.choice((0.0, rng.uniform(0.0, 400.0))), 1)
        visit: dict[str, Any] = {"places": places, "stay_s": stay_s}
        if len(room.robots) > 1 and rng.random() < 0.4:
            # One robot parks where another has to charge.
            parked, owner = rng.sample(range(len(room.robots)), 2)
            at = [round(value, 4) for value in room.stations[owner].centre]
            visit["parked"] = {str(room.robots[parked].id): at}
        return {**tables, "ac": VISIT, "controllers": {"Visit": visit}}
    name = rng.choice([*ADVERSARIES])
    options = _OPTIONS[name](rng) if name in _OPTIONS else {}
    if nasty and rng.random() < 0.4:
        options["facts"] = {
            "v_max_m_s": round(rng.uniform(0.05, 0.4), 2),
            "brake_m_s2": round(rng.uniform(0.3, 3.0), 2),
            "latency_s": round(rng.uniform(0.0, 0.3), 3),
        }
    tables["ac"] = f"adversary:{name}"
    if options:
        tables["adversaries"] = {name: options}
    return tables


def _mission(rng: Random) -> Tables:
    tables: Tables = {"targets": rng.choice(get_args(Targets))}
    if rng.random() < 0.2:
        tables["mission"] = {"use": "surveillance"}
    if rng.random() < 0.1:
        tables["ac"] = "mission"
    if rng.random() < 0.4:
        tables["target_timeout_s"] = round(rng.uniform(20.0, 300.0), 1)
    # Mostly a quick one in this process; now and then one that plans around boxes, in a process of its own.
    tables["planner"] = "ompl-rrtconnect" if rng.random() < 0.05 else "straight-line"
    if rng.random() < 0.3 or tables["planner"] != "straight-line":
        options: dict[str, Any] = {"clearance_m": round(rng.uniform(0.0, 0.3), 3)}
        if tables["planner"] != "straight-line":
            options |= {"range_m": round(rng.uniform(0.2, 2.0), 2), "checks": rng.randint(500, 5000)}
        tables["planners"] = {tables["planner"]: options}
    return tables


def _places(rng: Random, room: DrawnRoom, figures: Figures, rta: Rta) -> list[list[float]]:
    """Return places, each in sight of the one before: others' stations, or the far ends that an AC may get to."""
    if rng.random() < 0.35:
        centres = [[round(value, 4) for value in station.centre] for station in room.stations]
        rng.shuffle(centres)
        return centres
    fence_m = figures.reach_m(rta.geofence_delta_s)
    inside = room.inside.buffer(-fence_m, join_style="mitre")
    keep_m = figures.promise.body_radius_m + rta.obstacle_safe_m + rta.obstacle_reach_m
    allowed = inside.difference(room.kept_out.buffer(keep_m))
    low_x, low_y, high_x, high_y = room.inside.bounds
    start = rng.choice(room.robots)
    chain = [(start.x, start.y)]
    for _ in range(_PLACES):
        tried = [(rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)) for _ in range(40)]
        seen = [at for at in tried if allowed.covers(Point(at)) and allowed.covers(LineString([chain[-1], at]))]
        if seen:
            # Away from the places before: down corridors and into corners.
            chain.append(max(seen, key=lambda at: min(math.dist(at, other) for other in chain)))
    return [[round(x, 3), round(y, 3)] for x, y in chain]


_OPTIONS: Final[dict[str, Callable[[Random], dict[str, Any]]]] = {
    "random": lambda rng: {"most_s": round(rng.uniform(0.5, 20.0), 1), "beyond_m": round(rng.uniform(0.1, 2.0), 1)},
    "boundary-hugging": lambda rng: {
        "spare_m": round(rng.uniform(-0.05, 0.1), 3), "speed_m_s": round(rng.uniform(0.03, 0.22), 3),
    },
    "chase": lambda rng: {"dart": round(rng.random(), 2), "reverse_m": round(rng.uniform(0.05, 1.0), 2)},
    "pincer": lambda rng: {"turn_s": round(rng.uniform(5.0, 300.0), 1)},
    # The cost grows with every sequence; a few suffice.
    "search": lambda rng: {
        "candidates": rng.randint(2, 12), "ahead_s": round(rng.uniform(1.0, 4.0), 1),
        "wait_s": round(rng.uniform(0.1, 1.0), 2),
    },
    # Without threads, so that runs repeat; few enough to be quick.
    "flood": lambda rng: {"commands": rng.randint(1, 20), "threads": 0},
}  # fmt: skip
"""By adversary: its own options, if it has any; always given for `flood` and `search`, now and then for others."""
