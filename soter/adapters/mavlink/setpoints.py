"""Sends targets: SET_POSITION_TARGET_LOCAL_NED from the component of the active controller."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import KEEPER, SENDERS
from soter.adapters.mavlink.frames import EarthFrame, Frame
from soter.adapters.mavlink.link import AUTOPILOT
from soter.adapters.mavlink.vehicle import Vehicle
from soter.sdk import Controller, RobotState, Waypoint

# Bits of the fields that the vehicle is to ignore.
_ONLY_POSITION: Final = 0x0DF8
_STANDING: Final = 0x05C7
_STANDING_THERE: Final = 0x05F8
_TURNING: Final = 0x09FF
_VELOCITY: Final = 0x0038
_YAW: Final = 0x0400

_NOTHING: Final = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)


_KEPT: Final = 64
"""How many sent places are kept, to tell others' targets from ours: those of a second or more."""

_SWINGS: Final = 0.08
"""How far an autopilot without a clamp overshoots the requested speed, as a part of its top speed."""

_ASKED: Final = 0.8
"""The least part of a speed limit that is asked for: slow vehicles swing less."""

_SLOWEST_M_S: Final = 0.05
"""ArduRover refuses a lower speed, and then goes on at the speed that it was sent before."""


class Setpoints:
    """Sends targets to one vehicle."""

    def __init__(self, vehicle: Vehicle, v_max_m_s: float) -> None:
        self._vehicle: Final = vehicle
        self._v_max_m_s: Final = v_max_m_s
        self._told: Final[dict[int, tuple[tuple[float, ...], float]]] = {}
        self._sent: Final[deque[tuple[float, float]]] = deque(maxlen=_KEPT)
        self.frame: Frame | EarthFrame = Frame()

    def begin(self, frame: Frame | EarthFrame) -> None:
        """Begin anew with a vehicle that was made ready: it may have forgotten its speed limit and direction."""
        self.frame = frame
        self._told.clear()

    def stand(self, by: Controller) -> None:
        """Tell the vehicle to stop and stay, by a velocity of zero, which every autopilot obeys at once.

        Without a yaw rate of zero beside it, ArduRover takes the direction of that velocity for a heading, and pivots
        to the north. A copter that is sent a place afterwards has forgotten its speed limit.
        """
        self._told.pop(mav.MAV_CMD_DO_CHANGE_SPEED, None)
        self._send(by, _STANDING)

    def stand_at(self, by: Controller, x_m: float, y_m: float, z_m: float) -> None:
        """Tell a copter to stop at a place where it can, and to turn no further."""
        self._send(by, _STANDING_THERE, self._place(x_m, y_m, z_m))

    def turn(self, by: Controller, x_m: float, y_m: float, heading_rad: float) -> None:
        """Tell an ArduRover, which is at a place, to stop and turn to a heading."""
        self._send(by, _TURNING, {"yaw": self.frame.to_yaw_rad((x_m, y_m), heading_rad)})

    def go(self, by: Controller, target: Waypoint, at: RobotState | None) -> None:
        """Send a target with its speed limit and heading to a vehicle that heeds all three.

        Args:
            by: the active controller.
            target: the place, and speed and heading if they matter.
            at: where the vehicle is; None if not known, and then no speed limit is sent.
        """
        mask, more = _ONLY_POSITION, {}
        if target.heading_rad is not None:
            mask &= ~_YAW
            more["yaw"] = self.frame.to_yaw_rad((target.x_m, target.y_m), target.heading_rad)
        if target.speed_m_s is not None and at is not None:
            # Beside a position, the length of a velocity caps the speed; its direction has no meaning.
            cap_m_s = min(target.speed_m_s, self._v_max_m_s)
            course_rad = math.atan2(target.x_m - at.x_m, target.y_m - at.y_m)
            mask &= ~_VELOCITY
            more |= {"vx": cap_m_s * math.cos(course_rad), "vy": cap_m_s * math.sin(course_rad)}
        self._send(by, mask, self._place(target.x_m, target.y_m, target.z_m) | more)

    def go_plainly(self, by: Controller, x_m: float, y_m: float, z_m: float, heading_rad: float | None = None) -> None:
        """Send a target to any vehicle; ground vehicles ignore a heading."""
        mask, more = _ONLY_POSITION, {}
        if heading_rad is not None:
            mask &= ~_YAW
            more["yaw"] = self.frame.to_yaw_rad((x_m, y_m), heading_rad)
        self._send(by, mask, self._place(x_m, y_m, z_m) | more)

    def go_ned(self, by: Controller, north_m: float, east_m: float, down_m: float) -> None:
        """Send a target to any vehicle, in metres from the origin of its EKF."""
        self._send(by, _ONLY_POSITION, {"x": north_m, "y": east_m, "z": down_m})

    def cap_speed(self, speed_m_s: float | None) -> None:
        """Limit any vehicle's speed until the next call; None stands for its top speed."""
        most_m_s = self._v_max_m_s if speed_m_s is None else min(speed_m_s, self._v_max_m_s)
        asked_m_s = max(most_m_s - _SWINGS * self._v_max_m_s, _ASKED * most_m_s, _SLOWEST_M_S)
        self._resend(mav.MAV_CMD_DO_CHANGE_SPEED, 1.0, asked_m_s, -1.0)

    def drive_backwards(self, backwards: bool) -> None:
        """Tell a rover to drive to places backwards, or forwards, until the next call.

        If this command is lost the rover turns round first, and drives to the same place on the same path.
        """
        self._resend(mav.MAV_CMD_DO_SET_REVERSE, float(backwards))

    def _resend(self, command: int, *params: float) -> None:
        """Send a command at every call until it is accepted; new parameters begin anew."""
        vehicle = self._vehicle
        told, since_s = self._told.get(command, ((), 0.0))
        if told != params:
            since_s = vehicle.now_s
            self._told[command] = params, since_s
        ack = vehicle.ack(command, since_s)
        if ack is None or not ack.accepted:
            vehicle.command(KEEPER, command, *params)

    def off_m(self, north_m: float, east_m: float) -> float:
        """Return the distance of a place, in metres from the EKF's origin, to the nearest of the places sent last."""
        return min((math.dist((north_m, east_m), each) for each in self._sent), default=math.inf)

    def count(self, x_m: float, y_m: float, z_m: float) -> None:
        """Count a place as one that was sent."""
        north_m, east_m, _ = self.frame.to_ned(x_m, y_m, z_m)
        self._sent.append((north_m, east_m))

    def _place(self, x_m: float, y_m: float, z_m: float) -> dict[str, float]:
        return dict(zip(("x", "y", "z"), self.frame.to_ned(x_m, y_m, z_m), strict=True))

    def _send(self, by: Controller, mask: int, values: dict[str, float] | None = None) -> None:
        if values is not None and "x" in values:
            self._sent.append((values["x"], values["y"]))
        self._vehicle.send(SENDERS[by], "SET_POSITION_TARGET_LOCAL_NED", {
            "time_boot_ms": 0, "target_system": self._vehicle.system, "target_component": AUTOPILOT,
            "coordinate_frame": mav.MAV_FRAME_LOCAL_NED, "type_mask": mask, **_NOTHING,
            # A waypoint may hold numbers of any class, a message only floats.
            **{name: float(value) for name, value in (values or {}).items()},
        })  # fmt: skip
