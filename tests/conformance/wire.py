"""A robot behind a simulated link in virtual time, done right: what a wire adapter does about a bad link."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import ClassVar, NamedTuple

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.clock import Clock, VehicleClock, VirtualClock
from soter.conformance import Harness
from soter.conformance.find import open_floor
from soter.conformance.harness import FOR_EVER_S, LEG_M, Killable, Switchable
from soter.conformance.harness import LIMITS as JUDGED_BY
from soter.errors import Intruder, RobotUnavailable
from soter.onboard.drive import Drive, DriveLimits
from soter.onboard.mux import Mux
from soter.sdk import Capabilities, Controller, Fleet, Goal, Link, Robot, RobotSpec, RobotState, TruthReport
from soter_sim import LIMITS, World
from soter_sim.bodies import built
from soter_sim.kinematic import KinematicEngine
from tests.conformance.channel import Channel, Faults
from tests.conformance.simulated import specs_of

PERIOD_S = 0.01
"""The vehicle's control period."""

SAMPLE_PERIODS = 2
"""So many of them from one sample to the next."""


class Intent(NamedTuple):
    """All that the robot has to know, in every message: nothing hangs on the one before having arrived.

    Attributes:
        session: the program that says it.
        number: rises with each message of a session.
        in_charge: who is.
        goal: where to, or None.
        renewed_s: the vehicle's own time at which the lease was renewed, or None.
        renews: whether this message was sent to renew it.
    """

    session: int
    number: int
    in_charge: Controller
    goal: Goal | None
    renewed_s: float | None
    renews: bool


class Vehicle:
    """One robot's own side: its clock, its gate, its drive; hears every program and reports to all.

    Args:
        spec: which robot.
        world: where it lives.
    """

    lease_s: ClassVar[float] = 0.15
    limits: ClassVar[DriveLimits] = LIMITS
    # What is wrong with some is that their lease lives while the clock stands still that it is counted by.
    minds_its_clock: ClassVar[bool] = True
    sample_periods = SAMPLE_PERIODS

    def __init__(self, spec: RobotSpec, world: World) -> None:
        self.id = spec.id
        self.world = world
        self.index = world.index(spec.id)
        self.faults = Faults()
        self.down: list[Channel[Intent]] = []
        self.up: list[Channel[RobotState]] = []
        self.offset_s = 1000.0 * spec.id
        self.stopped_s = math.inf
        if spec.promised is not None:
            self.lease_s = spec.promised.lease_s  # type: ignore[misc]
        self.drive = Drive(built(spec, self.limits), world.period_s)
        self.periods, self.stalls_until_s = 0, 0.0
        self.seized = self.disabled = False
        self.mode = "auto"
        self.speedup = 1.0
        self.complaint = ""
        self.intruded_until_s, self.intruder_turns = 0.0, False
        self.begin()
        world.set_control(spec.id, self.control)

    def begin(self) -> None:
        """Begin to run, knowing nothing."""
        self.session, self.heard = 0, 0
        self.mux: Mux[Controller, Goal] = Mux(Controller.SC, self.lease_s)

    def restart(self) -> None:
        self.offset_s = -self.world.now_s
        self.begin()

    def talks(self) -> bool:
        """Whether what hears and talks for it goes on, and does not stand still for a moment."""
        return self.world.now_s >= self.stalls_until_s

    @property
    def taken(self) -> bool:
        """Whether a person has it."""
        return self.seized or self.disabled

    def passing(self, clock_s: float) -> Goal | None:
        return None if self.taken else self.mux.passing(clock_s)

    def control(self, now_s: float, x: float, y: float, heading: float, v: float, rate: float) -> tuple[float, float]:
        clock_s, talks = min(now_s, self.stopped_s) + self.offset_s, self.talks()
        for channel in self.down if talks else ():
            for intent in channel.receive(now_s):
                self.take(intent, clock_s)
        if self.minds_its_clock and now_s > self.stopped_s:
            self.mux.renew(-math.inf)
        goal = self.passing(clock_s)
        self.periods += 1
        if talks and self.periods % self.sample_periods == 0:
            for line in self.up:
                line.send(now_s, self.sample(clock_s, x, y, heading, rate))
        return self.drive.command(x, y, heading, v, rate, None if goal is None else goal.target)

    def sample(self, clock_s: float, x: float, y: float, heading: float, rate: float) -> RobotState:
        east, north = self.world.engine.velocity(self.index)
        command = self.mux.command
        return RobotState(
            self.id, clock_s, clock_s, x, y, 0.0, heading, east, north, rate, self.world.bodies.charge[self.index],
            None if self.taken else self.mux.in_charge, None if command is None else command.id, Link.UP,
        )  # fmt: skip

    def take(self, intent: Intent, clock_s: float) -> None:
        if not self.follows(intent, clock_s):
            return
        self.session, self.heard = intent.session, intent.number
        self.mux.switch(intent.in_charge)
        if intent.goal is None:
            self.mux.halt()
        elif self.mux.command is not intent.goal:
            self.mux.give(intent.in_charge, intent.goal, clock_s)
        self.renew(intent, clock_s)

    def follows(self, intent: Intent, clock_s: float) -> bool:
        if self.complaint:
            return False
        if intent.session == self.session:
            return intent.number > self.heard
        return not self.mux.alive(clock_s)

    def renew(self, intent: Intent, clock_s: float) -> None:
        if intent.renewed_s is not None:
            # A sender whose idea of this clock runs ahead gets no longer lease for it.
            self.mux.renew(min(intent.renewed_s, clock_s))


class WireClock(VirtualClock):
    """Virtual time that takes itself for the host's, or for that of a host whose time passes slower."""

    speedup = 1.0

    def steady_s(self) -> float:
        return self.now() / self.speedup


class WireRobot(Robot):
    """Sends intents, numbered; receives samples stamped by the vehicle's clock."""

    declared: ClassVar[Capabilities] = replace(
        SimulatedRobot.declared, in_process=False, latency_s=0.03, sample_age_s=0.04, jitter_s=0.01,
        setpoint_period_s=0.02, lease_s=0.15, position_noise_m=0.001,
    )  # fmt: skip
    vehicle_class: ClassVar[type[Vehicle]] = Vehicle
    clock_class: ClassVar[type[WireClock]] = WireClock
    # What is wrong with some is that nothing says when the program that simulates a robot has ended.
    fleet_says_lost: ClassVar[bool] = True
    truth_says_ended: ClassVar[bool] = True
    truth_says_on: ClassVar[bool] = True

    def __init__(self, spec: RobotSpec, clock: VirtualClock, vehicle: Vehicle) -> None:
        super().__init__(spec, clock)
        self.vehicle = vehicle
        self.faults = vehicle.faults
        number = len(vehicle.down)
        seed = 2 * (vehicle.index + 1) + 10 * number
        self.down: Channel[Intent] = Channel(self.faults, seed)
        self.up: Channel[RobotState] = Channel(self.faults, seed + 1)
        vehicle.down.append(self.down)
        vehicle.up.append(self.up)
        self.learned = VehicleClock(rate_tolerance=0.0, steady=clock.now)
        self.wanted = Intent(number + 1, 0, Controller.SC, None, None, False)
        self.latest: RobotState | None = None

    def want(self, *, renew: bool = False, **changes: Goal | Controller | None) -> None:
        if renew:
            with suppress(LookupError):
                now_s = self.clock.now()
                self.wanted = self.wanted._replace(renewed_s=self.learned.to_vehicle_s(self.id, now_s))
        self.wanted = self.wanted._replace(number=self.wanted.number + 1, renews=renew, **changes)  # type: ignore[arg-type]
        # Nobody being there is told as an error: the next message says it all again.
        with suppress(ConnectionError):
            self.down.send(self.clock.now(), self.wanted)

    def _connect(self, timeout_s: float) -> Capabilities:
        end_s = self.clock.now() + timeout_s
        while self.vehicle.session != self.wanted.session:
            self.clock.sleep_until(self.clock.now() + 0.02)
            self._sample()
            self.want()
            if self.clock.now() >= end_s:
                raise RobotUnavailable(f"robot {self.id} does not get ready; it says: {self.complaint()}")
        return self.declared

    def complaint(self) -> str:
        """What the robot says of why it follows nobody, or not this program."""
        return self.vehicle.complaint or "I follow another program, whose lease lives"

    def _send_goto(self, goal: Goal) -> None:
        self.want(goal=goal)

    def _sample(self) -> RobotState | None:
        for sample in self.received():
            arrived_s = self.arrived_s(sample)
            rebooted = self.learned.observe(self.id, sample.vehicle_stamp_s, arrived_s)
            if rebooted or self.latest is None or sample.vehicle_stamp_s > self.latest.vehicle_stamp_s:
                self.latest = sample._replace(stamp_s=self.learned.to_fleet_s(self.id, sample.vehicle_stamp_s))
        return self.latest

    def received(self) -> list[RobotState]:
        try:
            return self.up.receive(self.clock.now())
        except ConnectionError:
            return []

    def arrived_s(self, sample: RobotState) -> float:
        return self.up.arrived_s.pop(id(sample), self.clock.now())

    def _hand_over(self, to: Controller) -> None:
        self.want(in_charge=to, goal=self.wanted.goal if to is self.wanted.in_charge else None)

    def says_gone(self) -> bool:
        """Whether the fleet says that the program which simulates it has ended."""
        return self.faults.gone and self.fleet_says_lost

    def intruded(self) -> bool:
        """Whether another program is heard to move the robot."""
        return self.clock.now() < self.vehicle.intruded_until_s

    def _renew_lease(self) -> None:
        if self.intruded():
            raise Intruder("another program moves it")
        self.want(renew=True)

    def _halt(self) -> None:
        self.want(goal=None)

    def _disconnect(self, timeout_s: float) -> None:
        self.wanted = self.wanted._replace(renewed_s=None)
        self.want(goal=None)
        self.clock.sleep_until(self.clock.now() + min(timeout_s, 0.5))


class Moving:
    """The truth between two periods, as a world behind a wire would have it."""

    def __init__(self, world: World, clock: Clock) -> None:
        self.world = world
        self.clock = clock
        self.ended_s: float | None = None
        self.says_on = True

    def report(self) -> TruthReport:
        ended_s = self.ended_s
        if not self.says_on:
            self.ended_s = None
        return replace(self.world.truth.report(), ended_s=ended_s)

    def pose(self, robot_id: int) -> tuple[float, float, float]:
        world, index = self.world, self.world.index(robot_id)
        x_m, y_m, heading_rad = world.truth.pose(robot_id)
        later_s = self.clock.now() - world.now_s
        length_m = world.bodies.v[index] * later_s
        heading_rad += world.bodies.yaw_rate[index] * later_s
        return (
            x_m + length_m * math.cos(heading_rad),
            y_m + length_m * math.sin(heading_rad),
            math.remainder(heading_rad, 2.0 * math.pi),
        )


class WireFleet(Fleet):
    """One program's robots; the world is its harness's."""

    def lost(self) -> str:
        gone = any(isinstance(each, WireRobot) and each.says_gone() for each in self.robots)
        return "the robot's program has ended" if gone else ""

    def _close(self) -> None:
        pass


class WireHarness(Harness):
    """Opens robots of any class behind a link, with every fault of link and vehicle."""

    leg_m = LEG_M
    charges_at_start = True
    contacts = True
    robots_most = 3
    limits = JUDGED_BY

    def __init__(self, kind: type[WireRobot]) -> None:
        self.name = kind.__name__
        self.kind = kind
        self.world: World | None = None
        self.specs: list[RobotSpec] = []
        self.vehicles: dict[int, Vehicle] = {}

    def open(self, robots: int) -> Fleet:
        return self._opened(specs_of(robots))

    def promising(self, promised: Capabilities, robots: int = 1) -> Fleet:
        return self._opened(specs_of(robots, promised))

    def charged(self, charge: float, lasts_s: float = FOR_EVER_S, charge_s: float = FOR_EVER_S) -> Fleet:
        return self._opened(specs_of(1, None, charge, lasts_s, charge_s))

    def choosing(self, order: Sequence[int]) -> Fleet:
        self._opened(specs_of(self.robots_most))
        self.specs = [self.specs[each] for each in order]
        return self.second()

    def switchable(self) -> Switchable:
        fleet, world, (vehicle,) = self.open(1), self.world, self.vehicles.values()
        assert world is not None

        def off() -> None:
            vehicle.faults.gone = True
            world.set_control(vehicle.id, None)

        def on() -> None:
            vehicle.faults.gone = False
            vehicle.restart()
            world.set_control(vehicle.id, vehicle.control)

        return Switchable(fleet, off, on)

    def killable(self) -> Killable:
        fleet, off, _ = self.switchable()
        truth = fleet.truth
        assert isinstance(truth, Moving)

        def kill() -> None:
            off()
            truth.ended_s = self.clock.now() if self.kind.truth_says_ended else None
            truth.says_on = self.kind.truth_says_on

        return Killable(fleet, kill)

    def refusing(self) -> tuple[Fleet, str]:
        fleet, (vehicle,) = self.open(1), self.vehicles.values()
        vehicle.complaint = "the motors are too hot"
        return fleet, vehicle.complaint

    def faster(self, speedup: float) -> Fleet:
        fleet, (vehicle,) = self.open(1), self.vehicles.values()
        self.clock.speedup = vehicle.speedup = speedup
        return fleet

    def _opened(self, specs: list[RobotSpec]) -> Fleet:
        engine = partial(KinematicEngine, step_s=PERIOD_S)
        self.specs = specs
        self.world = world = World(open_floor().with_robots(len(specs)), specs, engine, JUDGED_BY)
        self.clock = self.kind.clock_class(world.advance)
        self.vehicles = {spec.id: self.kind.vehicle_class(spec, world) for spec in specs}
        return self.second()

    def second(self) -> Fleet:
        assert self.world is not None
        robots = [self.kind(spec, self.clock, self.vehicles[spec.id]) for spec in self.specs]
        return WireFleet(self.clock, robots, Moving(self.world, self.clock))

    def another(self) -> Harness:
        return WireHarness(self.kind)

    def close(self) -> None:
        if self.world is not None:
            self.world.close()

    def step_clock(self, robot_id: int, seconds: float) -> None:
        self.vehicles[robot_id].offset_s += seconds

    def stop_clock(self, robot_id: int) -> None:
        self.vehicles[robot_id].stopped_s = self.clock.now()

    def restart(self, robot_id: int) -> None:
        self.vehicles[robot_id].restart()

    def stall(self, robot_id: int, seconds: float) -> None:
        self.vehicles[robot_id].stalls_until_s = self.clock.now() + seconds

    def cut(self, robot_id: int) -> None:
        self.vehicles[robot_id].faults.cut = True

    def restore(self, robot_id: int) -> None:
        self.vehicles[robot_id].faults.cut = False

    def delay(self, seconds: float) -> None:
        self._all(delay_s=seconds)

    def loss(self, fraction: float) -> None:
        self._all(loss=fraction)

    def duplicate(self, fraction: float) -> None:
        self._all(duplicate=fraction)

    def reorder(self, fraction: float) -> None:
        self._all(reorder=fraction)

    def garble(self, fraction: float) -> None:
        self._all(garble=fraction)

    def seize(self, robot_id: int) -> None:
        self.vehicles[robot_id].seized = True

    def by_hand(self, robot_id: int) -> None:
        vehicle = self.vehicles[robot_id]
        vehicle.seized, vehicle.mode = True, "manual"

    def shown(self, robot_id: int) -> str:
        return self.vehicles[robot_id].mode

    def disable(self, robot_id: int) -> None:
        self.vehicles[robot_id].disabled = True

    def intrude(self, robot_id: int, seconds: float, turns: bool) -> None:
        self.vehicles[robot_id].intruded_until_s = self.clock.now() + seconds
        self.vehicles[robot_id].intruder_turns = turns

    def _all(self, **faults: float) -> None:
        for vehicle in self.vehicles.values():
            for name, value in faults.items():
                setattr(vehicle.faults, name, value)
