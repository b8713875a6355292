"""One vehicle's autopilot: boot, modes, arming, and set-points. Its messages are in other modules."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.fence import Fence
from soter_sim.mavlink.flaws import Flaws
from soter_sim.mavlink.frames import Origin, turned, wrapped_rad
from soter_sim.mavlink.guided import Guided
from soter_sim.mavlink.kinds import Kind, Mode
from soter_sim.mavlink.mission import Mission
from soter_sim.mavlink.offboard import Offboard
from soter_sim.mavlink.parameters import Parameters
from soter_sim.mavlink.route import Homing, Landing, Manners, Route, Touring
from soter_sim.mavlink.setpoint import Place, Sample, Setpoint, Vehicle

logger = logging.getLogger(__name__)

# An autopilot that takes 42 s to get ready first sends after 2 s, and has a GPS fix after 11 s.
_HEARD: Final = 2.0 / 42.0
_FIXED: Final = 11.0 / 42.0

_NEEDS_POSITION: Final = frozenset({Mode.GUIDED, Mode.AUTO, Mode.RTL, Mode.LOITER, Mode.BRAKE})
_ON_GROUND_M: Final = 0.02
_LAND_M_S: Final = 0.05
_TEXT: Final = 50
_SAY_AGAIN_S: Final = 1.0
_EKF: Final = "EKF"
_OFFBOARD: Final = "Offboard"
_FIRST_EKF: Final = 3


class Autopilot:
    """An autopilot that behaves as ArduPilot's does.

    Args:
        robot_id: the vehicle's number, which is its system id.
        kind: the kind of vehicle.
        vehicle: the vehicle that it steers.
        origin: the world's geographic origin.
        boot_s: time from power-on until it is ready.
        transmit: broadcasts a message.
        plain: without this simulation's additions to ArduPilot.
        flaws: its flaws, or None.

    Attributes:
        mode: its flight mode.
        armed: whether its motors may turn.
        parameters: its parameters; they outlive a reboot.
        mission: the mission for AUTO; it outlives a reboot.
        fence: the fence that it holds; its items outlive a reboot.
        guided: the authority and the target in GUIDED.
        offboard: whether set-points keep coming, which a PX4 needs in that mode.
        home: where RTL goes to: metres east, north and up; None until it is armed or ready.
        booted_s: the world's time at which its clock began.
        now_s: its own time, since then.
        speed_m_s: the speed that DO_CHANGE_SPEED has set, or None.
        backwards: whether a rover drives to places in GUIDED backwards (DO_SET_REVERSE), until its mode changes.
        reckoning: converts places to its EKF's frame, whose origin, on earth, is where it boots, until another EKF is
            chosen.
        route: the route that it follows by itself, or None.
        failed: the fail-safe that has taken it over, or None.
    """

    def __init__(
        self,
        robot_id: int,
        kind: Kind,
        vehicle: Vehicle,
        origin: Origin,
        boot_s: float,
        transmit: Callable[[mav.MAVLink_message], None],
        *,
        plain: bool = False,
        flaws: Flaws | None = None,
    ) -> None:
        self.id: Final = robot_id
        self.kind: Final = kind
        self.plain: Final = plain
        self._flaws: Final = flaws
        self.origin: Final = origin
        self.parameters: Final = Parameters(kind, robot_id, vehicle.v_max_m_s, plain=plain, flawed=flaws is not None)
        self.mission: Final = Mission()
        self.fence: Final = Fence()
        self._vehicle: Final = vehicle
        self._boot_s: Final = boot_s
        self._transmit: Final = transmit
        self._world_s = 0.0
        self._texts = 0
        self._said, self._said_s = "", 0.0
        self._boot()
        vehicle.steer(self._setpoint)

    def _boot(self) -> None:
        self.booted_s = self._world_s
        self.now_s = 0.0
        self.mode = self.kind.first
        self.armed = False
        self.guided = Guided()
        self.offboard = Offboard()
        self.route: Route | None = None
        self.home: tuple[float, float, float] | None = None
        self.speed_m_s: float | None = None
        self.backwards = False
        self._told_ready = False
        booted_at = self._vehicle.sample()
        self.reckoning = self._first_reckoning = self.origin.reckoning(booted_at.x_m, booted_at.y_m)
        self._ekf = _FIRST_EKF
        self.fence.enabled = bool(self.parameters["FENCE_ENABLE"])
        self.failed: str | None = None
        self._idle_since_s = inf
        self._reboots = False

    # --- state ----------------------------------------------------------------------------------------------

    @property
    def heard(self) -> bool:
        """Whether it has booted far enough to send messages."""
        return self.now_s >= _HEARD * self._boot_s

    @property
    def fixed(self) -> bool:
        """Whether it has a position, though maybe a wrong one."""
        return self.now_s >= _FIXED * self._boot_s

    @property
    def ready(self) -> bool:
        """Whether the EKF is usable."""
        return self.now_s >= self._boot_s and not (self._flaws is not None and self._flaws.lost)

    @property
    def boot_ms(self) -> int:
        """Its time in milliseconds, as in messages."""
        return round(1000.0 * self.now_s)

    @property
    def fix_ms(self) -> int:
        """The time of its last GPS fix."""
        return self.boot_ms if self._flaws is None else round(1000.0 * self._flaws.fix_s)

    @property
    def gps_accuracy_mm(self) -> int:
        """How far off its GPS says that it is; 0 if it does not say."""
        return 0 if self._flaws is None else round(1000.0 * self.parameters["SIM_GPS1_ACC"])

    def sample(self) -> Sample:
        """Return the sensors' readings."""
        true = self._vehicle.sample()
        return true if self._flaws is None else self._flaws.estimated(true)

    def said(self) -> Sample:
        """Return the sensors' readings for messages: from the EKF's origin, along its axes."""
        at, reckoning = self.sample(), self.reckoning
        x_m, y_m = reckoning.local_m(at.x_m, at.y_m)
        north_rad = reckoning.north_rad(at.x_m, at.y_m)
        if not north_rad:
            return at._replace(x_m=x_m, y_m=y_m)
        east_m_s, north_m_s = turned(at.east_m_s, at.north_m_s, -north_rad)
        heading_rad = wrapped_rad(at.heading_rad - north_rad)
        return at._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad, east_m_s=east_m_s, north_m_s=north_m_s)

    @property
    def landed(self) -> bool:
        """Whether it stands on the ground."""
        sample = self.sample()
        return sample.z_m <= _ON_GROUND_M and abs(sample.up_m_s) <= _LAND_M_S

    # --- commands -------------------------------------------------------------------------------------------

    def say(self, severity: int, text: str) -> None:
        """Broadcast a STATUSTEXT; do not repeat the last one at once."""
        if self._said == text and 0.0 <= self.now_s - self._said_s < _SAY_AGAIN_S:
            return
        self._said, self._said_s = text, self.now_s
        parts = [text[begin : begin + _TEXT] for begin in range(0, len(text), _TEXT)]
        if len(parts) > 1:
            self._texts = self._texts % 0xFFFF + 1
        for number, part in enumerate(parts):
            name = self._texts if len(parts) > 1 else 0
            self._transmit(mav.MAVLink_statustext_message(severity, part.encode("ascii", "replace"), name, number))

    def set_mode(self, mode: Mode, reason: str) -> str | None:
        """Change the mode; return the reason if it is refused."""
        if mode is self.mode:
            return None
        refusal = self._mode_refusal(mode)
        if refusal is not None:
            self.say(mav.MAV_SEVERITY_WARNING, f"Mode change to {mode.value} failed: {refusal}")
            return refusal
        logger.info("robot %d: %s -> %s: %s", self.id, self.mode.value, mode.value, reason)
        self.mode = mode
        self.backwards = False
        # A target is not resumed when the mode comes back.
        self.guided.halt()
        self.route = self._make_route(mode)
        return None

    def _mode_refusal(self, mode: Mode) -> str | None:
        if mode in _NEEDS_POSITION and not self.ready:
            return "requires position"
        if mode is Mode.GUIDED and self.kind.is_px4 and not self.offboard.may_begin(self.now_s):
            return "no offboard signal"
        if mode is Mode.AUTO and not self.mission.items:
            return "no mission"
        if mode is Mode.AUTO and self.kind.flies and self.landed and self.armed:
            first = self.mission.item(max(self.mission.current, 1))
            if first is not None and first.command != mav.MAV_CMD_NAV_TAKEOFF:
                return "mission does not begin with a take-off"
        return None

    def _make_route(self, mode: Mode) -> Route | None:
        if mode is Mode.LAND:
            return Landing(self.manners())
        home = self.home or (0.0, 0.0, 0.0)
        if mode is Mode.RTL and self.kind.flies and self.landed:
            return Landing(self.manners())
        if mode is Mode.RTL:
            return Homing(self.kind, home, self.sample(), self.manners())
        if mode is Mode.AUTO:
            self.mission.begin()
            return Touring(self.kind, self.mission, self.origin, home, self.manners, self._reached, self.set_speed)
        return None

    def arm(self) -> str | None:
        """Arm; return the reason if it is refused."""
        if self.armed:
            return None
        refusal = self._arm_refusal()
        if refusal is not None:
            self.say(mav.MAV_SEVERITY_CRITICAL, f"Arm: {refusal}")
            return refusal
        self.armed = True
        self._idle_since_s = self.now_s
        self.guided.halt()
        sample = self.sample()
        self.home = (sample.x_m, sample.y_m, sample.z_m)
        self.say(mav.MAV_SEVERITY_INFO, "Arming motors")
        return None

    def _arm_refusal(self) -> str | None:
        if not self.ready:
            return "EKF attitude is bad" if not self.fixed else "AHRS: waiting for home"
        if self.mode not in self.kind.armable:
            return f"{self.mode.value} mode not armable"
        if self.sample().charge <= 0.0:
            return "Battery 1 is empty"
        return None if self._flaws is None else self._flaws.refuses_to_arm(self.now_s - self._boot_s)

    def disarm(self) -> str | None:
        """Disarm; return the reason if it is refused."""
        if self.armed:
            if self.kind.flies and not self.landed:
                self.say(mav.MAV_SEVERITY_CRITICAL, "Disarm: flying")
                return "flying"
            self.armed = False
            self.guided.halt()
            self.route = self._make_route(self.mode)
            self.say(mav.MAV_SEVERITY_INFO, "Disarming motors")
        return None

    def reboot(self, *, forced: bool = False) -> str | None:
        """Reboot at the next control period, with the clock at 0; return the reason if it is refused.

        An armed vehicle refuses unless it is forced.
        """
        if self.armed and not forced:
            self.say(mav.MAV_SEVERITY_WARNING, "Reboot: armed")
            return "armed"
        # Not at once: the command still has to be acknowledged.
        self._reboots = True
        return None

    def set_speed(self, speed_m_s: float | None) -> None:
        """Set the speed from now on, up to the vehicle's limit; None for the parameter's."""
        self.speed_m_s = speed_m_s
        target = self.guided.target()
        if isinstance(target, Place):
            self.guided.put(replace(target, speed_m_s=self.cruise_m_s), self.now_s)

    @property
    def cruise_m_s(self) -> float:
        """Its speed unless a target has another."""
        if self.speed_m_s is not None:
            return self.speed_m_s
        return self.parameters["WPNAV_SPEED"] / 100.0 if self.kind.flies else self.parameters["WP_SPEED"]

    def manners(self) -> Manners:
        """Return the settings of its routes."""
        parameters = self.parameters
        if not self.kind.flies:
            return Manners(self.cruise_m_s, parameters["WP_RADIUS"], 0.0, 0.0)
        return Manners(
            self.cruise_m_s,
            parameters["WPNAV_RADIUS"] / 100.0,
            parameters["LAND_SPEED"] / 100.0,
            parameters["RTL_ALT"] / 100.0,
        )

    # --- behaviour ------------------------------------------------------------------------------------------

    def tick(self, world_s: float) -> None:
        """Update itself; called after each control period with the world's time."""
        self._world_s = world_s
        if self._reboots:
            self._boot()
        self.now_s = world_s - self.booted_s
        if self._flaws is not None:
            self._look_at_gps(self._flaws)
            self._look_at_ekf()
        if self.ready and not self._told_ready:
            self._told_ready = True
            if self.home is None:
                sample = self.sample()
                self.home = (sample.x_m, sample.y_m, sample.z_m)
            self.say(mav.MAV_SEVERITY_INFO, "EKF3 IMU0 is using GPS")
        if self.kind.is_px4:
            self._look_at_offboard()
        if self.armed and self.kind.flies:
            self._disarm_on_ground()

    def _look_at_offboard(self) -> None:
        lost = self.offboard.lost(self.now_s, self.parameters["COM_OF_LOSS_T"])
        if lost and self.mode is Mode.GUIDED:
            self.failed = _OFFBOARD
            self.say(mav.MAV_SEVERITY_CRITICAL, "Failsafe activated: offboard signal lost")
            self.set_mode(self.kind.stop, "offboard loss")
        elif not lost and self.failed == _OFFBOARD:
            self.failed = None

    def _look_at_gps(self, flaws: Flaws) -> None:
        before = flaws.lost
        flaws.look(self.now_s, has_gps=not self.parameters["SIM_GPS_DISABLE"])
        if flaws.lost and not before:
            self.failed = _EKF
            self.say(mav.MAV_SEVERITY_CRITICAL, "EKF failsafe")
            # These modes need no position; set them before modes that do are refused.
            self.mode = Mode.LAND if self.kind.flies else Mode.HOLD
            self.guided.halt()
            self.route = self._make_route(self.mode)
        elif before and not flaws.lost and self.failed == _EKF:
            self.failed = None

    def _look_at_ekf(self) -> None:
        """Let another EKF, if one was chosen, have its origin where the vehicle is then."""
        chosen = int(self.parameters["AHRS_EKF_TYPE"])
        if chosen != self._ekf:
            self._ekf, at = chosen, self._vehicle.sample()
            first = chosen == _FIRST_EKF
            self.reckoning = self._first_reckoning if first else self.origin.reckoning_from(at.x_m, at.y_m)

    def _disarm_on_ground(self) -> None:
        if not self.landed:
            self._idle_since_s = inf
            return
        if self._idle_since_s == inf:
            self._idle_since_s = self.now_s
        idle_s = self.parameters["DISARM_DELAY"]
        if self.route is not None and self.route.lands:
            if isinstance(self.route, Touring):
                self.route.landed()
            self.disarm()
        elif 0.0 < idle_s <= self.now_s - self._idle_since_s:
            self.disarm()

    def _setpoint(self, world_s: float) -> Setpoint:
        if not self.armed:
            return None
        now_s = world_s - self.booted_s
        if self.mode in (Mode.GUIDED, Mode.LOITER):
            wanted = self.guided.setpoint(now_s) if self.mode is Mode.GUIDED else None
            if self._flaws is not None:
                wanted = self._flaws.steered(wanted, self._vehicle.sample(), self.parameters)
            if self.backwards and isinstance(wanted, Place) and wanted.heading_rad is None:
                wanted = wanted.backwards_from(self._vehicle.sample())
            return wanted
        return None if self.route is None else self.route.setpoint(self.sample(), now_s)

    def _reached(self, seq: int) -> None:
        self._transmit(mav.MAVLink_mission_item_reached_message(seq))
