"""One MAVLink vehicle behind the narrow interface, with any link.

A vehicle with a gate and a lease is told the active controller, and its lease is renewed, at every tick. For one
without, this adapter stands in: it lets only the active controller send, overwrites the target at a switch, and never
sends a target further away than the lease covers. Heartbeats, targets and renewals are sent by `_renew_lease` and by no
thread or timer, so that a vehicle whose supervisor has stopped hears nothing more. `_sample`, which the supervisor
calls at every tick, makes a vehicle ready again.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import ClassVar, Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import CONTROLLERS, KEEPER, SENDERS, Authority
from soter.adapters.mavlink.frames import EarthFrame, Frame, GeoPoint, frame_of
from soter.adapters.mavlink.legs import TargetLeg, reach_m, towards
from soter.adapters.mavlink.link import MavlinkLink
from soter.adapters.mavlink.obedience import Obedience
from soter.adapters.mavlink.options import MavlinkConfig, simulated
from soter.adapters.mavlink.parameters import JudgedParameters
from soter.adapters.mavlink.preparation import Preparation
from soter.adapters.mavlink.sampling import ChargeFilter, Sampler, TimeSync
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.standing import Standing
from soter.adapters.mavlink.vehicle import Vehicle
from soter.adapters.mavlink.whereabouts import Whereabouts
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable, Uncontrolled, Unsupported
from soter.sdk import Capabilities, Controller, Goal, Robot, RobotSpec, RobotState
from soter.sdk.robot import FUTURE_S

logger = logging.getLogger(__name__)

_LOOK_S: Final = 0.01
_BEAT_S: Final = 1.0
_SYNC_S: Final = 0.05
_LOST_S: Final = 1.0
_REPEAT_S: Final = 0.1
_SETS_OUT_M: Final = 0.015
"""A vehicle that is less than a centimetre from its place stays where it is."""


class MavlinkRobot(Robot):
    """One vehicle.

    Args:
        spec: the robot; its id is the vehicle's system id.
        clock: follows the vehicles' clocks.
        link: the connection to the vehicle.
        config: the backend's options.
        fleet: all robots on the link; while one gets ready, the others get as ready as they can without being armed.
    """

    declared: ClassVar[Capabilities] = simulated("rover")

    def __init__(
        self,
        spec: RobotSpec,
        clock: VehicleClock,
        link: MavlinkLink,
        config: MavlinkConfig,
        fleet: Sequence[MavlinkRobot] = (),
    ) -> None:
        super().__init__(spec, clock)
        volts = (None, None) if config.voltage is None else (config.voltage.empty_v, config.voltage.full_v)
        self._config: Final = config
        self._fleet: Final = fleet
        self._vehicle: Final = Vehicle(link, spec.id)
        self._time_sync: Final = TimeSync(spec.id, clock, self._vehicle.inbox)
        self._authority: Final = Authority(self._vehicle)
        self._setpoints: Final = Setpoints(self._vehicle, self.declared.v_max_m_s)
        self._standing: Final = Standing(self._vehicle, self._setpoints, self.declared, clock)
        self._judged: Final = JudgedParameters(self._vehicle, self.declared)
        self._preparation: Final = Preparation(
            self._vehicle, self._time_sync, self._authority, self._setpoints, config, self.declared, self._judged
        )
        self._sampler: Final = Sampler(
            spec.id, self._vehicle.inbox, self._time_sync, ChargeFilter(spec.drive_s, *volts), self._reported
        )
        self._whereabouts: Final = Whereabouts(self._vehicle, self.declared.v_max_m_s, config.gps_accuracy_m)
        self._obedience: Final = Obedience(
            self._vehicle, self._whereabouts, self._setpoints, self._judged, self.declared.moving_m_s
        )
        self._charge = Controller.SC
        self._leg: TargetLeg | None = None
        self._sent_to: Goal
        self._turns = False
        self._refusal = ""
        self._gated = False
        self._renewed_s = 0.0
        self._beaten_s = self._synced_s = -math.inf
        self._reboots = 0
        self._lost = False

    # --- the hooks -----------------------------------------------------------------------------------------

    def _connect(self, timeout_s: float) -> Capabilities:
        until_s = self.clock.steady_s() + timeout_s
        self._preparation.may_arm = True
        while not (self._prepared() and self._timed()):
            if self.clock.steady_s() > until_s:
                ready = self._preparation.ready
                lacks = "quick answers to TIMESYNC: samples come out as of the future" if ready else ""
                raise RobotUnavailable(
                    f"robot {self.id}: it did not get ready within {timeout_s:g} s; it lacks "
                    f"{lacks or self._preparation.why_not()}"
                )
            # Robots that are ready already wait for this one, and without heartbeats would think their station gone.
            self._beat(self._vehicle.link.inboxes)
            for robot in self._fleet or (self,):
                robot._ask_for_time()
                if robot is not self and not robot.initialised:
                    # Its trouble is reported when its own turn comes.
                    with suppress(RobotUnavailable):
                        robot._prepared()
            # Once no vehicle lacks anything else, all are armed at once: copters take their time to climb.
            if all(robot._preparation.only_to_arm for robot in self._fleet):
                for robot in self._fleet:
                    robot._preparation.may_arm = True
            self.clock.sleep_until(self.clock.now() + _LOOK_S)
        sample = self._known()
        if sample is None:
            raise RobotUnavailable(f"robot {self.id}: it is ready, but does not say where it is")
        found = self.declared
        if not self._gated:
            reverses = found.reverses and (self._sampler.flies or self._vehicle.kind.is_ardurover)
            # Without a gate it pivots first, too. But its last target outlives the lease, so it still ends its turn: no
            # farther from its place than the lease allows, but later.
            found = replace(found, reports_controller=False, reverses=reverses, pivots_first=False)
        return found if sample.battery is not None else replace(found, reports_battery=False)

    def _send_goto(self, goal: Goal) -> None:
        target, at = goal.target, self._known()
        if not self._sampler.flies and abs(target.z_m) > target.radius_m:
            raise Unsupported(f"robot {self.id}: it stays on the ground, and the target has z_m = {target.z_m:g}")
        leg = None if at is None else TargetLeg(at.x_m, at.y_m, at.z_m, target)
        if target.heading_rad is not None and not self._gated and not self._sampler.flies:
            if not self._reverses:
                raise Unsupported(f"robot {self.id}: its autopilot takes no heading to arrive with")
            if leg is not None and not leg.along:
                raise Unsupported(f"robot {self.id}: its autopilot arrives with no heading but that of its way")
        if leg is not None:
            self._leg, self._sent_to = leg, goal
            self._send_target(at)

    def _sample(self) -> RobotState | None:
        # Here, and not with the lease: a robot that has been away is not driven on before its clock is known and it is
        # ready.
        self._ask_for_time()
        try:
            if self._prepared():
                self._refusal = ""
        except RobotUnavailable as failure:
            self._refusal = str(failure)
        return self._known()

    def _known(self) -> RobotState | None:
        whereabouts = self._whereabouts
        if self._preparation.ready:
            whereabouts.look()
            self._obedience.look()
        elif whereabouts.astray:
            whereabouts.look()
        # A position that the EKF itself does not trust is not used: the latest sample ages instead.
        return self._sampler.latest if whereabouts.astray else self._sampler.sample()

    def _hand_over(self, to: Controller) -> None:
        if to is not self._charge:
            self._leg = None
        self._charge = to
        if self._gated:
            # Naming another component drops the target on the vehicle. The lease stays: only `_renew_lease` renews it.
            self._name()
        elif self._leg is None:
            self._stand(self._known())

    def _renew_lease(self) -> None:
        self._beat([self.id])
        if not self._preparation.ready:
            self._tell_of_switch()
            raise Uncontrolled(self._refusal or self._preparation.why_again())
        latest = self._sampler.latest
        if trouble := self._whereabouts.astray or self._obedience.disobeys or self._standing.drifted(latest):
            self._standing.taken(led=self._obedience.led)
            self._stand(latest if self._vehicle.kind.drifts else None)
            raise Uncontrolled(trouble)
        self._renewed_s = self.clock.now()
        if self._gated:
            self._name()
        self._send_target(self._known())

    def _halt(self) -> None:
        self._leg = None
        self._stand(self._known())

    def _disconnect(self, timeout_s: float) -> None:
        self._leg = None
        vehicle = self._vehicle
        if not self._preparation.taken or vehicle.heartbeat is None:
            return
        kind, sample = vehicle.kind, self._known()
        if self._preparation.ready and vehicle.mode not in (kind.guided, kind.stop):
            # A pilot has taken it, or its fail-safe drives it home.
            return
        if not vehicle.armed:
            vehicle.set_mode(KEEPER, kind.stop)
            return
        lost = sample is None or self.clock.now() - sample.stamp_s > self.stale_after_s
        # A robot that is no longer heard has stopped by itself: wait at most _LOST_S.
        self._repeat(self._stop, self._stands, min(timeout_s, _LOST_S) if lost else timeout_s)
        if self._preparation.armed_it and not kind.flies and not kind.drifts:
            arm = mav.MAV_CMD_COMPONENT_ARM_DISARM
            self._repeat(lambda: vehicle.command(KEEPER, arm, 0.0), lambda: not vehicle.armed, _LOST_S)
        if self._gated:
            self._authority.release()
        land = kind.land
        if land is not None and self._config.on_close == "land":
            self._repeat(lambda: vehicle.set_mode(KEEPER, land), lambda: vehicle.mode == land, _LOST_S)

    def _prepared(self) -> bool:
        """Return whether the vehicle takes targets; if not, take the next step of making it ready.

        It is made ready again after a reboot, after a silence, in which its own fail-safe may have acted, after a
        fail-safe whose cause is gone, and when the origin of its EKF has changed. A mode that changes for no such
        reason was changed by a person, such as a pilot, and is left alone.
        """
        preparation, heard, reboots = self._preparation, self._vehicle.heartbeat is not None, self._time_sync.reboots
        anew = heard and (self._lost or self._obedience.may_be_taken_back or preparation.moved)
        if reboots != self._reboots or (preparation.ready and anew):
            self._reboots = reboots
            if preparation.moved:
                self._sampler.frame = None
            preparation.begin()
        self._lost = not heard
        try:
            if self._time_sync.two:
                raise RobotUnavailable("two vehicles with its system id are heard; give each one of its own")
            if not preparation.ready and preparation.step():
                self._adopt()
            elif self._sampler.latest is not None and self._sampler.frame is None and preparation.origin is not None:
                # Where it is, is known again, long before it is ready.
                self._sampler.frame = self._frame(preparation.origin)
        except RobotUnavailable as failure:
            raise RobotUnavailable(f"robot {self.id}: {failure}") from failure
        return preparation.ready

    @property
    def _reverses(self) -> bool:
        """Whether this is a rover without a gate that is told to drive forwards or backwards."""
        return not self._gated and self._vehicle.kind.is_ardurover and self.declared.reverses

    def _timed(self) -> bool:
        """Return whether the vehicle's clock is known well enough: samples from the future would be refused."""
        sample = self._known()
        return sample is None or sample.stamp_s <= self.clock.now() + FUTURE_S

    def _adopt(self) -> None:
        """Adopt the preparation's findings: frame, kind and gate."""
        preparation, kind = self._preparation, self._vehicle.kind
        assert preparation.origin is not None
        frame = self._sampler.frame = self._frame(preparation.origin)
        self._setpoints.begin(frame)
        self._sampler.flies = kind.flies
        self._standing.begin(self._known())
        self._gated = preparation.gated is True
        self._whereabouts.begin()
        self._obedience.begin(preparation.origin, gated=self._gated)
        logger.info(
            "robot %d: a %s is ready; %s", self.id, kind.name,
            "it has a gate of its own" if self._gated else "its autopilot has no gate, the adapter stands in",
        )  # fmt: skip

    def _frame(self, origin: GeoPoint) -> Frame | EarthFrame:
        kind = self._vehicle.kind
        plane_m = self._config.height_m if kind.flies else 0.0
        return frame_of(self._preparation.workspace_origin, origin, plane_m, is_px4=kind.is_px4)

    def _beat(self, systems: Iterable[int]) -> None:
        """Send heartbeats if they are due. Called with the lease, and while no robot may move yet."""
        now_s = self.clock.steady_s()
        if now_s - self._beaten_s >= _BEAT_S:
            self._beaten_s = now_s
            for system in systems:
                self._vehicle.link.beat(system)

    def _ask_for_time(self) -> None:
        now_s = self.clock.steady_s()
        if now_s - self._synced_s >= _SYNC_S:
            self._synced_s = now_s
            self._vehicle.send(KEEPER, "TIMESYNC", self._time_sync.request())

    # --- what it is told -----------------------------------------------------------------------------------

    def _tell_of_switch(self) -> None:
        """Tell a vehicle that was away, as soon as it is back, that its SC is in charge; its lease stays dead.

        Only while it has no goal and has not been asked yet whether it still has a gate: then nothing can move for it,
        whatever its clock says, and it drops what the AC had in flight.
        """
        if self._gated and self._preparation.gated is None and self._charge is Controller.SC and self._leg is None:
            # Later than the last renewal: as its clock becomes better known, the same one could be the older.
            over_s = self._time_sync.to_vehicle_s(self.clock.now() - 2.0 * self.declared.lease_s)
            if over_s is not None:
                self._authority.name(SENDERS[Controller.SC], over_s)

    def _name(self) -> None:
        """Tell the vehicle the active controller, and when the lease was renewed last."""
        renewed_s = self._time_sync.to_vehicle_s(self._renewed_s)
        if renewed_s is not None:
            self._authority.name(SENDERS[self._charge], renewed_s)

    def _send_target(self, at: RobotState | None) -> None:
        """Send a target, or a command to stand, as the active controller."""
        leg = self._leg
        if leg is None or at is None:
            self._stand(at)
            return
        target = leg.looking_ahead(at) if self._sampler.flies else leg.target
        if self._gated:
            self._setpoints.go(self._charge, target, at)
            return
        promised, now_s = self.declared, self.clock.now()
        left_s = promised.lease_s - (now_s - self._renewed_s)
        # What a boat drifts is no error of its places.
        noise_m = promised.position_noise_m - self._judged.drift_m
        ended = not self._sampler.flies and leg.ended(at, noise_m)
        if ended and not self._sent_to.active:
            # It has arrived, and stays: when its places drift, it would turn round in place to get back.
            self._leg = None
        if left_s <= 0.0 or ended or self._standing.is_late(at) or self._standing.brakes:
            self._stand(at)
            return
        self._standing.driven_on()
        if not self._sampler.flies:
            # A rover hears of a target late, acts on it half a period later, and brakes harder and later than promised.
            late_s = 0.0 if self._vehicle.kind.drifts else promised.jitter_s  # a boat would not get on
            left_s = max(left_s - late_s - 0.5 * promised.setpoint_period_s, 0.0)
        # A slow vehicle would take long to a place as far ahead as a fast one may be sent, however dead the lease is;
        # this far it takes as long as a fast one.
        cap_m_s = promised.v_max_m_s if target.speed_m_s is None else target.speed_m_s
        fastest_m_s = min(max(cap_m_s, math.hypot(at.vx_m_s, at.vy_m_s)), promised.v_max_m_s)
        if self._reverses:
            self._setpoints.drive_backwards(leg.backwards)
        way = leg._replace(target=target)
        most_m = reach_m(promised.v_max_m_s, promised.brake_m_s2, left_s)
        ahead_m = max(most_m * fastest_m_s / promised.v_max_m_s, min(_SETS_OUT_M, most_m))
        if self._vehicle.kind.is_ardurover:
            far = way.ahead(at, reach_m(promised.v_max_m_s, promised.brake_m_s2, promised.lease_s))
            heading_rad = leg.facing(at, far, noise_m, self._judged.turn_reach_rad, turns=self._turns)
            self._turns = heading_rad is not None
            if heading_rad is not None:
                self._setpoints.turn(self._charge, at.x_m, at.y_m, heading_rad)
                return
            place = towards(at, far, ahead_m)
        else:
            place = way.ahead(at, ahead_m)
        self._standing.sent(place)
        self._setpoints.go_plainly(self._charge, *place, target.heading_rad)
        # ArduCopter forgets its limit with the first place after a velocity, ArduRover refuses one before it.
        self._setpoints.cap_speed(target.speed_m_s)

    def _stand(self, at: RobotState | None) -> None:
        """Tell the vehicle to stop and stay, as the active controller."""
        self._standing.stand(self._charge, at, plainly=self._gated or not self._preparation.ready)

    def _reported(self) -> Controller | None:
        """Return the active controller that the vehicle reports; None while the vehicle is not in its guided mode."""
        if not self._gated or self._vehicle.mode != self._vehicle.kind.guided or not self._vehicle.armed:
            return None
        component = self._authority.reported()
        return None if component is None else CONTROLLERS.get(component)

    def _stop(self) -> None:
        self._setpoints.stand(self._charge)
        self._vehicle.set_mode(KEEPER, self._vehicle.kind.stop)

    def _stands(self) -> bool:
        sample = self._known()
        return (
            sample is not None
            and self.clock.now() - sample.stamp_s <= self.stale_after_s
            and math.hypot(sample.vx_m_s, sample.vy_m_s) <= (self.declared.speed_noise_m_s or 0.0)
            and abs(sample.yaw_rate_rad_s) <= self.declared.rest_rad_s
            and self._vehicle.mode == self._vehicle.kind.stop
        )

    def _repeat(self, ask: Callable[[], None], reached: Callable[[], bool], timeout_s: float) -> None:
        """Ask at intervals until a condition is met, or the time is up."""
        until_s, asked_s = self.clock.steady_s() + timeout_s, -math.inf
        while not reached() and self.clock.steady_s() < until_s:
            if self.clock.steady_s() - asked_s >= _REPEAT_S:
                asked_s = self.clock.steady_s()
                ask()
            self.clock.sleep_until(self.clock.now() + _LOOK_S)
