"""Checks before a run that stations and return paths are a well-formed infrastructure, and refuges can be reached.

Cap, Vokrinek and Kleiner, "Complete decentralized method for on-line multi-robot trajectory planning in well-formed
infrastructures", ICAPS 2015: every station has to be reachable with every other station occupied. Together with the
return path that a robot keeps as it moves, this is all that a workspace has to provide: wherever the AC takes a robot,
it can go back to its station, and from there to where every static rule lets go.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, islice
from typing import Final, NamedTuple

import numpy as np

from soter.errors import IllFormedModule, ceil_m, floor_m
from soter.geometry.workspace import RobotPlace
from soter.rta import Situation
from soter.sdk import Link, RobotState
from soter.stack.battery import DOCKED_M
from soter.stack.recovery import RecoveryPlanner
from soter.stack.refuge import RefugeFinder
from soter.stack.return_path import ReturnPath
from soter.stack.right_of_way import BATTERY
from soter.stack.site_routes import Rectangle
from soter.stack.terrain import Point

_LOOK_M: Final = 0.05
"""Distance between the places beside an occupied station from which paths are looked for."""

_BESIDE_M: Final = 1e-6


class _TooNear(NamedTuple):
    """What is too near to a place for a path to end there: the rule's module, the object, the distances in metres."""

    module: str
    what: str
    found_m: float
    needed_m: float


def room_at(station: Point, apart_m: float) -> Rectangle:
    """Return the square around the disc of radius `apart_m` around a station."""
    return station[0] - apart_m, station[1] - apart_m, station[0] + apart_m, station[1] + apart_m


def occupied(station: Point, apart_m: float, own: Point) -> list[Rectangle]:
    """Return rectangles that hold the disc of radius `apart_m` around another robot's station.

    That is the square around the disc, unless this robot's own station is in a corner of the square: cut off there, it
    leaves the own station free.
    """
    x_m, y_m = station
    dx_m, dy_m = own[0] - x_m, own[1] - y_m
    square = room_at(station, apart_m)
    if max(abs(dx_m), abs(dy_m)) >= apart_m or math.hypot(dx_m, dy_m) < apart_m:
        return [square]
    low_x, low_y, high_x, high_y = square
    if abs(dx_m) >= abs(dy_m):
        half_m = math.sqrt(apart_m * apart_m - dx_m * dx_m)
        if dx_m > 0.0:
            return [(low_x, low_y, own[0], high_y), (own[0], y_m - half_m, high_x, y_m + half_m)]
        return [(own[0], low_y, high_x, high_y), (low_x, y_m - half_m, own[0], y_m + half_m)]
    half_m = math.sqrt(apart_m * apart_m - dy_m * dy_m)
    if dy_m > 0.0:
        return [(low_x, low_y, high_x, own[1]), (x_m - half_m, own[1], x_m + half_m, high_y)]
    return [(low_x, own[1], high_x, high_y), (x_m - half_m, low_y, x_m + half_m, own[1])]


def shut_in_by(path: ReturnPath, unoccupied: Callable[[], ReturnPath], stations: Sequence[Sequence[Rectangle]]) -> int:
    """Return how many of the other robots' stations, while they are occupied, shut a robot off from its own.

    Such as one in a corridor that leads nowhere else. Whatever a station shuts in begins beside its rectangles, so
    paths are looked for from there.

    Args:
        path: the robot's return path while all other stations are occupied.
        unoccupied: makes the one while none is.
        stations: the rectangles of each other station.
    """
    edges, shut_in = [*chain(*stations)], [False] * len(stations)
    for index, station in enumerate(stations):
        if lost := [*_lost(path, station, edges)]:
            free = unoccupied()
            shut_in[index] = any(free.shortest_m(*place) < math.inf for place in lost)
    return sum(shut_in)


def _lost(path: ReturnPath, station: Sequence[Rectangle], edges: Sequence[Rectangle]) -> Iterator[Point]:
    """Yield places beside rectangles that fit and have no return path."""
    leads_back: Point | None = None
    # Where nothing else is in the way, all the places are connected.
    for x, y in islice(_beside(station), 1 if path.open_around(station) else None):
        if not path.fits(x, y) or any(each[0] < x < each[2] and each[1] < y < each[3] for each in edges):
            continue
        # To look whether the last one with a path is in sight is much quicker than to look for a path.
        if (leads_back is not None and path.sees((x, y), leads_back)) or path.shortest_m(x, y) < math.inf:
            leads_back = x, y
        else:
            yield x, y


def _beside(station: Sequence[Rectangle]) -> Iterator[Point]:
    """Yield places all around rectangles, corners included, side by side."""
    for low_x, low_y, high_x, high_y in station:
        along_x = np.linspace(low_x, high_x, 1 + math.ceil((high_x - low_x) / _LOOK_M)).tolist()
        along_y = np.linspace(low_y, high_y, 1 + math.ceil((high_y - low_y) / _LOOK_M)).tolist()
        yield from ((x, y) for y in (low_y - _BESIDE_M, high_y + _BESIDE_M) for x in along_x)
        yield from ((x, y) for x in (low_x - _BESIDE_M, high_x + _BESIDE_M) for y in along_y)


def check_infrastructure(
    robot: RobotPlace,
    others: Sequence[RobotPlace],
    path: ReturnPath,
    refuges: RefugeFinder,
    recovery: RecoveryPlanner,
    age_s: float,
    noise_m: float,
) -> None:
    """Check that a robot can always get to its station, stand there, and get away again.

    Args:
        robot: the robot's start and station.
        others: those of the other robots.
        path: the robot's return path.
        refuges: finds places where every static rule lets go.
        recovery: says which clearances paths have to keep.
        age_s: the largest age of a sample of any robot.
        noise_m: error of the robot's position, at most.

    Raises:
        IllFormedModule: names the place, the figures and what would do.
    """
    _check_station(robot, path, recovery, noise_m)
    _check_neighbours(robot, others, recovery, age_s)
    x_m, y_m = robot.x_m, robot.y_m
    if path.shortest_m(x_m, y_m) == math.inf:
        inset_m = recovery.path_m if recovery.rules.fence else -math.inf
        free = ReturnPath(recovery.terrain, recovery, path.place, recovery.path_m, inset_m)
        gap_m = 2.0 * (recovery.terrain.body_radius_m + recovery.path_m)
        if free.shortest_m(x_m, y_m) < math.inf:
            why = (
                f"that keeps {ceil_m(recovery.apart_m(age_s))} m from the stations of the other robots, each of which "
                "may be occupied; stations that leave a path between them would do"
            )
        else:
            why = (
                f"that keeps {ceil_m(recovery.path_m)} m from boxes and fence; gaps of {ceil_m(gap_m)} m, or a start "
                "and a station on the same side of them, would do"
            )
        raise IllFormedModule(
            BATTERY, "P2b",
            f"there is no path for robot {robot.id} from its start at ({x_m:g}, {y_m:g}) to its charging station at "
            f"({path.place[0]:g}, {path.place[1]:g}) {why}",
        )  # fmt: skip
    _check_refuge(robot, others, refuges, recovery, recovery.apart_m(age_s) if recovery.rules.pairs else 0.0)


def check_start(robot: RobotPlace, recovery: RecoveryPlanner) -> None:
    """Check that a robot starts where legs of safe controllers may begin, whichever modules are on.

    Raises:
        IllFormedModule: names the place, the figures and what would do.
    """
    if near := _too_near(recovery, robot.x_m, robot.y_m):
        raise IllFormedModule(
            near.module, "A13",
            f"robot {robot.id} starts at ({robot.x_m:g}, {robot.y_m:g}), {floor_m(near.found_m)} m from {near.what}, "
            f"and a robot that drives away from there needs {ceil_m(near.needed_m)} m; a start that far away would do",
        )  # fmt: skip


def _too_near(recovery: RecoveryPlanner, x_m: float, y_m: float) -> _TooNear | None:
    """Return what a place is too near to, or None if a path may end there."""
    terrain = recovery.terrain
    # Near a side of a rectangle, driving straight inwards leads away from all of the fence.
    fence_m = recovery.certified_m if terrain.convex else recovery.path_m
    looks = (
        (recovery.rules.fence, _TooNear("geofence", "the fence", terrain.fence_m(x_m, y_m), fence_m)),
        (recovery.rules.boxes, _TooNear("obstacle", "a box", terrain.clearance_m(x_m, y_m), recovery.path_m)),
    )
    return next((near for on, near in looks if on and near.found_m < near.needed_m), None)


def _check_station(robot: RobotPlace, path: ReturnPath, recovery: RecoveryPlanner, noise_m: float) -> None:
    x_m, y_m = path.place
    if near := _too_near(recovery, x_m, y_m):
        raise IllFormedModule(
            BATTERY, "P2b",
            f"the charging station of robot {robot.id} at ({x_m:g}, {y_m:g}) is {floor_m(near.found_m)} m from "
            f"{near.what}, and a robot that drives there needs {ceil_m(near.needed_m)} m; a station that far away "
            "would do",
        )  # fmt: skip
    box = robot.charger
    half_m = min(box.high_x_m - box.low_x_m, box.high_y_m - box.low_y_m) / 2.0
    if half_m < DOCKED_M + noise_m:
        raise IllFormedModule(
            BATTERY, "P2b",
            f"the charging station of robot {robot.id} at ({x_m:g}, {y_m:g}) is {floor_m(2.0 * half_m)} m wide, and a "
            f"robot stops within {DOCKED_M:g} m of where it takes its middle to be, which is wrong by up to "
            f"{noise_m:g} m; {ceil_m(2.0 * (DOCKED_M + noise_m))} m would do",
        )  # fmt: skip


def _check_neighbours(robot: RobotPlace, others: Sequence[RobotPlace], recovery: RecoveryPlanner, age_s: float) -> None:
    if not recovery.rules.pairs:
        return
    needed_m, place = recovery.apart_m(age_s), robot.charger.centre
    for other in others:
        apart_m = math.dist(place, other.charger.centre)
        if apart_m < needed_m:
            raise IllFormedModule(
                BATTERY, "P2b",
                f"the charging stations of robots {robot.id} and {other.id} are {floor_m(apart_m)} m apart, and a "
                f"robot that drives to one needs {ceil_m(needed_m)} m from a robot on the other; stations that far "
                "apart would do",
            )  # fmt: skip


def _check_refuge(
    robot: RobotPlace, others: Sequence[RobotPlace], refuges: RefugeFinder, recovery: RecoveryPlanner, apart_m: float
) -> None:
    """Check that a robot gets from its station to a refuge while robots stand on all other stations."""
    stations = {each.id: each.charger.centre for each in (robot, *others)}
    situation = standing(robot.id, stations)
    if refuges.kept_way(situation, apart_m):
        return
    x_m, y_m = robot.charger.centre
    beside = f", and {ceil_m(apart_m)} m from the stations of the other robots" if others and apart_m else ""
    if held := held_back(refuges, recovery, situation, apart_m):
        raise IllFormedModule(
            BATTERY, "P2b",
            f"from the charging station of robot {robot.id} at ({x_m:g}, {y_m:g}) no place can be reached where "
            f"geofence, obstacle and the mission's own rules give a robot back to its AC{beside}: {held}; rules that "
            "leave more room there, or another station, would do",
        )  # fmt: skip
    raise IllFormedModule(
        BATTERY, "P2b",
        f"from the charging station of robot {robot.id} at ({x_m:g}, {y_m:g}) no place can be reached that is "
        f"{ceil_m(max(refuges.fence_m, 0.0))} m from the fence and {ceil_m(refuges.clearance_m)} m from boxes, where "
        f"geofence and obstacle give a robot back to its AC{beside}; a smaller phi_safer_inset_m or phi_safer_m, or a "
        "station nearer to open ground, would do",
    )  # fmt: skip


def held_back(refuges: RefugeFinder, recovery: RecoveryPlanner, situation: Situation, apart_m: float) -> str:
    """Return, in words, what rule of the user's is on the way to the nearest refuge of the shipped modules.

    Empty if no way leads to one, or no such rule is on it.
    """
    own, legs = situation.own, refuges.way(situation, apart_m)
    line = [(own.x_m, own.y_m), *legs]
    where = next(filter(None, (rule.outside(own.robot_id, line) for rule in recovery.own_rules)), "")
    end = f"({line[-1][0]:.4g}, {line[-1][1]:.4g})"
    return f"the way to the nearest of the first two, {end}, leads through {where}" if legs and where else ""


def standing(robot_id: int, places: Mapping[int, Sequence[float]]) -> Situation:
    """Return the situation of a robot while all robots stand at the given places, fully charged.

    Args:
        robot_id: which robot.
        places: by robot, metres east and north, and the heading in radians or nothing.
    """

    def at(each: int) -> RobotState:
        x_m, y_m, heading_rad = (*places[each], 0.0)[:3]
        return RobotState(each, 0.0, 0.0, x_m, y_m, 0.0, heading_rad, 0.0, 0.0, 0.0, 1.0, None, None, Link.UP)

    situation = Situation(robot_id, at(robot_id), 0.0)
    situation.peers = [at(each) for each in places if each != robot_id]
    return situation
