"""State: frame, units and ranges of samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from soter.conformance.bench import Bench
from soter.conformance.clause import clause
from soter.conformance.driver import TICK_S
from soter.conformance.figure import NotTested
from soter.conformance.judging import STILL_M, STILL_RAD
from soter.conformance.track import CRUISE_S, TrackSample, turn
from soter.errors import Unsupported
from soter.sdk import Controller, Link, Robot

_FRAME_CAUSE = (
    "axes swapped or mirrored (NED for ENU?), another origin or unit, or the place of an antenna or axle and not of "
    "its middle"
)
_HEADING_RAD = 0.15
_STRAIGHT_RAD = 0.02
_CLEAR = 10.0
_COURSE_M = 0.2
"""Over less, rounding decides the course: autopilots report places, true ones too, in whole centimetres."""

_STEADY_S, _STEADY_RAD, _LEG_RAD = 1.5, 0.07, 0.3
_MANY_SAMPLES = 1500
_MANY_S = 12.0
_VELOCITY = 0.05
_TURNED_RAD = 0.01
_ROUND_RAD = 0.6
_STOPS, _STOP_OFF_M = 2, 2e-4
_COSTS = 0.9
_ASIDE, _EVEN, _STEERS_S = 0.12, 0.7, 1.5
_CREEPS, _CREEPS_S = 0.1, 3.0
_SQUARE = ((0.3, 0.0), (0.3, 0.3), (0.0, 0.3), (0.0, 0.0))


def _drive_about(bench: Bench) -> Robot:
    """Drive a triangle, so that headings in every quadrant occur."""
    robot = bench.open_one()
    for ahead, left in ((0.5, 0.0), (0.0, 0.5), (-0.3, -0.3)):
        bench.go(robot, bench.place(robot, ahead, left))
    return robot


def _straight(bench: Bench, samples: list[TrackSample]) -> list[tuple[TrackSample, TrackSample]]:
    """Return neighbouring samples between which the robot drove straight on at some speed."""
    fast, straight_rad = 0.5 * bench.caps.v_max_m_s, _STRAIGHT_RAD + 2.0 * bench.noise_rad
    return [
        (first, second)
        for first, second in pairwise(samples)
        if min(first.speed_m_s, second.speed_m_s) > fast
        and abs(turn(first.heading_rad, second.heading_rad)) < straight_rad
    ]


@clause("state.ranges")
def ranges(bench: Bench) -> None:
    """Every sample is finite, in its ranges, of this robot and with the link UP; none is discarded."""
    robot = _drive_about(bench)
    # Enough samples to show a fault that occurs once in a thousand.
    bench.run(_MANY_SAMPLES * TICK_S if bench.caps.in_process else _MANY_S, closely=True)
    for sample in bench.tracks[robot.id]:
        state = sample.state
        for name, value in state._asdict().items():
            bench.require(
                not isinstance(value, float) or math.isfinite(value), f"{name} is {value}: a sample must be finite"
            )
        bench.require(
            not bench.caps.reports_battery or state.battery is not None,
            "a sample carries no charge, and others do: where one was not measured anew, hand out the last one",
        )
        bench.require(
            not bench.caps.reports_controller or state.controller is not None,
            "a sample does not say who is in charge, and others do: hand out what the robot has said last",
        )
        bench.require(
            -math.pi - 1e-9 < state.heading_rad <= math.pi + 1e-9,
            f"heading_rad is {state.heading_rad:.3f}, allowed: (-pi, pi]: degrees, or not wrapped",
        )
        bench.require(
            state.battery is None or 0.0 <= state.battery <= 1.0,
            f"battery is {state.battery}, allowed: 0 to 1: percent, or volts?",
        )
        bench.require(
            state.robot_id == robot.id,
            f"robot {robot.id} hands out a sample of robot {state.robot_id}: robot_id is the id of its spec, whatever "
            "the vehicle calls itself",
        )
        bench.require(
            state.link is Link.UP, f"the link is {state.link.value} while nothing is wrong: samples come too seldom"
        )
    bench.require(
        robot.discarded == 0,
        f"{robot.discarded} samples were discarded: {robot.discarded_for}",
    )


@clause("state.start", truth=True)
def start(bench: Bench) -> None:
    """The first sample shows the start pose, in the workspace frame."""
    if not bench.harness.starts_robots:
        raise NotTested("not declared: the harness's attribute 'starts_robots': where it stands is its own word")
    robot = bench.open_one()
    sample, spec = bench.look(robot), robot.spec
    off_m = sample.distance_m(spec.x_m, spec.y_m)
    off_rad = abs(turn(spec.heading_rad, sample.heading_rad))
    bench.require(
        off_m <= bench.caps.position_noise_m + 0.02,
        f"the robot stands at ({spec.x_m:.2f}, {spec.y_m:.2f}), its sample says ({sample.x_m:.2f}, {sample.y_m:.2f}): "
        f"{_FRAME_CAUSE}; or position_noise_m is declared too small",
    )
    bench.require(
        off_rad <= 0.1,
        f"the robot looks to {spec.heading_rad:.2f} rad, its sample says {sample.heading_rad:.2f}: headings are "
        "radians, counter-clockwise from east (a compass counts clockwise from north, and in degrees)",
    )


@clause("state.frame", truth=True)
def frame(bench: Bench) -> None:
    """A goto to the east raises x, one to the north raises y."""
    robot = bench.open_one()
    step = 0.3 * bench.harness.room_m / 2.0
    # The robot counts as arrived within the radius, as far as it knows where it is.
    slack = bench.near_m + bench.caps.position_noise_m + 0.01 + bench.still_m
    if step <= slack:
        raise NotTested(f"ways of {step:.2f} m say nothing of a robot that may be {slack:.2f} m off: more room")
    for name, east, north in (("east", 1.0, 0.0), ("north", 0.0, 1.0), ("west", -1.0, 0.0), ("south", 0.0, -1.0)):
        before = bench.look(robot)
        target = bench.place(robot, 0.0)._replace(x_m=before.x_m + east * step, y_m=before.y_m + north * step)
        bench.go(robot, target._replace(radius_m=bench.near_m))
        after = bench.look(robot)
        along = (after.x_m - before.x_m) * east + (after.y_m - before.y_m) * north
        across = (after.y_m - before.y_m) * east - (after.x_m - before.x_m) * north
        bench.require(
            abs(along - step) <= slack and abs(across) <= slack,
            f"{step:.2f} m to the {name} came out as {along:.2f} m along and {across:.2f} m across: {_FRAME_CAUSE}",
        )


@clause("state.heading", truth=True)
def heading(bench: Bench) -> None:
    """While the robot drives straight on, its heading points along its way, or against it."""
    robot = _drive_about(bench)
    legs = _straight(bench, bench.tracks[robot.id])
    bench.require(
        len(legs) >= 3, "the robot never drove straight on at half its top speed: v_max_m_s is declared too high"
    )
    # A course is taken over a way much longer than the error of the places at its ends.
    least_m = max(_COURSE_M, _CLEAR * bench.noise_m)
    may_be_rad = _HEADING_RAD + 2.0 * bench.noise_m / least_m + bench.noise_rad
    ways = [*_far_enough(legs, least_m)]
    bench.require(bool(ways) or least_m > _COURSE_M, f"the robot never drove straight on for {least_m:g} m")
    # A copter that comes out of a corner looks along its leg before it flies along it, and swings with course and yaw.
    for way in [way for way in ways if _steady(bench, way, bench.tracks[robot.id], least_m)] or ways:
        first, last, course = way[0], way[-1], _course(way)
        # Headings at the ends of a bend differ from its chord by half the bend.
        bend_rad = 0.5 * abs(turn(first.heading_rad, last.heading_rad))
        for sample in way:
            off = abs(turn(course, sample.heading_rad))
            if bench.caps.reverses:
                off = min(off, math.pi - off)
            bench.require(
                off <= may_be_rad + bend_rad,
                f"the robot drove towards {course:.2f} rad with a heading of {sample.heading_rad:.2f}: sign of the "
                "yaw, degrees, or a compass heading",
            )


def _far_enough(legs: list[tuple[TrackSample, TrackSample]], least_m: float) -> Iterator[list[TrackSample]]:
    """Yield the samples of each straight way of at least a given length, end to end."""
    for stretch in _stretches(legs):
        way: list[TrackSample] = []
        for here, there in stretch:
            way = [*(way or [here]), there]
            if there.distance_m(way[0].x_m, way[0].y_m) >= least_m:
                yield way
                way = []


def _steady(bench: Bench, way: list[TrackSample], track: list[TrackSample], least_m: float) -> bool:
    """Return whether course and heading are the same just before and after a way, turns of a leg left aside."""
    first, last, fast = way[0], way[-1], 0.5 * bench.caps.v_max_m_s
    course_rad = _STEADY_RAD + 4.0 * bench.noise_m / least_m
    looks_rad = _STEADY_RAD + 2.0 * bench.noise_rad
    for from_s, to_s in ((first.at_s - _STEADY_S, first.at_s), (last.at_s, last.at_s + _STEADY_S)):
        part = [
            each
            for each in track
            if from_s <= each.at_s <= to_s and abs(turn(first.heading_rad, each.heading_rad)) <= _LEG_RAD
        ]
        far = bool(part) and part[0].distance_m(part[-1].x_m, part[-1].y_m) >= least_m
        if far and abs(turn(_course(way), _course(part))) > course_rad:
            return False
        if any(each.speed_m_s > fast and abs(turn(first.heading_rad, each.heading_rad)) > looks_rad for each in part):
            return False
    return True


def _course(way: list[TrackSample]) -> float:
    return math.atan2(way[-1].y_m - way[0].y_m, way[-1].x_m - way[0].x_m)


@clause("state.velocity")
def velocity(bench: Bench) -> None:
    """The velocity of a sample is how its position changes."""
    robot = _drive_about(bench)
    moves_as_said(bench, bench.tracks[robot.id])
    _brakes_as_said(bench, robot)
    _creeps_as_said(bench, robot)


def _brakes_as_said(bench: Bench, robot: Robot) -> None:
    """Judge whether velocities match the change of place while a robot comes to rest."""
    caps, lags_s, ran_m, said_m, off_m, kinks_s = bench.caps, [], 0.0, 0.0, 0.0, 0.0
    bench.settle()
    for number in range(_STOPS):
        goal = bench.get_going(robot, bench.place(robot, 0.8 if number % 2 else -0.8), closely=True)
        bench.run(CRUISE_S, closely=True)
        at = bench.look(robot)
        goal.cancel()
        bench.run(bench.orphaned_s(), closely=True)
        seen = bench.since(robot, at.at_s)
        said_m = sum((a.speed_m_s + b.speed_m_s) / 2.0 * (b.at_s - a.at_s) for a, b in pairwise(seen))
        ran_m = seen[-1].distance_m(at.x_m, at.y_m)
        lags_s.append(abs(ran_m - said_m) / max(at.speed_m_s, 1e-3))
        off_m = _STOP_OFF_M + bench.noise_m + (caps.speed_noise_m_s or 0.0) * (seen[-1].at_s - at.at_s)
        kinks_s = max(abs(b.speed_m_s - a.speed_m_s) * (b.at_s - a.at_s) for a, b in pairwise(seen)) / caps.v_max_m_s
    # In process, samples are taken at the moments of control: they are exact but at the start and end of a ramp.
    exact = caps.in_process and caps.speed_noise_m_s is not None
    bench.measure(
        "velocity_lag_s", min(lags_s), kinks_s / 4.0 if exact else caps.setpoint_period_s,
        bench.read_s + off_m / caps.v_max_m_s,
        f"told to stop it runs on by {ran_m:.3f} m, and velocities say {said_m:.3f} m: they are what it was told, "
        "filtered, or those of an earlier sample",
    )  # fmt: skip


def _creeps_as_said(bench: Bench, robot: Robot) -> None:
    """Judge whether velocities match the change of place while a robot is slow."""
    caps = bench.caps
    goal = robot.goto(bench.place(robot, -0.8, speed_m_s=_CREEPS * caps.v_max_m_s), Controller.AC)
    bench.settle()
    began_s = bench.now_s
    bench.run(_CREEPS_S)
    goal.cancel()
    seen = bench.since(robot, began_s)
    moved_m = seen[-1].x_m - seen[0].x_m, seen[-1].y_m - seen[0].y_m
    said_m = [
        sum((getattr(a.state, name) + getattr(b.state, name)) / 2.0 * (b.at_s - a.at_s) for a, b in pairwise(seen))
        for name in ("vx_m_s", "vy_m_s")
    ]
    lasts_s = seen[-1].at_s - seen[0].at_s
    bench.measure(
        "creeping_m_s", math.dist(moved_m, said_m) / lasts_s,
        _VELOCITY * caps.v_max_m_s if caps.speed_noise_m_s is None else caps.speed_noise_m_s,
        (bench.off_m + _CREEPS * caps.v_max_m_s * TICK_S) / lasts_s,
        f"at {_CREEPS:g} of its top speed it moves by {math.hypot(*moved_m):.3f} m, and velocities say "
        f"{math.hypot(*said_m):.3f} m: a small speed is said to be none, so that who creeps seems to stand",
    )  # fmt: skip


def moves_as_said(bench: Bench, track: list[TrackSample]) -> None:
    """Judge whether velocities match the change of place wherever a robot drove straight on."""
    legs = _straight(bench, track)
    bench.require(len(legs) >= 3, "samples never showed half of v_max_m_s: velocity is missing, or in another unit")
    # Over whole stretches, to average the noise of samples; each by itself, so that one does not hide another.
    off = way = 0.0
    slack_m = STILL_M
    for stretch in _stretches(legs):
        moved_x, moved_y = stretch[-1][1].x_m - stretch[0][0].x_m, stretch[-1][1].y_m - stretch[0][0].y_m
        said_x = sum((f.state.vx_m_s + s.state.vx_m_s) / 2 * (s.at_s - f.at_s) for f, s in stretch)
        said_y = sum((f.state.vy_m_s + s.state.vy_m_s) / 2 * (s.at_s - f.at_s) for f, s in stretch)
        off += math.hypot(moved_x - said_x, moved_y - said_y)
        way += math.hypot(moved_x, moved_y)
        lasts_s = stretch[-1][1].at_s - stretch[0][0].at_s
        slack_m += 2.0 * bench.noise_m + (bench.caps.speed_noise_m_s or 0.0) * lasts_s
    bench.measure(
        "velocity_error", off / max(way, 1e-9), _VELOCITY, slack_m / max(way, 1e-9),
        f"over {way:.2f} m positions and velocities tell ways {off:.2f} m apart: velocity in the body frame, in "
        "another unit, too low, or without its sign when it drives backwards",
    )  # fmt: skip


def _stretches(legs: list[tuple[TrackSample, TrackSample]]) -> list[list[tuple[TrackSample, TrackSample]]]:
    """Return the pairs of neighbours, grouped into uninterrupted stretches."""
    found: list[list[tuple[TrackSample, TrackSample]]] = []
    for pair in legs:
        if found and found[-1][-1][1] is pair[0]:
            found[-1].append(pair)
        else:
            found.append([pair])
    return found


@clause("state.backwards", truth=True, needs=("reverses",))
def backwards(bench: Bench) -> None:
    """A robot that can reverse does so where that arrives with the heading, and its samples say so, steering too."""
    robot = bench.open_one()
    began = bench.look(robot)
    try:
        goal = robot.goto(bench.place(robot, -0.7)._replace(heading_rad=bench.home(robot)[2]), Controller.AC)
    except Unsupported:
        raise NotTested("not declared: targets with a heading, by which a robot is told to reverse") from None
    bench.arrive(goal, "a target straight behind, with the present heading, is not reached")
    turned = max(abs(turn(began.heading_rad, each.heading_rad)) for each in bench.tracks[robot.id])
    bench.require(
        turned <= _HEADING_RAD + 2.0 * bench.noise_rad,
        f"on its way straight back its heading turned by {turned:.2f} rad: it cannot reverse (declare reverses=False), "
        "or what it says is its course",
    )
    for each in bench.tracks[robot.id]:
        if bench.truth:
            continue
        ahead = each.state.vx_m_s * math.cos(each.heading_rad) + each.state.vy_m_s * math.sin(each.heading_rad)
        bench.require(
            ahead <= bench.speed_noise_m_s + 0.02,
            f"while it drives backwards its sample says {ahead:.2f} m/s forwards: the speed has lost its sign",
        )
    if not bench.truth:
        moves_as_said(bench, bench.tracks[robot.id])
        _costs_what_forwards_costs(bench, robot, began)
    _steers_backwards_as_said(bench, robot)


def _costs_what_forwards_costs(bench: Bench, robot: Robot, began: TrackSample) -> None:
    """Judge what driving backwards costs of the charge of robots in process, whose batteries are as they were asked."""
    half_m = 0.5 * began.distance_m(*bench.true_place(robot))
    # Its start may be a charger.
    driven = [
        each
        for each in bench.tracks[robot.id]
        if began.distance_m(each.x_m, each.y_m) > half_m and each.speed_m_s > _EVEN * bench.caps.v_max_m_s
    ]
    if not bench.caps.in_process or not driven:
        return
    before, after = driven[0].state.battery, driven[-1].state.battery
    if before is None or after is None:
        return
    way_m = max(driven[0].distance_m(driven[-1].x_m, driven[-1].y_m) - 2.0 * bench.noise_m, 0.0)
    forwards = way_m / (bench.caps.v_max_m_s * robot.spec.drive_s)
    bench.require(
        before - after >= _COSTS * forwards,
        f"a part of its way back has cost {before - after:.5f} of its charge, and forwards it costs {forwards:.5f}: a "
        "speed that is negative counts for none, or charges it",
    )


def _steers_backwards_as_said(bench: Bench, robot: Robot) -> None:
    """Judge whether yaw rates match the change of heading of a robot that steers while it reverses."""
    heading_rad = bench.home(robot)[2]
    for name, left in (("right", _ASIDE), ("left", -_ASIDE)):
        bench.go(robot, bench.place(robot, 0.7))
        bench.settle()
        bench.get_going(robot, bench.place(robot, -0.8)._replace(heading_rad=heading_rad))
        bench.run(CRUISE_S)
        began_s = bench.now_s
        goal = robot.goto(bench.place(robot, -0.8, left)._replace(heading_rad=heading_rad), Controller.AC)
        # A robot that comes to rest before it turns does not steer.
        bench.run(_STEERS_S, lambda: bench.tracks[robot.id][-1].speed_m_s < _EVEN * bench.caps.v_max_m_s)
        goal.cancel()
        bench.settle()
        seen = [each for each in bench.since(robot, began_s) if each.speed_m_s > _EVEN * bench.caps.v_max_m_s]
        turned = sum(turn(a.heading_rad, b.heading_rad) for a, b in pairwise(seen))
        said = sum(
            (a.state.yaw_rate_rad_s + b.state.yaw_rate_rad_s) / 2.0 * (b.at_s - a.at_s) for a, b in pairwise(seen)
        )
        bench.require(
            abs(turned - said) <= 0.1 * abs(turned) + 2.0 * STILL_RAD + 2.0 * bench.noise_rad,
            f"as it drove backwards, and steered to its {name}, its heading turned by {turned:.2f} rad, and yaw rates "
            f"add up to {said:.2f} rad: the sign of a rate that is made of a curve and a speed, which is negative here",
        )


@clause("state.yaw_rate", truth=True)
def yaw_rate(bench: Bench) -> None:
    """The yaw rate of a sample is how its heading changes, to the left, to the right and through pi."""
    robot = bench.open_one()
    for ahead, left in (*_SQUARE, *_SQUARE[::-1]):
        bench.go(robot, bench.place(robot, ahead, left))
    for name, sign in (("left", 1.0), ("right", -1.0)):
        turned = said = 0.0
        for first, second in pairwise(bench.tracks[robot.id]):
            by = turn(first.heading_rad, second.heading_rad)
            rates = first.state.yaw_rate_rad_s, second.state.yaw_rate_rad_s
            if by * sign > _TURNED_RAD + 2.0 * bench.noise_rad:
                turned += by
                said += sum(rates) / 2.0 * (second.at_s - first.at_s)
        off = abs(turned - said)
        once_round = abs(off - 2.0 * math.pi) <= _ROUND_RAD
        bench.require(
            off <= 0.1 * abs(turned) + 2.0 * STILL_RAD + 4.0 * len(_SQUARE) * bench.noise_rad,
            f"to the {name} headings turned by {turned:.2f} rad in all, yaw rates add up to {said:.2f} rad: "
            f"{'a difference of headings that leaps at pi, or ' * once_round}sign, degrees, too low, cut off where it "
            "turns fast, or headings that jump at pi",
        )
