"""A boat with a motor on either side in a current: `python -m tests.autopilot.boat PORT EAST_M_S NORTH_M_S YAW_RAD`.

It is the physics of an ArduPilot with `--model JSON`, which sends what its motors are to do to PORT, and takes a state
of the boat for each. ArduPilot's own motorboats turn only as fast as they move, and not in place.

The current carries the boat once its motors are on: with MOT_SAFE_DISARM 1 they are off until it is armed.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
from math import cos, sin
from typing import Final

_SERVOS: Final = struct.Struct("<HHI16H")
_G_M_S2: Final = 9.80665
_LEAST_HZ: Final = 50

# Of a boat of 20 kg and 1 m, which does 2 m/s and 2.5 rad/s.
_THRUST_M_S2: Final = 3.0
_DRAG_PER_M: Final = 0.6
_DRAG_PER_S: Final = 0.3
_ASIDE_PER_S: Final = 1.5
_TURN_RAD_S2: Final = 5.0
_TURN_PER_S: Final = 2.0


class Boat:
    """Where a boat is, and how it moves: metres north and east, radians clockwise from north.

    Args:
        current_m_s: how fast the water moves, north and east.
        yaw_rad: where its bow points.
    """

    def __init__(self, current_m_s: tuple[float, float], yaw_rad: float) -> None:
        self._current_m_s: Final = current_m_s
        self._afloat = False
        self._yaw_rad, self._yaw_rate_rad_s = yaw_rad, 0.0
        self._ahead_m_s = self._aside_m_s = self._now_s = 0.0
        self._at = [0.0, 0.0]
        self._v = self._over_ground()

    def _over_ground(self) -> tuple[float, float]:
        c, s = cos(self._yaw_rad), sin(self._yaw_rad)
        north, east = self._current_m_s if self._afloat else (0.0, 0.0)
        u, v = self._ahead_m_s, self._aside_m_s
        return u * c - v * s + north, u * s + v * c + east

    def step(self, left: float, right: float, dt_s: float, *, on: bool) -> bytes:
        """Move on for a time with the motors' thrusts, each from -1 to 1; return the state as ArduPilot takes it."""
        self._afloat = self._afloat or on
        u, v, r = self._ahead_m_s, self._aside_m_s, self._yaw_rate_rad_s
        drag_m_s2 = (_DRAG_PER_M * abs(u) + _DRAG_PER_S) * u
        self._ahead_m_s += dt_s * (0.5 * _THRUST_M_S2 * (left + right) - drag_m_s2 + r * v)
        self._aside_m_s -= dt_s * (_ASIDE_PER_S * v + r * u)
        self._yaw_rate_rad_s += dt_s * (0.5 * _TURN_RAD_S2 * (left - right) - _TURN_PER_S * r)
        self._yaw_rad += dt_s * self._yaw_rate_rad_s
        before, self._v = self._v, self._over_ground()
        north_m_s2, east_m_s2 = ((new - old) / dt_s for new, old in zip(self._v, before, strict=True))
        self._at = [at + dt_s * each for at, each in zip(self._at, self._v, strict=True)]
        self._now_s += dt_s
        c, s = cos(self._yaw_rad), sin(self._yaw_rad)
        state = {
            "timestamp": self._now_s,
            "imu": {
                "gyro": [0.0, 0.0, self._yaw_rate_rad_s],
                "accel_body": [north_m_s2 * c + east_m_s2 * s, east_m_s2 * c - north_m_s2 * s, -_G_M_S2],
            },
            "position": [*self._at, 0.0], "attitude": [0.0, 0.0, self._yaw_rad], "velocity": [*self._v, 0.0],
        }  # fmt: skip
        return f"\n{json.dumps(state)}\n".encode()


def main() -> None:
    """Answer until the process is ended."""
    port, east_m_s, north_m_s, yaw_rad = (float(each) for each in sys.argv[1:])
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", int(port)))
    boat, last = Boat((north_m_s, east_m_s), yaw_rad), -1
    while True:
        packet, peer = opened.recvfrom(4096)
        _, hz, count, *pwm = _SERVOS.unpack(packet[: _SERVOS.size])
        if count < last:
            # Its autopilot was started anew, where it was at first.
            boat = Boat((north_m_s, east_m_s), yaw_rad)
        last = count
        left, right = ((each - 1500) / 500.0 if each else 0.0 for each in (pwm[0], pwm[2]))
        opened.sendto(boat.step(left, right, 1.0 / max(hz, _LEAST_HZ), on=bool(pwm[0])), peer)


if __name__ == "__main__":
    main()
