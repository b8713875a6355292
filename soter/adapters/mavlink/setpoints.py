"""Targets on the wire: SET_POSITION_TARGET_LOCAL_NED in the name of the controller in charge."""

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

# What of the message is to be ignored, as bits.
_ONLY_POSITION: Final = 0x0DF8
_STANDING: Final = 0x05C7
_VELOCITY: Final = 0x0038
_YAW: Final = 0x0400

_NOTHING: Final = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.0)


_KEPT: Final = 64
"""Places that were sent last, by which those of others are told from ours: those of a second or more."""

_SWINGS: Final = 0.08
"""How far an autopilot without a clamp swings beyond the speed that it is asked for, as part of its top speed."""

_SLOWEST_M_S: Final = 0.05
"""ArduRover refuses to go slower, and then goes on as fast as it was told before."""


class Setpoints:
    """Sends targets to one vehicle."""

    def __init__(self, vehicle: Vehicle, v_max_m_s: float) -> None:
        self._vehicle: Final = vehicle
        self._v_max_m_s: Final = v_max_m_s
        self._told: Final[dict[int, tuple[tuple[float, ...], float]]] = {}
        self._sent: Final[deque[tuple[float, float]]] = deque(maxlen=_KEPT)
        self.frame: Frame | EarthFrame = Frame()

    def begin(self, frame: Frame | EarthFrame) -> None:
        """Begin anew with a vehicle that was made ready: it may have forgotten how fast it is to go, and which way."""
        self.frame = frame
        self._told.clear()

    def stand(self, by: Controller) -> None:
        """Tell the vehicle to stop and stay: a velocity of nothing, which every autopilot takes at once.

        Without a yaw rate of nothing beside it, ArduRover takes the direction of that velocity for a heading, and
        pivots to the north.
        """
        self._send(by, _STANDING)

    def go(self, by: Controller, target: Waypoint, at: RobotState | None) -> None:
        """Tell a vehicle that heeds them all where to go, how fast at most, and with which heading to arrive.

        Args:
            by: the controller in charge.
            target: where to.
            at: where it is; None where that is not known, and then it goes as fast as it likes.
        """
        mask, more = _ONLY_POSITION, {}
        if target.heading_rad is not None:
            mask &= ~_YAW
            more["yaw"] = self.frame.to_yaw_rad((target.x_m, target.y_m), target.heading_rad)
        if target.speed_m_s is not None and at is not None:
            # Beside a position, the length of a velocity caps the speed; its direction, that of the way, says nothing.
            cap_m_s = min(target.speed_m_s, self._v_max_m_s)
            course_rad = math.atan2(target.x_m - at.x_m, target.y_m - at.y_m)
            mask &= ~_VELOCITY
            more |= {"vx": cap_m_s * math.cos(course_rad), "vy": cap_m_s * math.sin(course_rad)}
        self._send(by, mask, self._place(target.x_m, target.y_m, target.z_m) | more)

    def go_plainly(self, by: Controller, x_m: float, y_m: float, z_m: float, heading_rad: float | None = None) -> None:
        """Tell any vehicle where to go; ground vehicles ignore a heading."""
        mask, more = _ONLY_POSITION, {}
        if heading_rad is not None:
            mask &= ~_YAW
            more["yaw"] = self.frame.to_yaw_rad((x_m, y_m), heading_rad)
        self._send(by, mask, self._place(x_m, y_m, z_m) | more)

    def go_ned(self, by: Controller, north_m: float, east_m: float, down_m: float) -> None:
        """Tell any vehicle where to go, seen from the origin of its EKF."""
        self._send(by, _ONLY_POSITION, {"x": north_m, "y": east_m, "z": down_m})

    def cap_speed(self, speed_m_s: float | None) -> None:
        """Tell any vehicle how fast to go at most, until told otherwise; None: as fast as it may."""
        most_m_s = self._v_max_m_s if speed_m_s is None else min(speed_m_s, self._v_max_m_s)
        asked_m_s = max(most_m_s - _SWINGS * self._v_max_m_s, 0.5 * most_m_s, _SLOWEST_M_S)
        self._insist(mav.MAV_CMD_DO_CHANGE_SPEED, 1.0, asked_m_s, -1.0)

    def drive_backwards(self, backwards: bool) -> None:
        """Tell a rover to drive to places backwards, or forwards, until told otherwise.

        Where this is lost the rover turns round before it drives: to the same place, on the same way.
        """
        self._insist(mav.MAV_CMD_DO_SET_REVERSE, float(backwards))

    def _insist(self, command: int, *params: float) -> None:
        """Send a command until it is accepted, and anew when it says something else."""
        vehicle = self._vehicle
        told, since_s = self._told.get(command, ((), 0.0))
        if told != params:
            since_s = vehicle.now_s
            self._told[command] = params, since_s
        ack = vehicle.ack(command, since_s)
        if ack is None or not ack.accepted:
            vehicle.command(KEEPER, command, *params)

    def off_m(self, north_m: float, east_m: float) -> float:
        """Return how far a place, seen from the origin of its EKF, is from the nearest of those that were sent last."""
        return min((math.dist((north_m, east_m), each) for each in self._sent), default=math.inf)

    def _place(self, x_m: float, y_m: float, z_m: float) -> dict[str, float]:
        return dict(zip(("x", "y", "z"), self.frame.to_ned(x_m, y_m, z_m), strict=True))

    def _send(self, by: Controller, mask: int, values: dict[str, float] | None = None) -> None:
        if values is not None:
            self._sent.append((values["x"], values["y"]))
        self._vehicle.send(SENDERS[by], "SET_POSITION_TARGET_LOCAL_NED", {
            "time_boot_ms": 0, "target_system": self._vehicle.system, "target_component": AUTOPILOT,
            "coordinate_frame": mav.MAV_FRAME_LOCAL_NED, "type_mask": mask, **_NOTHING,
            # A waypoint may be of any kind of number, a message is of these only.
            **{name: float(value) for name, value in (values or {}).items()},
        })  # fmt: skip
