"""The second judge: shapely on true poses. Shares no geometry with the stack or with the simulator's judge.

A robot is assumed to move straight from one recorded pose to the next. Every such piece of its way is judged, and for
two robots every piece of their relative way.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely  # type: ignore[import-untyped]
from numpy.typing import NDArray

from soter.campaign.random.room import DrawnRoom, Patch

EXACT_M: Final = 1e-6
"""Tolerance of distances, for rounding."""

Series = NDArray[np.float64]


@dataclass(frozen=True)
class PromisedLimits:
    """The limits that a mission promises to keep.

    Attributes:
        rules: the rules whose modules are on.
        radius_m: body radius of each robot, by its id.
        obstacle_m: phi_safe of the obstacle module.
        separation_m: phi_safe of the collision module.
        far_m: by name of a user's rule, its least distance of robots.
        keep_out: by name of a user's rule, x, y and radius of the disc that it keeps centres out of.
    """

    rules: tuple[str, ...]
    radius_m: Mapping[int, float]
    obstacle_m: float
    separation_m: float
    far_m: Mapping[str, float]
    keep_out: Mapping[str, tuple[float, float, float]]

    @classmethod
    def of(cls, rta: Mapping[str, Any], radius_m: Mapping[int, float]) -> PromisedLimits:
        """Return the limits in `[rta]`, given with its defaults."""
        if not rta["enabled"]:
            return cls((), radius_m, 0.0, 0.0, {}, {})
        own = {name: table for name, table in rta.get("module", {}).items() if table.get("enabled", True)}
        options = {name: table.get("options", {}) for name, table in own.items()}
        return cls(
            (*rta["modules"], *own),
            radius_m,
            rta["obstacle"]["phi_safe_m"],
            rta["collision"]["phi_safe_m"],
            {name: table["far_m"] for name, table in options.items() if "far_m" in table},
            {
                name: (table["x_m"], table["y_m"], table["radius_m"])
                for name, table in options.items()
                if "radius_m" in table
            },
        )


@dataclass(frozen=True)
class RuleBreach:
    """One interval in which a rule was broken: rule, robots, start in seconds, and the worst margin."""

    rule: str
    robots: tuple[int, ...]
    start_s: float
    end_s: float
    margin: float


@dataclass(frozen=True)
class Ways:
    """Ways seen by a witness: times in seconds; by time and robot, metres east, metres north, charge from 0 to 1."""

    ids: tuple[int, ...]
    times: Series
    x: Series
    y: Series
    charge: Series

    def on_station(self, stations: Collection[Patch]) -> NDArray[np.bool_]:
        """Return, by time and robot, whether the robot's centre is on a station."""
        area = shapely.union_all([shapely.Polygon(station.ring) for station in stations]).buffer(1e-9)
        shapely.prepare(area)
        return np.asarray(shapely.intersects_xy(area, self.x, self.y))


def judge(room: DrawnRoom, limits: PromisedLimits, ways: Ways) -> list[RuleBreach]:
    """Return every interval in which a rule was broken, the earliest first."""
    found: list[RuleBreach] = []
    for index, robot_id in enumerate(ways.ids):
        for rule, margins in _alone(room, limits, ways, index):
            found += _breaches(rule, (robot_id,), ways.times, margins)
    for first in range(len(ways.ids)):
        for second in range(first + 1, len(ways.ids)):
            robots = ways.ids[first], ways.ids[second]
            for rule, margins in _pair(limits, ways, first, second):
                found += _breaches(rule, robots, ways.times, margins)
    return sorted(found, key=lambda breach: (breach.start_s, breach.rule, breach.robots))


def _alone(room: DrawnRoom, limits: PromisedLimits, ways: Ways, index: int) -> Iterator[tuple[str, Series]]:
    """Yield the margins of the rules about one robot; below 0 is broken."""
    x, y, charge = ways.x[:, index], ways.y[:, index], ways.charge[:, index]
    if "geofence" in limits.rules:
        yield "geofence", EXACT_M - shapely.distance(room.inside, shapely.points(x, y))
    if "obstacle" in limits.rules and room.boxes:
        yield "obstacle", _apart(room.kept_out, x, y, limits.radius_m[ways.ids[index]] + limits.obstacle_m) - EXACT_M
    if "battery" in limits.rules:
        flat = (charge <= 0.0) & ~ways.on_station(room.stations)[:, index]
        yield "battery", np.where(flat, -1.0, charge)
    for name, (at_x, at_y, radius_m) in limits.keep_out.items():
        yield name, _apart(shapely.Point(at_x, at_y), x, y, radius_m) + EXACT_M


def _pair(limits: PromisedLimits, ways: Ways, first: int, second: int) -> Iterator[tuple[str, Series]]:
    dx, dy = ways.x[:, second] - ways.x[:, first], ways.y[:, second] - ways.y[:, first]
    here = shapely.Point(0.0, 0.0)
    if "collision" in limits.rules:
        # Bodies that overlap collide, whatever distance of centres the mission allows.
        bodies_m = limits.radius_m[ways.ids[first]] + limits.radius_m[ways.ids[second]]
        yield "collision", _apart(here, dx, dy, max(limits.separation_m, bodies_m)) + EXACT_M
    for name, far_m in limits.far_m.items():
        yield name, _apart(here, dx, dy, far_m) + EXACT_M


def _apart(of: Any, x: Series, y: Series, least_m: float) -> Series:
    """Return the distance of every piece of a way from a geometry, less `least_m`."""
    shapely.prepare(of)
    margins: Series = shapely.distance(of, shapely.points(x, y)) - least_m
    # No point of a piece is nearer than its nearer end by more than half of its length.
    halves = np.hypot(np.diff(x), np.diff(y)) / 2.0
    near = np.flatnonzero(np.minimum(margins[:-1], margins[1:]) < halves + EXACT_M)
    if near.size:
        ends = np.stack((x, y), axis=-1)
        pieces = shapely.linestrings(np.stack((ends[near], ends[near + 1]), axis=1))
        margins[near + 1] = np.minimum(margins[near + 1], shapely.distance(of, pieces) - least_m)
    return margins


def _breaches(rule: str, robots: tuple[int, ...], times: Series, margins: Series) -> Iterator[RuleBreach]:
    broken = np.concatenate(([False], margins < 0.0, [False]))
    edges = np.flatnonzero(broken[1:] != broken[:-1])
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        worst = float(margins[begin:end].min())
        yield RuleBreach(rule, robots, float(times[begin]), float(times[end - 1]), round(worst, 6))
