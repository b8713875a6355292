"""One vehicle behind the narrow interface, whichever library its link uses.

Where the vehicle knows who is in charge and has a lease of its own, it is told of both at every tick. Where it does
not, this adapter stands in: it lets only the controller in charge send, overwrites the target at a change, and never
sends a target that is further away than the lease covers. Heartbeats, targets and renewals are sent by `_renew_lease`
and by no thread or timer, so that a vehicle whose supervisor has stopped hears nothing more. `_sample`, which the
supervisor calls at every tick, makes a vehicle ready again.
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
from soter.adapters.mavlink.frames import frame_of
from soter.adapters.mavlink.legs import TargetLeg, reach_m
from soter.adapters.mavlink.link import MavlinkLink
from soter.adapters.mavlink.obedience import Obedience
from soter.adapters.mavlink.options import MavlinkConfig, simulated
from soter.adapters.mavlink.parameters import JudgedParameters
from soter.adapters.mavlink.preparation import Preparation
from soter.adapters.mavlink.sampling import ChargeFilter, Sampler, TimeSync
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import ARDUROVER, Vehicle
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
_REST_RAD_S: Final = 0.02


class MavlinkRobot(Robot):
    """One vehicle.

    Args:
        spec: which; its id is the vehicle's system id.
        clock: follows the vehicles' clocks.
        link: over which it is reached.
        config: of the backend.
        fleet: all robots on the link; while one is waited for, the others get as ready as they can without being armed.
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
        judged = JudgedParameters(self._vehicle, self.declared)
        self._preparation: Final = Preparation(
            self._vehicle, self._time_sync, self._authority, self._setpoints, config, self.declared, judged
        )
        self._sampler: Final = Sampler(
            spec.id, self._vehicle.inbox, self._time_sync, ChargeFilter(spec.drive_s, *volts), self._reported
        )
        self._obedience: Final = Obedience(self._vehicle, self._setpoints, judged)
        self._charge = Controller.SC
        self._leg: TargetLeg | None = None
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
            # The robots that are ready wait for this one, and would take it for the end of their ground station.
            self._beat(self._vehicle.link.inboxes)
            for robot in self._fleet or (self,):
                robot._ask_for_time()
                if robot is not self and not robot.initialised:
                    # What is wrong with it is said when it is its turn.
                    with suppress(RobotUnavailable):
                        robot._prepared()
            self.clock.sleep_until(self.clock.now() + _LOOK_S)
        sample = self._known()
        if sample is None:
            raise RobotUnavailable(f"robot {self.id}: it is ready, but does not say where it is")
        found = self.declared
        if not self._gated:
            reverses = found.reverses and (self._sampler.flies or self._vehicle.kind == ARDUROVER)
            # It does pivot first. But its last target outlives the lease, and it ends the turn to it: no farther from
            # its place than the lease allows, but later.
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
            self._leg = leg
            self._send_target(at)

    def _sample(self) -> RobotState | None:
        # Here, and not with the lease: who has been away is not driven on before it is known when it says what it says,
        # and that it is ready.
        self._ask_for_time()
        try:
            if self._prepared():
                self._refusal = ""
        except RobotUnavailable as failure:
            self._refusal = str(failure)
        return self._known()

    def _known(self) -> RobotState | None:
        obedience = self._obedience
        if self._preparation.ready:
            obedience.look()
        # A place that its own EKF does not believe is none. What is known of the robot gets old instead.
        return self._sampler.latest if obedience.astray else self._sampler.sample()

    def _hand_over(self, to: Controller) -> None:
        if to is not self._charge:
            self._leg = None
        self._charge = to
        if self._gated:
            # Naming another drops the target on the vehicle. The lease stays as it was: only a renewal renews it.
            self._name()
        elif self._leg is None:
            self._setpoints.stand(to)

    def _renew_lease(self) -> None:
        self._beat([self.id])
        if not self._preparation.ready:
            raise Uncontrolled(self._refusal or f"it is made ready again, and lacks {self._preparation.why_not()}")
        obedience = self._obedience
        if trouble := obedience.astray or obedience.disobeys:
            self._setpoints.stand(self._charge)
            raise Uncontrolled(trouble)
        self._renewed_s = self.clock.now()
        if self._gated:
            self._name()
        self._send_target(self._known())

    def _halt(self) -> None:
        self._leg = None
        self._setpoints.stand(self._charge)

    def _disconnect(self, timeout_s: float) -> None:
        self._leg = None
        vehicle = self._vehicle
        if not self._preparation.taken or vehicle.heartbeat is None:
            return
        kind, sample = vehicle.kind, self._known()
        if self._preparation.ready and vehicle.mode not in (kind.guided, kind.stop):
            # It is its pilot's, or on its own way home.
            return
        if not vehicle.armed:
            vehicle.set_mode(KEEPER, kind.stop)
            return
        lost = sample is None or self.clock.now() - sample.stamp_s > self.stale_after_s
        # A robot that is no longer heard has stopped by itself: wait at most _LOST_S.
        self._repeat(self._stop, self._stands, min(timeout_s, _LOST_S) if lost else timeout_s)
        if self._preparation.armed_it and not kind.flies:
            arm = mav.MAV_CMD_COMPONENT_ARM_DISARM
            self._repeat(lambda: vehicle.command(KEEPER, arm, 0.0), lambda: not vehicle.armed, _LOST_S)
        if self._gated:
            self._authority.release()
        land = kind.land
        if land is not None and self._config.on_close == "land":
            self._repeat(lambda: vehicle.set_mode(KEEPER, land), lambda: vehicle.mode == land, _LOST_S)

    def _prepared(self) -> bool:
        """Return whether the vehicle takes targets; if it does not, go on making it.

        It is made ready again after a reboot, after a silence, in which its own fail-safe may have acted, and after a
        fail-safe whose cause is gone. A mode that changes for no such reason is somebody's will, such as a pilot's, and
        is left alone. So is a vehicle whose EKF begins anew somewhere else, until its origin is known.
        """
        preparation, heard, reboots = self._preparation, self._vehicle.heartbeat is not None, self._time_sync.reboots
        anew = heard and (self._lost or self._obedience.may_be_taken_back or preparation.moved)
        if reboots != self._reboots or (preparation.ready and anew):
            self._reboots = reboots
            preparation.begin()
        self._lost = not heard
        try:
            if self._time_sync.two:
                raise RobotUnavailable("two vehicles with its system id are heard; give each one of its own")
            if not preparation.ready and preparation.step():
                self._adopt()
        except RobotUnavailable as failure:
            raise RobotUnavailable(f"robot {self.id}: {failure}") from failure
        return preparation.ready

    @property
    def _reverses(self) -> bool:
        """Whether it is a rover without a gate that is told which way to drive."""
        return not self._gated and self._vehicle.kind == ARDUROVER and self.declared.reverses

    def _timed(self) -> bool:
        """Return whether its clock is known so well that what it says is not of the future, which nobody believes."""
        sample = self._known()
        return sample is None or sample.stamp_s <= self.clock.now() + FUTURE_S

    def _adopt(self) -> None:
        """Take over what was found out about the vehicle."""
        preparation, kind = self._preparation, self._vehicle.kind
        assert preparation.origin is not None
        plane_m = self._config.height_m if kind.flies else 0.0
        frame = frame_of(self._config.geo_origin, preparation.origin, plane_m, is_px4=kind.is_px4)
        self._sampler.frame = frame
        self._setpoints.begin(frame)
        self._sampler.flies = kind.flies
        self._gated = preparation.gated is True
        self._obedience.begin(preparation.origin, gated=self._gated)
        logger.info(
            "robot %d: a %s is ready; %s", self.id, kind.name,
            "it enforces who is in charge" if self._gated else "its autopilot has no gate, the adapter stands in",
        )  # fmt: skip

    def _beat(self, systems: Iterable[int]) -> None:
        """Send heartbeats, now and then. Called with the lease, and while nothing may move yet."""
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

    def _name(self) -> None:
        """Tell the vehicle who is in charge, and when the lease was renewed last."""
        renewed_s = self._time_sync.to_vehicle_s(self._renewed_s)
        if renewed_s is not None:
            self._authority.name(SENDERS[self._charge], renewed_s)

    def _send_target(self, at: RobotState | None) -> None:
        """Send where to go, or to stand, in the name of the controller in charge."""
        leg = self._leg
        if leg is None or at is None:
            self._setpoints.stand(self._charge)
            return
        target = leg.looking_ahead(at) if self._sampler.flies else leg.target
        if self._gated:
            self._setpoints.go(self._charge, target, at)
            return
        promised, now_s = self.declared, self.clock.now()
        left_s = promised.lease_s - (now_s - self._renewed_s)
        # Where samples wait on the link targets may wait as well, and arrive when nobody stands behind them any more.
        late = now_s - at.stamp_s > promised.sample_age_s + promised.jitter_s + promised.lease_s
        ended = not self._sampler.flies and leg.ended(at, promised.position_noise_m)
        if left_s <= 0.0 or late or ended:
            self._setpoints.stand(self._charge)
            return
        self._setpoints.cap_speed(target.speed_m_s)
        if not self._sampler.flies:
            # It acts on a target half a period late on average, and brakes harder and later than it promises.
            left_s = max(left_s - 0.5 * promised.setpoint_period_s, 0.0)
        ahead_m = reach_m(promised.v_max_m_s, promised.brake_m_s2, left_s)
        if self._reverses:
            self._setpoints.drive_backwards(leg.backwards)
        place = leg._replace(target=target).ahead(at, ahead_m)
        self._setpoints.go_plainly(self._charge, *place, target.heading_rad)

    def _reported(self) -> Controller | None:
        """Return who is in charge, as the vehicle says; None while somebody else has taken it out of GUIDED."""
        if not self._gated or self._vehicle.mode != self._vehicle.kind.guided:
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
            and abs(sample.yaw_rate_rad_s) <= _REST_RAD_S
            and self._vehicle.mode == self._vehicle.kind.stop
        )

    def _repeat(self, ask: Callable[[], None], reached: Callable[[], bool], timeout_s: float) -> None:
        """Ask again and again until something is so, or the time is up."""
        until_s, asked_s = self.clock.steady_s() + timeout_s, -math.inf
        while not reached() and self.clock.steady_s() < until_s:
            if self.clock.steady_s() - asked_s >= _REPEAT_S:
                asked_s = self.clock.steady_s()
                ask()
            self.clock.sleep_until(self.clock.now() + _LOOK_S)
