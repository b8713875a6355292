"""Legs: how close a robot keeps to the straight segment to its target, from its first turn until it rests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.harness import BESIDE_LEG_M
from soter.conformance.track import TrackSample, fit_stop, turn
from soter.errors import Unsupported
from soter.sdk import Controller, GoalStatus, Robot, Waypoint

_CORNERS, _CORNERS_IN_PROCESS = 5, 11
_CORNERS_AT = 0.8
_WIDE = 0.3
_THROUGH = ((0.85, 0.1), (-0.85, -0.1))
_ASIDE_RAD = 0.7
_ASIDE_M = 0.6
_OFF_RAD = 0.15
_ACROSS_RAD = 0.6
_ACROSS_AT = 0.5
_STEERS_RAD = 0.3
_BACK = 0.4
_FAR_FROM = 0.8
_FAR_TO = 4.0
_LONG_LEGS, _FEW_LONG_LEGS = 4, 2
_WEST_RAD = (0.09, -0.05)
_PASSES_M = 0.05
_ON_THE_WAY_TO, _ON_THE_WAY_AT = 1.0, 0.8
_CUT_AT = 0.3
_CENTIMETRE_M = 0.01
_NEXT_M = 0.0099
"""How far a place moves to the south-west if its coordinates are cut off to whole centimetres."""

_CUT_OFF = "they are cut off, or rounded up, such as to centimetres"
_BACK_AT = ((0.5, 0.1), (-0.5, 0.3))


def _legs(
    bench: Bench, more: Sequence[tuple[float, float]] = ()
) -> list[tuple[TrackSample, Waypoint, list[TrackSample]]]:
    """Drive legs from rest to rest; return for each its start, its target and its samples.

    The legs form a star across the room, with all directions alike, and `more` ones.
    """
    robot = bench.open_one()
    legs = []
    corners = _CORNERS_IN_PROCESS if bench.caps.in_process and bench.truth and not more else _CORNERS
    angles = [2.0 * math.pi * (corners // 2) * number / corners for number in range(corners + 1)]
    star = [(_CORNERS_AT * math.cos(angle), _CORNERS_AT * math.sin(angle)) for angle in angles]
    for ahead, left in (*more, *star)[: bench.trials(len(more) + len(star))]:
        began, began_s = bench.look(robot), bench.now_s
        target = bench.place(robot, ahead, left, radius_m=bench.near_m)
        bench.go(robot, target)
        bench.run(1.0)
        legs.append((began, target, bench.since(robot, began_s)))
    if bench.caps.reverses:
        began, began_s = bench.look(robot), bench.now_s
        back_m = _BACK * bench.harness.room_m / 2.0
        target = Waypoint(
            began.x_m - back_m * math.cos(began.heading_rad), began.y_m - back_m * math.sin(began.heading_rad),
            heading_rad=began.heading_rad, radius_m=0.05,
        )  # fmt: skip
        with suppress(Unsupported):
            bench.go(robot, target)
            bench.run(1.0)
            legs.append((began, target, bench.since(robot, began_s)))
    return legs


def along_and_across(began: TrackSample, target: Waypoint, seen: list[TrackSample]) -> list[tuple[float, float]]:
    """Return how far a robot got beyond its target, and how far beside the straight segment to it."""
    dx, dy = target.x_m - began.x_m, target.y_m - began.y_m
    length = math.hypot(dx, dy)
    off = [(each.x_m - began.x_m, each.y_m - began.y_m) for each in seen]
    return [((x_m * dx + y_m * dy) / length - length, (y_m * dx - x_m * dy) / length) for x_m, y_m in off]


@clause("bounds.tube", truth=True)
def tube(bench: Bench) -> None:
    """The robot stays within tube_m of the straight segment to its target."""
    widest = max((0.0, *(abs(across) for leg in _legs(bench) for _, across in along_and_across(*leg))))
    bench.measure(
        "tube_m", widest, bench.caps.tube_m, bench.off_m,
        "the vehicle drives a curve (it turns while it drives, or is pulled off), is sent beside its target, such as "
        "to a rounded one, or tube_m is declared too small",
    )  # fmt: skip


@clause("bounds.long_tube", truth=True)
def long_tube(bench: Bench) -> None:
    """The robot stays within tube_m of the straight segment also where its target is several metres away."""
    robot = bench.open_one()
    widest, ends = 0.0, []
    for ahead in (-1.0, 1.0)[: bench.trials(2)]:
        bench.go(robot, bench.place(robot, -_FAR_FROM * ahead))
        bench.settle()
        began, began_s = bench.look(robot), bench.now_s
        # Through the whole room, towards a target far beyond it.
        target = bench.place(robot, _FAR_TO * ahead)
        goal = robot.goto(target, Controller.AC)
        most_m = 2.0 * _FAR_FROM * bench.harness.room_m / 2.0

        def through(began: TrackSample = began, began_s: float = began_s, most_m: float = most_m) -> bool:
            gone_m = bench.tracks[robot.id][-1].distance_m(began.x_m, began.y_m)
            return gone_m > most_m or bench.stands(robot, began_s)

        bench.run(bench.way_s(), through, closely=True)
        called_s = bench.now_s
        goal.cancel()
        bench.require(
            bench.tracks[robot.id][-1].distance_m(began.x_m, began.y_m) > most_m,
            f"towards a target {_FAR_TO * bench.harness.room_m / 2.0:.0f} m away it stopped short",
        )
        beside = along_and_across(began, target, bench.since(robot, began_s))
        widest = max((widest, *(abs(across) for _, across in beside)))
        bench.settle(closely=True)
        ends.append(fit_stop(bench.tracks[robot.id], called_s))
    bench.measure(
        "long_stop_s", min((end.begins_s for end in ends if end), default=0.0), bench.caps.latency_s, bench.fit_s,
        "after a way of seconds a stop is later than after a short one: something adds up while it drives",
    )  # fmt: skip
    bench.measure(
        "long_tube_m", widest, bench.caps.tube_m, bench.off_m,
        "on its way to a target far away the vehicle drives beside the straight segment: it steers by less the farther "
        "that is, or plans another way",
    )  # fmt: skip


@clause("truth.bounds.leg", tier=Tier.TRUTH)
def leg(bench: Bench) -> None:
    """The robot stays within tube_m also on a leg many times as long as a room, past a box, and comes to its end."""
    if not bench.harness.leg_m:
        raise NotTested("not declared: the harness's attribute 'leg_m', free ground for a long leg")
    if bench.harness.gives("charged"):
        # The charge that simulated robots start with does not last that long.
        bench.opener = partial(bench.harness.charged, 1.0)
    robot, way_m, widest = bench.open_one(), bench.harness.leg_m, []
    passes_rad = (BESIDE_LEG_M - _PASSES_M - bench.caps.body_radius_m) / way_m
    for number in range(_LONG_LEGS if bench.caps.in_process else _FEW_LONG_LEGS):
        began, began_s = bench.look(robot), bench.now_s
        # There and back, to a new place each time: any one place may by chance be where the vehicle would drive anyway.
        if number % 2:
            target = bench.place(robot, *_BACK_AT[number // 2], radius_m=bench.near_m)
        else:
            bearing_rad = math.pi + min(_WEST_RAD[number // 2], passes_rad)
            target = Waypoint(
                began.x_m + way_m * math.cos(bearing_rad), began.y_m + way_m * math.sin(bearing_rad),
                radius_m=bench.near_m,
            )  # fmt: skip
        lasts_s = bench.way_s() + 2.0 * way_m / bench.caps.v_max_m_s
        goal = robot.goto(target._replace(timeout_s=lasts_s), Controller.AC)
        bench.run(lasts_s, lambda goal=goal, since_s=began_s: not goal.active or bench.stands(robot, since_s))  # type: ignore[misc]
        bench.require_status(
            goal, GoalStatus.REACHED,
            f"a leg of {way_m:g} m is not driven to its end, but to {bench.look(robot).distance_m(*target[:2]):.2f} m "
            "from it; or it keeps away by itself from what stands beside its way",
        )  # fmt: skip
        beside = along_and_across(began, target, bench.since(robot, began_s))
        widest.append(max(abs(across) for _, across in beside))
        bench.settle()
    bench.measure(
        "leg_tube_m", max(widest), bench.caps.tube_m, bench.off_m, spread=widest,
        cause=f"on a leg of {way_m:g} m the vehicle leaves the straight segment: it drives by places between, such as "
        "rounded ones or those of a map, steers by less the farther its target is, or keeps away by itself from what "
        "stands beside its way",
    )  # fmt: skip


@clause("bounds.overshoot", truth=True)
def overshoot(bench: Bench) -> None:
    """The robot runs no more than overshoot_m beyond its target."""
    legs = _legs(bench, _THROUGH)
    robot = bench.fleet.robots[-1]
    began, began_s = bench.look(robot), bench.now_s
    # A wide radius ends a goal early, but the robot still has to stop at the target.
    wide = bench.place(robot, 0.0, radius_m=_WIDE * bench.harness.room_m / 2.0)
    bench.go(robot, wide)
    bench.settle()
    legs.append((began, wide, bench.since(robot, began_s)))
    late = (
        "it brakes too late for its target, is sent to a place beyond it, such as a rounded one, or overshoot_m is "
        "declared too small"
    )
    # A place that is made of where the robot is, and that is old by then, is beyond a target by the way driven since.
    made = "on its way it is sent beyond a goal's target: that is told as a way from its place, by an older sample"
    on_its_way = _replaced(bench, robot)
    if not bench.caps.in_process and _furthest([on_its_way]) > bench.caps.overshoot_m + bench.off_m:
        # The host may have been late for once; a place that is wrong is so each time.
        bench.go(robot, bench.place(robot, 0.0))
        bench.settle()
        on_its_way = min(on_its_way, _replaced(bench, robot), key=lambda leg: _furthest([leg]))
    for seen, cause in (
        (legs, late),
        ([on_its_way], f"{made}; or {late}"),
        (_cut_off(bench, robot), f"where the places of a target have many digits {_CUT_OFF}; or {late}"),
    ):
        bench.measure("overshoot_m", _furthest(seen), bench.caps.overshoot_m, bench.off_m, cause)


def _furthest(legs: Sequence[tuple[TrackSample, Waypoint, list[TrackSample]]]) -> float:
    """Return how far beyond a target a robot got at most."""
    return max((0.0, *(beyond for leg in legs for beyond, _ in along_and_across(*leg))))


def _replaced(bench: Bench, robot: Robot) -> tuple[TrackSample, Waypoint, list[TrackSample]]:
    """Drive to a target straight ahead that replaces another one on the way; return the leg from there on."""
    bench.get_going(robot, bench.place(robot, _ON_THE_WAY_TO))
    bench.keep_on()
    began, began_s = bench.look(robot), bench.now_s
    target = bench.place(robot, _ON_THE_WAY_AT, radius_m=bench.near_m)
    bench.go(robot, target)
    bench.settle()
    return began, target, bench.since(robot, began_s)


def _cut_off(bench: Bench, robot: Robot) -> list[tuple[TrackSample, Waypoint, list[TrackSample]]]:
    """Drive legs across both axes to targets that are farther away if they are cut off or rounded up."""
    at_m = _CUT_AT * bench.harness.room_m / 2.0
    x_m, y_m, _ = bench.home(robot)
    bench.go(robot, Waypoint(x_m + at_m, y_m + at_m, radius_m=bench.near_m))
    legs = []
    for side, digits in ((-1.0, _NEXT_M), (1.0, _CENTIMETRE_M - _NEXT_M))[: bench.trials(2)]:
        bench.settle()
        began, began_s = bench.look(robot), bench.now_s
        x_to_m, y_to_m = (_CENTIMETRE_M * math.floor((to + side * at_m) / _CENTIMETRE_M) + digits for to in (x_m, y_m))
        target = Waypoint(x_to_m, y_to_m, radius_m=bench.near_m)
        bench.go(robot, target)
        bench.run(1.0)
        legs.append((began, target, bench.since(robot, began_s)))
    return legs


@clause("bounds.pivot", truth=True, needs=("pivots_first",))
def pivot(bench: Bench) -> None:
    """Where declared, the robot turns in place before it drives."""
    robot = bench.open_one()
    for ahead, left in ((-0.4, 0.5), (0.3, -0.4))[: bench.trials(2)]:
        began, began_s = bench.look(robot), bench.now_s
        target = bench.place(robot, ahead, left)
        bench.go(robot, target)
        course = math.atan2(target.y_m - began.y_m, target.x_m - began.x_m)
        strayed = 0.0
        for sample in bench.since(robot, began_s):
            off = abs(turn(course, sample.heading_rad))
            if bench.caps.reverses:
                off = min(off, math.pi - off)
            if off > 0.3:
                strayed = max(strayed, sample.distance_m(began.x_m, began.y_m))
        bench.measure(
            "pivot_m", strayed, bench.caps.tube_m, bench.off_m,
            "it drives off before it has turned, or turns about another point than its place; declare "
            "pivots_first=False",
        )  # fmt: skip
        bench.settle()
    _no_curve(bench, robot)
    for across_rad in (math.pi, 0.0)[: bench.trials(2)]:
        _the_short_way(bench, robot, across_rad)


def _the_short_way(bench: Bench, robot: Robot, across_rad: float) -> None:
    """Judge whether a robot turns across a direction, such as that at which headings wrap, by the short way."""
    bench.go(robot, bench.place(robot, 0.0))
    for aside_rad in (-_ACROSS_RAD, _ACROSS_RAD):
        bench.settle()
        began, began_s = bench.look(robot), bench.now_s
        bearing_rad, way_m = across_rad + aside_rad, _ACROSS_AT * bench.harness.room_m / 2.0
        x_m, y_m = began.x_m + way_m * math.cos(bearing_rad), began.y_m + way_m * math.sin(bearing_rad)
        bench.go(robot, Waypoint(x_m, y_m, radius_m=bench.near_m))
        seen = [began, *bench.since(robot, began_s)]
        turned_rad = sum(abs(turn(a.heading_rad, b.heading_rad)) for a, b in pairwise(seen))
        short_rad = abs(turn(began.heading_rad, bearing_rad))
        if bench.caps.reverses:
            short_rad = max(short_rad, math.pi - short_rad)
        bench.measure(
            "turned_rad", turned_rad, short_rad + _STEERS_RAD + 2.0 * bench.noise_rad * len(seen), _OFF_RAD,
            f"for a turn of {short_rad:.2f} rad, across {across_rad:.2f}, it turns the long way round: the difference "
            "of two headings is to be wrapped",
        )  # fmt: skip


def _no_curve(bench: Bench, robot: Robot) -> None:
    """Judge whether a driving robot comes to rest and turns in place for a new target a little to the side."""
    caps = bench.caps
    bench.go(robot, bench.place(robot, -0.7))
    bench.get_going(robot, bench.place(robot, 0.9), closely=True)
    at, called_s = bench.look(robot), bench.now_s
    bearing_rad = at.heading_rad + _ASIDE_RAD
    target = Waypoint(at.x_m + _ASIDE_M * math.cos(bearing_rad), at.y_m + _ASIDE_M * math.sin(bearing_rad))
    bench.go(robot, target)
    rests_s = called_s + caps.latency_s + caps.jitter_s + 2 * TICK_S + bench.brakes_s
    turning = [
        each
        for each in bench.since(robot, rests_s)
        if abs(turn(math.atan2(target.y_m - each.y_m, target.x_m - each.x_m), each.heading_rad)) > _OFF_RAD
        and each.distance_m(target.x_m, target.y_m) > 2.0 * target.radius_m
    ]
    curved_m = max((each.distance_m(turning[0].x_m, turning[0].y_m) for each in turning), default=0.0)
    bench.measure(
        "curve_m", curved_m, caps.tube_m, bench.off_m,
        "a goal that replaces another on the way is driven to in a curve, without a stop and a turn; declare "
        "pivots_first=False",
    )  # fmt: skip
