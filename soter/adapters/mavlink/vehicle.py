"""One vehicle on a link: its latest reports, and commands with their answers."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import radians
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import GeoPoint
from soter.adapters.mavlink.link import AUTOPILOT, Fields, MavlinkLink
from soter.errors import RobotUnavailable

_NAMES: Final = {mav.MAV_TYPE_GROUND_ROVER: "rover", mav.MAV_TYPE_SURFACE_BOAT: "boat"} | dict.fromkeys(
    (
        mav.MAV_TYPE_QUADROTOR, mav.MAV_TYPE_COAXIAL, mav.MAV_TYPE_HELICOPTER, mav.MAV_TYPE_HEXAROTOR,
        mav.MAV_TYPE_OCTOROTOR, mav.MAV_TYPE_TRICOPTER, mav.MAV_TYPE_DODECAROTOR,
    ),
    "copter",
)  # fmt: skip


def px4_mode(main: int, sub: int = 0) -> int:
    """Return PX4's `custom_mode` for a main mode and a sub mode."""
    return main << 16 | sub << 24


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """A kind of vehicle, with its modes.

    One number means different modes on different kinds, and PX4 packs two numbers into one.

    Attributes:
        name: "rover", "copter" or "boat", as in the options.
        autopilot: HEARTBEAT's MAV_AUTOPILOT.
        flies: whether it has to take off first, and has a height.
        guided: the mode in which it takes targets.
        stop: the mode in which it stands, or hovers, whatever came before.
        land: the mode in which it lands; None for ground vehicles.
        names: names of modes, for messages to users.
        brakes: the parameters that limit its braking, with their unit in m/s2; the first of them above 0 counts.
        speeds: the parameters that limit its speed before it is asked for less, with their unit in m/s.
        turns: the parameters that limit its turn rate, with their unit in rad/s; 0 is no limit.
        turn_gain: the parameter that says how fast it turns by how far it has to, in 1/s; empty if there is none.
        drifts: whether wind and water carry it off where it has stopped, as far as its autopilot lets them.
    """

    name: str
    autopilot: int
    flies: bool
    guided: int
    stop: int
    land: int | None
    names: Mapping[int, str]
    brakes: Mapping[str, float] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)
    turns: Mapping[str, float] = field(default_factory=dict)
    turn_gain: str = ""
    drifts: bool = False

    @property
    def is_ardurover(self) -> bool:
        """Whether ArduRover drives it: it is turned by headings, and told which way to drive."""
        return not self.flies and not self.is_px4

    @property
    def is_px4(self) -> bool:
        """Whether modes are packed, and targets are taken only while they keep coming."""
        return self.autopilot == int(mav.MAV_AUTOPILOT_PX4)

    def mode_name(self, mode: int) -> str:
        """Return a mode's name."""
        return self.names.get(mode, f"mode {mode}")

    def mode_params(self, mode: int) -> tuple[float, float, float]:
        """Return the parameters of MAV_CMD_DO_SET_MODE for a mode."""
        flag = float(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
        if self.is_px4:
            return flag, float(mode >> 16 & 0xFF), float(mode >> 24 & 0xFF)
        return flag, float(mode), 0.0


ARDUROVER: Final = VehicleKind(
    "rover", mav.MAV_AUTOPILOT_ARDUPILOTMEGA, flies=False, guided=15, stop=4, land=None,
    names={0: "MANUAL", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", 15: "GUIDED"},
    brakes={"ATC_DECEL_MAX": 1.0, "ATC_ACCEL_MAX": 1.0}, turns={"WP_PIVOT_RATE": radians(1.0)},
    turn_gain="ATC_STR_ANG_P",
)  # fmt: skip
ARDUBOAT: Final = replace(ARDUROVER, name="boat", stop=5, speeds={"WP_SPEED": 1.0}, drifts=True)
"""A boat of ArduRover. HOLD stops its motors; in LOITER it keeps its place, as fast as WP_SPEED."""

ARDUCOPTER: Final = VehicleKind(
    "copter", mav.MAV_AUTOPILOT_ARDUPILOTMEGA, flies=True, guided=4, stop=17, land=9,
    names={0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 9: "LAND", 17: "BRAKE"},
    brakes={"WPNAV_ACCEL": 0.01, "WP_ACC": 1.0}, speeds={"WPNAV_SPEED": 0.01, "WP_SPD": 1.0},
    turns={"ATC_RATE_Y_MAX": radians(1.0)},
)  # fmt: skip
_PX4_NAMES: Final = {
    px4_mode(1): "MANUAL", px4_mode(3): "POSCTL", px4_mode(4, 3): "HOLD", px4_mode(4, 4): "MISSION",
    px4_mode(4, 5): "RETURN", px4_mode(4, 6): "LAND", px4_mode(6): "OFFBOARD",
}  # fmt: skip
_PX4_ROVER: Final = VehicleKind(
    "rover", mav.MAV_AUTOPILOT_PX4, flies=False, guided=px4_mode(6), stop=px4_mode(4, 3), land=None, names=_PX4_NAMES
)
_PX4_COPTER: Final = VehicleKind(
    "copter", mav.MAV_AUTOPILOT_PX4, flies=True, guided=px4_mode(6), stop=px4_mode(4, 3), land=px4_mode(4, 6),
    names=_PX4_NAMES,
)  # fmt: skip
_KINDS: Final = {
    (kind.name, kind.autopilot): kind for kind in (ARDUROVER, ARDUBOAT, ARDUCOPTER, _PX4_ROVER, _PX4_COPTER)
}  # fmt: skip


def kind_of(vehicle_type: int, autopilot: int) -> VehicleKind:
    """Return the kind of vehicle for a HEARTBEAT's type and autopilot.

    Raises:
        RobotUnavailable: this adapter cannot command such a vehicle.
    """
    name = _NAMES.get(vehicle_type, "")
    kind = _KINDS.get((name, autopilot))
    if kind is None and name == ARDUBOAT.name:
        raise RobotUnavailable(
            "it is a boat, which drifts where it has stopped: neither its safe controllers nor the end of its lease "
            "would hold it; this adapter commands rovers and multicopters, and boats with ArduPilot, which holds them"
        )
    if kind is None:
        raise RobotUnavailable(
            f"it is a vehicle of MAV_TYPE {vehicle_type} with MAV_AUTOPILOT {autopilot}; this adapter commands rovers "
            "and multicopters with ArduPilot or PX4"
        )
    return kind


_SAID_KEPT: Final = 6
_WORST_SEVERITY: Final = mav.MAV_SEVERITY_WARNING
_FRESH_S: Final = 3.0

EVERYBODY: Final = 0
"""The system id of messages to all."""

RETRY_S: Final = 0.4
"""Time after which an unanswered request is repeated."""

_UNREADY_EKF: Final = mav.EKF_CONST_POS_MODE | mav.EKF_UNINITIALIZED
_READY_EKF: Final = (
    mav.EKF_ATTITUDE | mav.EKF_VELOCITY_HORIZ | mav.EKF_VELOCITY_VERT | mav.EKF_POS_HORIZ_REL | mav.EKF_POS_HORIZ_ABS
    | mav.EKF_POS_VERT_ABS | mav.EKF_PRED_POS_HORIZ_REL | mav.EKF_PRED_POS_HORIZ_ABS
)  # fmt: skip
"""831: all flags that navigation needs. The first position comes long before, and may be far off."""

_RESULTS: Final = {value: entry.name.removeprefix("MAV_RESULT_") for value, entry in mav.enums["MAV_RESULT"].items()}


def place_of(origin: Any) -> GeoPoint:
    """Return the place in a GPS_GLOBAL_ORIGIN."""
    return GeoPoint(origin.latitude * 1e-7, origin.longitude * 1e-7, origin.altitude * 1e-3)


class Ack(NamedTuple):
    """An answer to a command: a MAV_RESULT, and the steady time at which it came."""

    result: int
    received_s: float

    @property
    def accepted(self) -> bool:
        """Whether the vehicle carries the command out."""
        return self.result in (mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_IN_PROGRESS)

    @property
    def name(self) -> str:
        """The result as MAVLink calls it."""
        return _RESULTS.get(self.result, f"result {self.result}")


class Vehicle:
    """One vehicle. The receiving thread calls the hooks; all else belongs to the supervisor's thread.

    Attributes:
        parameters: by name, the latest reported values of the parameters that were asked for or set here.
    """

    def __init__(self, link: MavlinkLink, system: int) -> None:
        self.link: Final = link
        self.system: Final = system
        self.inbox: Final = link.inboxes[system]
        self._acks: Final[dict[int, Ack]] = {}
        self._said: Final[deque[tuple[float, str]]] = deque(maxlen=_SAID_KEPT)
        self._kind: VehicleKind | None = None
        self.parameters: Final[dict[str, float]] = {}
        self._wanted: Final[set[str]] = set()
        self.inbox.hooks["COMMAND_ACK"] = self._hear_ack
        self.inbox.hooks["PARAM_VALUE"] = self._hear_parameter
        self.inbox.hooks["STATUSTEXT"] = self._hear_text

    # --- the receiving thread ------------------------------------------------------------------------------

    def _hear_ack(self, message: Any, received_s: float) -> None:
        # Answers to other ground stations may come over the same link.
        if message.target_system in (EVERYBODY, self.link.system):
            self._acks[message.command] = Ack(message.result, received_s)

    def _hear_parameter(self, message: Any, _received_s: float) -> None:
        # If another ground station reads all parameters, there are more than a thousand.
        name = message.param_id.rstrip("\0")
        if name in self._wanted:
            self.parameters[name] = message.param_value

    def _hear_text(self, message: Any, received_s: float) -> None:
        if message.severity <= _WORST_SEVERITY:
            text = message.text
            plain = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            # The text is shown on terminals, and must hold no control characters.
            self._said.append((received_s, re.sub(r"[^ -~]", "?", plain)))

    # --- what is known -------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Steady time."""
        return self.link.clock.steady_s()

    def heard_since(self, name: str, since_s: float) -> Any | None:
        """Return the latest message of a kind if it was received at or after a steady time, else None."""
        heard = self.inbox.latest.get(name)
        return heard.message if heard is not None and heard.received_s >= since_s else None

    @property
    def heartbeat(self) -> Any | None:
        """The latest HEARTBEAT; None if it is too old."""
        return self.heard_since("HEARTBEAT", self.now_s - _FRESH_S)

    @property
    def kind(self) -> VehicleKind:
        """The kind of vehicle, by its HEARTBEAT, which must have been heard.

        Raises:
            RobotUnavailable: this adapter cannot command such a vehicle.
        """
        if self._kind is None:
            heartbeat = self.inbox.latest["HEARTBEAT"].message
            self._kind = kind_of(heartbeat.type, heartbeat.autopilot)
        return self._kind

    @property
    def mode(self) -> int | None:
        """The mode in the latest HEARTBEAT; None while the vehicle is not heard."""
        heartbeat = self.heartbeat
        return None if heartbeat is None else int(heartbeat.custom_mode)

    @property
    def armed(self) -> bool:
        """Whether the motors may turn, by the latest HEARTBEAT."""
        heartbeat = self.heartbeat
        return heartbeat is not None and bool(heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)

    def ekf_report(self, since_s: float) -> Any | None:
        """Return the EKF's latest status since a steady time; None without one."""
        return self.heard_since("EKF_STATUS_REPORT", since_s) or self.heard_since("ESTIMATOR_STATUS", since_s)

    def ekf_ready(self, since_s: float) -> bool:
        """Return whether the EKF's position can be trusted, by its status since a steady time."""
        report = self.ekf_report(since_s)
        if report is None:
            return False
        # A PX4 that stands on the ground says that its position is constant, too, with all other flags set.
        unready = mav.ESTIMATOR_GPS_GLITCH if self.kind.is_px4 else _UNREADY_EKF
        return report.flags & _READY_EKF == _READY_EKF and not report.flags & unready

    def ack(self, command: int, since_s: float) -> Ack | None:
        """Return the latest answer to a command if it came at or after a steady time, else None."""
        ack = self._acks.get(command)
        return ack if ack is not None and ack.received_s >= since_s else None

    def complaints(self, since_s: float) -> str:
        """Return the autopilot's warnings since a steady time, each once; empty without any."""
        return "; ".join(dict.fromkeys(text for at_s, text in tuple(self._said) if at_s >= since_s))

    # --- what it is told -----------------------------------------------------------------------------------

    def send(self, component: int, name: str, fields: Fields) -> None:
        """Send a message as one of our components."""
        self.link.send(self.system, component, name, fields)

    def command(self, component: int, command: int, *params: float) -> None:
        """Send a command, always to this vehicle's autopilot: every vehicle would execute a broadcast."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.send(component, "COMMAND_LONG", {
            "target_system": self.system, "target_component": AUTOPILOT, "command": command, "confirmation": 0,
            **{f"param{number}": value for number, value in enumerate(values, start=1)},
        })  # fmt: skip

    def ask_for(self, component: int, message_id: int, hz: float) -> None:
        """Ask for a message at a rate in Hz."""
        self.command(component, mav.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / hz)

    def ask_once(self, component: int, message_id: int) -> None:
        """Ask for a message once."""
        self.command(component, mav.MAV_CMD_REQUEST_MESSAGE, float(message_id))

    def ask_parameter(self, component: int, name: str) -> None:
        """Ask for a parameter's value."""
        self._wanted.add(name)
        self.send(component, "PARAM_REQUEST_READ", {
            "target_system": self.system, "target_component": AUTOPILOT, "param_id": name, "param_index": -1,
        })  # fmt: skip

    def set_parameter(self, component: int, name: str, value: int) -> None:
        """Set a parameter that is a whole number."""
        self._wanted.add(name)
        self.send(component, "PARAM_SET", {
            "target_system": self.system, "target_component": AUTOPILOT, "param_id": name,
            "param_value": float(value), "param_type": mav.MAV_PARAM_TYPE_INT32,
        })  # fmt: skip

    def set_mode(self, component: int, mode: int) -> None:
        """Ask for a mode."""
        self.command(component, mav.MAV_CMD_DO_SET_MODE, *self.kind.mode_params(mode))
