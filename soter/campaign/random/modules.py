"""Draws `[rta]`: settings of the safety modules that suit the robots and the room."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from soter.campaign.random.configuration import Tables
from soter.campaign.random.figures import Figures
from soter.campaign.random.floor import Floor
from soter.campaign.random.room import DrawnRoom
from soter.config.tables import MODULES

MODELS: Final = ("speed-acceleration", "unicycle")
FAR: Final = "soter.campaign.random.attackers:declare_far"
KEEP_OUT: Final = "soter.campaign.random.attackers:declare_keep_out"


@dataclass
class Rta:
    """The table `[rta]`, and its figures that places and batteries depend on.

    Attributes:
        battery: `[rta.battery]`, which is completed when the batteries are drawn.
        kept_out: the middle of the disc that a module of the user's own keeps robots out of; None without one.
    """

    table: Tables = field(default_factory=dict)
    battery: Tables = field(default_factory=dict)
    geofence_delta_s: float = 0.05
    obstacle_safe_m: float = 0.0
    obstacle_safer_m: float = 0.1
    obstacle_reach_m: float = 0.1
    apart_m: float = 0.5
    passing_m: float = 0.5
    collision_safer_m: float = 0.5
    kept_out: tuple[float, float] | None = None

    def with_own_modules(self, rng: Random, room: DrawnRoom, figures: Figures, nasty: bool) -> None:
        """Add a user's own module now and then."""
        if rng.random() >= 0.08:
            return
        reach_m = figures.spare_m(2.0 * figures.tick_s)
        options: dict[str, Any]
        if len(room.robots) > 1 and rng.random() < 0.5:
            far_m = round(self.collision_safer_m + rng.uniform(0.0, 1.0), 2)
            name, declare = "keep-far", FAR
            options = {"far_m": far_m, "spare_m": _up(2.0 * reach_m * rng.uniform(1.05, 1.5))}
        else:
            name, declare = "keep-out", KEEP_OUT
            low_x, low_y, high_x, high_y = room.inside.bounds
            at = rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)
            if not nasty:
                # Away from starts and stations, which the disc must not reach.
                at = max(
                    ((rng.uniform(low_x, high_x), rng.uniform(low_y, high_y)) for _ in range(20)),
                    key=lambda place: _nearest_m(place, room),
                )
            spare_m = _up(reach_m * rng.uniform(1.05, 1.5))
            most_m = max(0.05, min(1.5, _nearest_m(at, room) - spare_m - reach_m))
            radius_m = round(rng.uniform(0.05, most_m), 2)
            options = {"x_m": round(at[0], 2), "y_m": round(at[1], 2), "radius_m": radius_m, "spare_m": spare_m}
            options["ahead"] = rng.random() < 0.5
            self.kept_out = round(at[0], 2), round(at[1], 2)
        own: Tables = {"declare": declare, "options": options}
        if rng.random() < 0.4:
            own["before"] = rng.choice(MODULES)
        if rng.random() < 0.1:
            own["enabled"] = rng.random() < 0.5
        self.table["module"] = {name: own}


def _nearest_m(place: tuple[float, float], room: DrawnRoom) -> float:
    starts = [(start.x, start.y) for start in room.robots]
    return min(math.dist(place, other) for other in (*starts, *(station.centre for station in room.stations)))


def draw_rta(rng: Random, floor: Floor, figures: Figures, nasty: bool) -> Rta:
    """Return the modules' settings. Ordinary draws are well-formed by the conditions in `figures`."""
    found = Rta()
    table, tick_s = found.table, figures.tick_s
    if rng.random() < 0.06:
        table["modules"] = sorted(rng.sample(MODULES, rng.randint(1, 3)), key=lambda _: rng.random())
    _collision(rng, found, figures, nasty)
    _obstacle(rng, found, figures, nasty)
    _geofence(rng, found, floor, figures, nasty)
    delta_s = _ticks(rng, tick_s, 2.0 if nasty else 1.0)
    if rng.random() < 0.4 or not _whole(1.0, tick_s):
        found.battery["delta_s"] = delta_s
    table["battery"] = found.battery
    if rng.random() < 0.1:
        safe_m = round(rng.uniform(0.0, 0.1), 3)
        table["path"] = {
            "enabled": True,
            "phi_safe_m": safe_m,
            "phi_safer_m": round(safe_m + rng.uniform(0.01, 0.1), 3),
        }
        if rng.random() < 0.5:
            table["path"]["dwell_s"] = round(rng.uniform(0.0, 1.0), 2)
    if not _whole(0.05, tick_s) or (rng.random() < 0.3 and "path" in table):
        table.setdefault("path", {})["delta_s"] = tick_s
    for name in MODULES:
        if rng.random() < 0.25:
            table.setdefault(name, {})["dwell_s"] = round(30.0 * rng.random() ** 4 if nasty else rng.random(), 2)
        promise = figures.promise
        promised = None not in (promise.accel_m_s2, promise.speed_noise_m_s, promise.heading_noise_rad)
        if name != "battery" and rng.random() < 0.2 and (promised or (nasty and rng.random() < 0.1)):
            table.setdefault(name, {})["model"] = rng.choice(MODELS if name != "collision" or nasty else MODELS[:1])
    return found


def _slack(rng: Random, nasty: bool) -> float:
    """Return the factor on a needed figure; for nasty draws it is close to 1, on either side."""
    return rng.uniform(0.98, 1.3) if nasty else rng.uniform(1.02, 1.8)


def _collision(rng: Random, found: Rta, figures: Figures, nasty: bool) -> None:
    delta_s, safe_m, safer_m = 0.05, 0.3, 0.5
    least_m = max(4.0 * figures.leg_m, 2.0 * figures.promise.body_radius_m)

    def fits() -> bool:
        spare_m = 2.0 * figures.spare_m(delta_s)
        often = _whole(delta_s, figures.tick_s) and delta_s >= figures.early_s
        return often and safe_m >= least_m and safer_m - safe_m >= spare_m

    if rng.random() > 0.3 or not fits():
        delta_s = _ticks(rng, figures.tick_s, 0.4 if nasty else 0.15)
        if not nasty or rng.random() < 0.8:
            delta_s = max(delta_s, round(math.ceil(figures.early_s / figures.tick_s + 0.01) * figures.tick_s, 6))
        safe_m = _up(max(least_m * 1.001, rng.uniform(0.2 if nasty else 0.22, 0.45)))
        if nasty and rng.random() < 0.1:
            safe_m = round(rng.uniform(0.05, 0.25), 3)
        safer_m = _up(safe_m + 2.0 * figures.spare_m(delta_s) * _slack(rng, nasty))
        found.table["collision"] = {"delta_s": delta_s, "phi_safe_m": safe_m, "phi_safer_m": safer_m}
    found.collision_safer_m = safer_m
    found.apart_m = safer_m + 0.002
    # For two robots that pass each other under their safe controllers, or one that passes another at its station.
    found.passing_m = safer_m + 2.0 * figures.reach_m(delta_s) + 0.05


def _obstacle(rng: Random, found: Rta, figures: Figures, nasty: bool) -> None:
    delta_s, safe_m, safer_m = 0.05, 0.0, 0.1
    fits = _whole(delta_s, figures.tick_s) and safer_m - safe_m >= figures.spare_m(delta_s)
    if rng.random() > 0.3 or not fits:
        delta_s = _ticks(rng, figures.tick_s, 0.3 if nasty else 0.1)
        safe_m = 0.0 if rng.random() < 0.6 else round(rng.uniform(0.0, 0.1), 3)
        safer_m = _up(safe_m + figures.spare_m(delta_s) * _slack(rng, nasty))
        found.table["obstacle"] = {"delta_s": delta_s, "phi_safe_m": safe_m, "phi_safer_m": safer_m}
    found.obstacle_safe_m, found.obstacle_safer_m = safe_m, safer_m
    found.obstacle_reach_m = figures.spare_m(delta_s)


def _geofence(rng: Random, found: Rta, floor: Floor, figures: Figures, nasty: bool) -> None:
    delta_s, inset_m = 0.05, 0.1
    least_m = floor.wide_m
    fits = _whole(delta_s, figures.tick_s) and inset_m >= figures.spare_m(delta_s) and inset_m < 0.35 * least_m
    if rng.random() > 0.3 or not fits:
        delta_s = _ticks(rng, figures.tick_s, 0.5)
        if not nasty:
            # A small room needs a shorter Delta for the fence.
            while delta_s > figures.tick_s and figures.spare_m(delta_s) > 0.2 * least_m:
                delta_s = round(delta_s - figures.tick_s, 6)
        inset_m = _up(figures.spare_m(delta_s) * _slack(rng, nasty))
        if nasty and rng.random() < 0.3:
            # Almost no area is left inside.
            inset_m = max(inset_m, round(rng.uniform(0.4, 0.499) * least_m, 3))
        if not nasty:
            inset_m = max(_up(figures.spare_m(delta_s)), min(inset_m, round(0.3 * least_m, 3)))
        found.table["geofence"] = {"delta_s": delta_s, "phi_safer_inset_m": inset_m}
    found.geofence_delta_s = delta_s


def _ticks(rng: Random, tick_s: float, most_s: float) -> float:
    """Return a random period of whole ticks."""
    return round(rng.randint(1, max(1, int(most_s / tick_s + 1e-6))) * tick_s, 6)


def _whole(period_s: float, tick_s: float) -> bool:
    return math.isclose(round(period_s / tick_s) * tick_s, period_s) and period_s >= tick_s - 1e-9


def _up(value: float) -> float:
    """Return a figure rounded up to millimetres."""
    return math.ceil(value * 1000.0 - 1e-9) / 1000.0
