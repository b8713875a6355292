"""The bench on which one clause is tried: opens a fresh fleet, drives it as a supervisor does, and records it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from soter.conformance.driver import ROUNDING, TICK_S, drive_until
from soter.conformance.figure import NotTested
from soter.conformance.judging import Judging
from soter.conformance.track import CRUISE_S, TURNING_RAD_S, TrackSample, rates, turn
from soter.sdk import Controller, Fleet, Goal, GoalStatus, Robot, Waypoint

SETTLE_S: Final = 2.0
"""At least so long robots are given to come to rest; see `Bench.settle_s`."""

_SETTLES_S: Final = 0.5
_TIMES: Final = ("latency_s", "sample_age_s", "jitter_s", "setpoint_period_s", "lease_s")
_LONGEST_S: Final = 30.0
_LOOKS: Final = 5
_PATIENCE_S: Final = 3.0
_ASTRAY_RAD: Final = 0.3
_CREEPS: Final = 0.1
_BACK: Final = 0.05
_MISREAD: Final = 2.0
_MISREAD_M_S: Final = 0.1
_MISREAD_M: Final = 0.1
_TOWARDS_S: Final = 2.0 * TICK_S

_TIMEOUT_S: Final = Waypoint(0.0, 0.0).timeout_s
"""Slow robots need longer in a large room."""

_NOT_THROUGH: Final = "the target did not get through, or is in another frame"
_SLOW: Final = (
    "the target did not get through, the lease is not renewed by renew_lease(), the cap of an earlier goal is kept, or "
    "v_max_m_s is declared too high"
)


class Bench(Judging):
    """The tools of a clause: opens robots, drives them, and checks that they arrive and stop."""

    def open_raw(self, robots: int = 1) -> Fleet:
        """Open a fresh fleet whose robots are not initialised."""
        if robots > self.harness.robots_most:
            raise NotTested(f"it needs {robots} robots, and the harness has {self.harness.robots_most}")
        fleet = self.harness.open(robots) if self.opener is None else self.opener()
        self.fleets.append(fleet)
        self.require(
            len(fleet.robots) == robots,
            f"{robots} robots were asked for, and {len(fleet.robots)} opened: the adapter opens those whose addresses "
            "it knows, or the harness's open() is to be corrected",
        )
        if self.truth and fleet.truth is None and not self.harness.gives("observe"):
            raise NotTested("no truth: neither Fleet.truth nor the hook 'observe' is given")
        self.tracks = {robot.id: [] for robot in fleet.robots}
        self._stamps.clear()
        self.always.begin()
        return fleet

    def open(self, robots: int = 1, in_charge: Controller = Controller.AC) -> tuple[Robot, ...]:
        """Open a fresh fleet, initialise its robots, and make a controller active on each."""
        fleet = self.open_raw(robots)
        for robot in fleet.robots:
            robot.init(self.harness.connect_timeout_s)
        self.capabilities = fleet.robots[-1].capabilities
        for name in _TIMES:
            seconds = getattr(self.capabilities, name)
            self.require(
                0.0 <= seconds <= _LONGEST_S, f"{name} is {seconds} s, the kit can measure 0 to {_LONGEST_S:g} s"
            )
        for name in self.needs:
            promise = getattr(self.capabilities, name)
            if promise is None or promise is False:
                raise NotTested(f"not declared: {name}")
        self.run(2 * TICK_S)
        if not self.harness.starts_robots:
            for robot in fleet.robots:
                self._bring_back(robot)
        for robot in fleet.robots:
            robot.switch_ac_sc(in_charge, "conformance")
        self.run(self.caps.latency_s + 2 * TICK_S)
        return fleet.robots

    def _bring_back(self, robot: Robot) -> None:
        """Drive a robot that the kit did not start to its start, and align the room with its heading there."""
        spec, at, room_m = robot.spec, self.look(robot), self.harness.room_m
        off_m = at.distance_m(spec.x_m, spec.y_m)
        self.require(
            off_m <= 0.5 * room_m,
            f"the robot stands {off_m:.1f} m from its start, ({spec.x_m:g}, {spec.y_m:g}), outside of its room of "
            f"{room_m:g} m: put it there, or correct its start or the origin",
        )
        if off_m > self.back_m:
            start = Waypoint(spec.x_m, spec.y_m, radius_m=2.0 * self.near_m)
            self.go(robot, start, Controller.SC, cause="it does not drive back to its start")
            self.settle()
        self._turned[robot.id] = self.look(robot).heading_rad
        del self.tracks[robot.id][:-1]

    @property
    def back_m(self) -> float:
        """How far from its start a robot that the kit did not start may stand before a clause; it is driven so near."""
        return 0.0 if self.harness.starts_robots else max(_BACK * self.harness.room_m, 2.0 * self.near_m)

    def home(self, robot: Robot) -> tuple[float, float, float]:
        """Return where a robot was when the clause began: x_m, y_m, heading_rad; the middle of its room."""
        spec = robot.spec
        return spec.x_m, spec.y_m, self._turned.get(robot.id, spec.heading_rad)

    def open_one(self, in_charge: Controller = Controller.AC) -> Robot:
        """Open a fresh fleet of one ready robot, or of `judged` robots of which the last is returned."""
        return self.open(self.judged, in_charge)[-1]

    def open_most(self) -> tuple[Robot, ...]:
        """Open a fresh fleet of as many robots as the harness has, ready, with the AC active on each."""
        return self.open(max(self.harness.robots_most, 2))

    def close(self) -> None:
        """Close the fleet opened last, for the next one in the same clause."""
        self.fleet.close()
        self.harness.close()

    def run(
        self,
        seconds: float,
        until: Callable[[], bool] | None = None,
        *,
        renew: bool = True,
        read: bool = True,
        closely: bool = False,
    ) -> bool:
        """Tick for some seconds, or until a condition holds, and record the samples. Return whether it held.

        With `closely`, look several times a tick if the world moves between ticks.
        """

        def look() -> bool:
            if read:
                for robot in self.fleet.robots:
                    self.look(robot)
            return until is not None and until()

        looks = _LOOKS if closely and not self.caps.in_process else 1
        return drive_until(self.fleet, look, seconds, renew=renew, read=read, looks=looks)

    def settle_s(self, speed_m_s: float | None = None) -> float:
        """Return how long after a goal is REACHED, at the edge of its radius, a robot may drive on to its target.

        Args:
            speed_m_s: the goal's cap on the speed, or None.
        """
        caps = self.caps
        drives_s = 2.0 * self.near_m / (speed_m_s or self._slow_m_s)
        return max(SETTLE_S, _SETTLES_S + drives_s + caps.latency_s + self.brakes_s)

    def settle(self, speed_m_s: float | None = None, *, renew: bool = True, closely: bool = False) -> None:
        """Let robots that have arrived come to rest; see `settle_s` and `run`."""
        self.run(self.settle_s(speed_m_s), renew=renew, closely=closely)

    def look(self, robot: Robot) -> TrackSample:
        """Return where a robot is now, and record it."""
        state = robot.read_state()
        track = self.tracks[robot.id]
        last_s = self._stamps.get(robot.id, state.stamp_s)
        # The message is only made if needed: this runs thousands of times.
        if not state.stamp_s >= last_s:
            self.fail(
                f"the stamp of the sample went back from {last_s:.3f} to {state.stamp_s:.3f} s: samples that arrive "
                "after newer ones must be dropped"
            )
        self._stamps[robot.id] = state.stamp_s
        self.always.note(self, robot, state)
        if self.truth:
            at_s, (x_m, y_m, heading_rad) = self.timed_pose(robot.id)
            speed, rate = 0.0, 0.0
            if track and at_s - track[-1].at_s > ROUNDING:
                speed, rate = rates(track[-1], at_s, x_m, y_m, heading_rad)
            sample = TrackSample(at_s, x_m, y_m, heading_rad, speed, rate, state)
        else:
            sample = TrackSample(
                state.stamp_s, state.x_m, state.y_m, state.heading_rad,
                math.hypot(state.vx_m_s, state.vy_m_s), state.yaw_rate_rad_s, state,
            )  # fmt: skip
            self._require_possible([each for each in track[-1:] if sample.at_s > each.at_s + ROUNDING], sample)
        if not track or sample.at_s > track[-1].at_s + ROUNDING:
            track.append(sample)
        if robot.id in self._turned:
            off_m = sample.distance_m(robot.spec.x_m, robot.spec.y_m)
            # A failed clause closes its fleet, which stops the robot.
            self.require(
                off_m <= 0.5 * self.harness.room_m,
                f"it was stopped {off_m:.1f} m from its start, on its way out of its room",
            )
        return sample

    def _require_possible(self, before: list[TrackSample], sample: TrackSample) -> None:
        """Fail the clause if a sample shows a speed or a leap far beyond what the robot can do."""
        caps = self.caps
        if self.faulty or not self.harness.judges:
            return
        most_m_s = _MISREAD * (caps.v_max_m_s + self.speed_noise_m_s) + _MISREAD_M_S
        if not sample.speed_m_s <= most_m_s:
            self.fail(
                f"a sample says {sample.speed_m_s:.2f} m/s of a robot whose v_max_m_s is {caps.v_max_m_s:.2f}: another "
                "unit, or a number that is misread now and then, such as a small one with an exponent"
            )
        for last in before:
            leap_m = sample.distance_m(last.x_m, last.y_m)
            most_m = most_m_s * (sample.at_s - last.at_s + caps.jitter_s) + 4.0 * caps.position_noise_m + _MISREAD_M
            if not leap_m <= most_m:
                charges = (sample.state.battery or 0.0) > (last.state.battery or 1.0)
                self.fail(
                    f"from one sample to the next it leapt by {leap_m:.2f} m in {sample.at_s - last.at_s:.2f} s: "
                    f"{'as its charge rises its place is set anew, to the charger; or ' * charges}"
                    "samples of another robot, or a number that is misread now and then"
                )

    def place(self, robot: Robot, ahead: float, left: float = 0.0, **options: float) -> Waypoint:
        """Return a waypoint in a robot's room, given relative to the start pose in shares of the room's half side."""
        (at_x_m, at_y_m, heading_rad), scale = self.home(robot), self.harness.room_m / 2.0
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        x_m, y_m = (ahead * c - left * s) * scale, (ahead * s + left * c) * scale
        patience = {"radius_m": 2.0 * self.near_m, "timeout_s": max(_TIMEOUT_S, self.way_s())}
        return Waypoint(at_x_m + x_m, at_y_m + y_m, **{**patience, **options})

    def go(
        self,
        robot: Robot,
        target: Waypoint,
        by: Controller = Controller.AC,
        *,
        cause: str = "",
    ) -> Goal:
        """Send a robot to a target and fail the clause unless it arrives; `cause` is the likely cause, if known."""
        began, began_s = self.look(robot), self.now_s
        goal = robot.goto(target, by)
        self.run(self.way_s(), lambda: not goal.active or self.stands(robot, began_s, target.speed_m_s))
        self.require(
            goal.status is GoalStatus.REACHED,
            f"a goal {began.distance_m(target.x_m, target.y_m):.2f} m away is {goal.status.value} ({goal.reason}) "
            f"after {self.now_s - began_s:.1f} s, expected reached: "
            f"{self._astray(robot, began, goal) or cause or self._stuck(robot, goal) or _NOT_THROUGH}",
        )
        return goal

    def arrive(self, goal: Goal, cause: str) -> None:
        """Fail the clause unless a robot reaches its goal."""
        self.run(self.way_s(), lambda: not goal.active)
        self.require_status(goal, GoalStatus.REACHED, cause)

    def _astray(self, robot: Robot, began: TrackSample, goal: Goal) -> str:
        """Return what is likely wrong, judging by the way that a robot took; empty if that way shows nothing."""
        last, target = self.tracks[robot.id][-1], goal.target
        moved_m, up_m = last.distance_m(began.x_m, began.y_m), last.state.z_m - target.z_m
        if last.distance_m(target.x_m, target.y_m) <= target.radius_m and abs(up_m) > 0.5 * target.radius_m:
            return f"it is there but for its height, which is said to be {up_m:.2f} m off: z_m is 0 on the ground"
        if moved_m <= 2.0 * self.still_m:
            return ""
        wanted = math.atan2(target.y_m - began.y_m, target.x_m - began.x_m)
        off = turn(wanted, math.atan2(last.y_m - began.y_m, last.x_m - began.x_m))
        if abs(off) <= _ASTRAY_RAD:
            return f"it drove {moved_m:.2f} m the right way, and stopped short"
        return (
            f"it drove {moved_m:.2f} m, {abs(off):.2f} rad to the {'left' if off > 0.0 else 'right'} of the way there: "
            "an older target is still in force, axes are swapped or mirrored, or the target is in another frame"
        )

    def _stuck(self, robot: Robot, goal: Goal) -> str:
        """Return why a robot may stand although it reports the goal as in progress; empty if it does not."""
        last = self.tracks[robot.id][-1]
        if last.state.goal_id != goal.id:
            return ""
        if abs(last.state.yaw_rate_rad_s) > TURNING_RAD_S:
            return "it turns on its place, and on: differences of headings are to be brought to -pi to pi"
        at_charger = self.harness.charges_at_start and last.distance_m(robot.spec.x_m, robot.spec.y_m) <= self.near_m
        why = "it is on its charger, and does not drive while it is being charged; or " * at_charger
        return (
            f"it says that it works on the goal, and stands: {why}renew_lease() does not renew its lease, or it has "
            "latched a fault, such as after some ends of its lease"
        )

    def stands(self, robot: Robot, since_s: float, speed_m_s: float | None = None) -> bool:
        """Return whether a robot has had time to move, but has not moved or not been heard for a while.

        Args:
            robot: which.
            since_s: when it was told to.
            speed_m_s: the goal's cap on the speed, or None.
        """
        # Long enough for a slow robot to get farther than noise seems to.
        patience_s = max(_PATIENCE_S, 4.0 * self.still_m / min(self._slow_m_s, speed_m_s or math.inf))
        patience_s += 2.0 * self.caps.latency_s + self.caps.sample_age_s
        track, from_s = self.tracks[robot.id], self.now_s - patience_s
        if from_s < since_s:
            return False
        last = track[-1]
        return all(
            last.distance_m(each.x_m, each.y_m) <= 2.0 * self.still_m
            and abs(turn(last.heading_rad, each.heading_rad)) <= self.still_rad
            for each in self.since(robot, from_s)
        )

    def get_going(
        self,
        robot: Robot,
        target: Waypoint,
        by: Controller = Controller.AC,
        *,
        closely: bool = False,
        cause: str = "",
    ) -> Goal:
        """Send a robot to a far target and fail the clause unless it comes up to speed towards it."""
        began_s = self.now_s
        goal = robot.goto(target, by)
        fast = 0.7 * min(self.caps.v_max_m_s, target.speed_m_s or math.inf)
        if not self.truth:
            # What is seen of a slow one may be less, by as much as its velocity is promised to be off.
            fast = max(fast - (self.caps.speed_noise_m_s or 0.0), 0.5 * fast)

        def moves() -> bool:
            track = self.tracks[robot.id]
            if track[-1].speed_m_s <= fast:
                return False
            # One that arrives elsewhere, and has yet to turn round, is as fast.
            before = next((each for each in reversed(track) if each.at_s <= track[-1].at_s - _TOWARDS_S), track[0])
            return track[-1].distance_m(target.x_m, target.y_m) < before.distance_m(target.x_m, target.y_m)

        self.run(
            self.way_s(), lambda: moves() or not goal.active or self.stands(robot, began_s, target.speed_m_s),
            closely=closely,
        )  # fmt: skip
        most_m_s = max((each.speed_m_s for each in self.since(robot, began_s)), default=0.0)
        self.require(
            moves() and goal.active,
            f"it did not come up to {fast:.2f} m/s, but to {most_m_s:.2f} m/s, on a straight leg within "
            f"{self.now_s - began_s:.1f} s: "
            f"{cause or (most_m_s <= self.caps.moving_m_s and self._stuck(robot, goal)) or _SLOW}",
        )
        return goal

    def keep_on(self) -> None:
        """Let a robot that `get_going` has brought up to speed drive on until it has driven evenly for a while."""
        self.run(0.5 * max(self.brakes_s, self.gains_s) + CRUISE_S + TICK_S, closely=True)

    def expect_stop(self, robot: Robot, cause: str, *, extra_s: float = 0.0, renew: bool = True) -> None:
        """Fail the clause unless a moving robot stops within the time and way that it promises, and stays there.

        Args:
            robot: which.
            cause: the likely cause if it does not.
            extra_s: how much later than now it may begin to stop, such as the lease.
            renew: whether leases are renewed while it is watched.
        """
        caps = self.caps
        before = self.tracks[robot.id][-1]
        begin_s = extra_s + caps.latency_s + caps.jitter_s + caps.setpoint_period_s + TICK_S
        allowed_s = begin_s + self.brakes_s
        self.run(allowed_s + 2 * TICK_S + caps.sample_age_s, renew=renew)
        rest = self.look(robot)
        self.run(1.0, renew=renew)
        later = self.look(robot)
        slipped, turned = later.distance_m(rest.x_m, rest.y_m), abs(turn(rest.heading_rad, later.heading_rad))
        if slipped <= self.held_m and turned > self.still_rad and abs(before.yaw_rate_rad_s) <= TURNING_RAD_S:
            # It drove straight and now turns in place, so it wants to drive somewhere again.
            cause = f"it turns to drive back to where it was when it was told, as if that were its goal; or {cause}"
        self.require(
            slipped <= self.held_m and turned <= self.still_rad,
            f"{allowed_s:.2f} s after it had to stop it still moves, {slipped:.3f} m and {turned:.2f} rad within "
            f"another second: {cause}",
        )
        allowed_m = caps.v_max_m_s * (begin_s + caps.sample_age_s) + caps.v_max_m_s**2 / (2.0 * caps.brake_m_s2)
        run_m = rest.distance_m(before.x_m, before.y_m)
        self.measure(
            "stopping_distance_m", run_m, allowed_m, self.still_m,
            f"it ran on too far: {cause}, or brake_m_s2 is declared too high",
        )  # fmt: skip

    def expect_still(self, robot: Robot, seconds: float, cause: str) -> None:
        """Fail the clause unless a robot at rest stays where it is."""
        before, off_rad = self.look(robot), self.heading_off_rad(robot)
        began_s = self.now_s
        self.run(seconds)
        moved = max(
            (each.distance_m(before.x_m, before.y_m) for each in self.since(robot, began_s)),
            default=0.0,
        )
        turned = max(
            (abs(turn(before.heading_rad, each.heading_rad)) for each in self.since(robot, began_s)), default=0.0
        )
        if moved <= _CREEPS * self.caps.v_max_m_s * seconds and turned <= self.still_rad:
            cause = f"it creeps, so nothing holds it at rest; or {cause}"
        if abs(turn(off_rad, self.heading_off_rad(robot))) > self.still_rad:
            cause = f"truly it did not turn: the heading that it says drifts, as with a gyro's bias; or {cause}"
        self.require(
            moved <= self.held_m and turned <= self.still_rad,
            f"it moved by {moved:.3f} m and turned by {turned:.2f} rad in {seconds:g} s, expected rest: {cause}",
        )
