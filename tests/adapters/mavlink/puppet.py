"""A vehicle of strings for tests without a wire: it answers as an autopilot does, and remembers what it was told."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.link import Fields, Inbox, MavlinkLink
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.robot import MavlinkRobot
from soter.clock import VehicleClock
from soter.errors import Uncontrolled
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import RobotSpec, Waypoint

ROOM = Workspace(4.0, 4.0, (), (RobotPlace(1, 1.0, 1.0, Box(0.9, 0.9, 1.1, 1.1)),))
FAR = Waypoint(3.0, 0.0)
STANDS = 0x05C7
OURS = 255
ROVER_GUIDED = 15
ROVER_HOLD = 4
ARMED = mav.MAV_MODE_FLAG_SAFETY_ARMED


class HostTime:
    """Steady time that a test moves."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds
        self.slept(seconds)

    def slept(self, seconds: float) -> None:
        """To be replaced by what happens while somebody sleeps."""


class Puppet(MavlinkLink):
    """A link with one vehicle on it, whose clock was 1000 s ahead of the host's when it began."""

    def __init__(self, time: HostTime, system: int = 1) -> None:
        super().__init__(VehicleClock(steady=time, sleep=time.sleep), OURS)
        self.time = time
        time.slept = self.speak  # type: ignore[method-assign]
        self.vehicle = system
        self.inboxes[system] = Inbox()
        self.sent: list[tuple[int, str, dict[str, Any]]] = []
        self.kind = (mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
        self.mode, self.armed, self.ekf = 0, False, 831
        self.status = mav.MAV_STATE_ACTIVE
        self.fix = mav.GPS_FIX_TYPE_3D_FIX
        self.finds = self.tells_ekf = True
        self.fixed_s = 0.0
        self.times_fixes = True
        self.accuracy_mm = 300
        self.variance = self.compass = 0.01
        self.origin_lat = 473977420
        self.place_e7 = 0, 0
        self.gate = True
        self.most_hz = 50.0
        self.refuses_to_arm = ""
        self.aloft = False
        self.deaf_to: set[int] = set()
        self.silent = False
        self.answers_time = True
        self.answered_late_s = 0.0
        self.streams: dict[int, float] = {}
        self.parameters: dict[str, float] = {}
        self.master = 0
        self.x_m = self.y_m = self.up_m = self.speed_m_s = 0.0
        self.yaw_rad, self.yaw_rate_rad_s = 0.5 * math.pi, 0.0
        self.clock_s = 1000.0
        self.percent = 80

    # --- what the link does --------------------------------------------------------------------------------

    def start(self) -> None:
        """There is nothing to open."""

    def beat(self, system: int) -> None:
        self.sent.append((0, "HEARTBEAT", {}))

    def close(self) -> None:
        """There is nothing to close."""

    def _send(self, system: int, component: int, name: str, fields: Fields) -> None:
        self.sent.append((component, name, dict(fields)))
        if self.silent:
            return
        if name in ("COMMAND_LONG", "COMMAND_INT"):
            result = self._obey(component, dict(fields))
            self.say("COMMAND_ACK", command=fields["command"], result=result, target_system=OURS)
        elif name.startswith("SET_POSITION") and self.armed and not fields["type_mask"] & 7:
            self.up_m = -fields["z"]
        elif name == "TIMESYNC" and self.answers_time:
            self.say("TIMESYNC", tc1=int((self.clock_s - self.answered_late_s) * 1e9), ts1=fields["ts1"])
        elif name == "PARAM_REQUEST_READ" and fields["param_id"] in self.parameters:
            name = fields["param_id"]
            self.say("PARAM_VALUE", param_id=name, param_value=self.parameters[name])
        elif name == "PARAM_SET" and self.gate:
            self.parameters[fields["param_id"]] = fields["param_value"]
            self.say("PARAM_VALUE", param_id=fields["param_id"], param_value=fields["param_value"])

    # --- what the vehicle does -----------------------------------------------------------------------------

    def say(self, message: str, /, **fields: Any) -> None:
        """Let the vehicle say something."""
        self.inboxes[self.vehicle].put(message, SimpleNamespace(**fields), self.time())

    def live(self, seconds: float = 0.02) -> None:
        """Let time pass, and the vehicle say all that it says."""
        self.time.now_s += seconds
        self.speak(seconds)

    def speak(self, seconds: float) -> None:
        """Let the vehicle say all that it says after some time that has passed."""
        self.clock_s += seconds
        if self.silent:
            return
        stamp = {"time_boot_ms": round(self.clock_s * 1e3)}
        self.say(
            "HEARTBEAT", type=self.kind[0], autopilot=self.kind[1], base_mode=ARMED * self.armed, custom_mode=self.mode,
            system_status=self.status,
        )  # fmt: skip
        self.say("LOCAL_POSITION_NED", **stamp, x=self.y_m, y=self.x_m, z=-self.up_m, vx=self.speed_m_s, vy=0.0, vz=0.0)
        self.say("ATTITUDE", **stamp, yaw=self.yaw_rad, yawspeed=self.yaw_rate_rad_s)
        self.say("SYS_STATUS", battery_remaining=self.percent, voltage_battery=11_000)
        if not self.tells_ekf:
            pass
        elif self.kind[1] == mav.MAV_AUTOPILOT_PX4:
            self.say("ESTIMATOR_STATUS", flags=self.ekf, pos_horiz_ratio=self.variance, mag_ratio=self.compass)
        else:
            self.say("EKF_STATUS_REPORT", flags=self.ekf, pos_horiz_variance=self.variance)
        if self.finds:
            self.fixed_s = self.clock_s
        if self.finds or self.times_fixes:
            time_usec = int(self.fixed_s * 1e6) * self.times_fixes
            self.say("GPS_RAW_INT", fix_type=self.fix, time_usec=time_usec, h_acc=self.accuracy_mm)
        if self.gate:
            self.say("NAMED_VALUE_INT", name="GMASTER", value=256 * OURS + self.master, **stamp)

    def reboot(self) -> None:
        """Begin anew, with everything forgotten."""
        self.clock_s = 0.5
        self.mode, self.armed, self.master, self.streams = 0, False, 0, {}

    def tell_origin(self) -> None:
        """Let the vehicle say where its EKF has its origin."""
        self.say("GPS_GLOBAL_ORIGIN", latitude=self.origin_lat, longitude=85455940, altitude=488_000)

    def targets(self) -> list[tuple[int, dict[str, Any]]]:
        """Return the targets that it was sent, with who sent them."""
        return [(component, fields) for component, name, fields in self.sent if name.startswith("SET_POSITION")]

    def commands(self, number: int) -> list[dict[str, Any]]:
        """Return the commands of a kind that it was sent."""
        return [fields for _, name, fields in self.sent if name.startswith("COMMAND") and fields["command"] == number]

    def _obey(self, component: int, fields: dict[str, Any]) -> int:
        number = fields["command"]
        if number in self.deaf_to:
            return int(mav.MAV_RESULT_TEMPORARILY_REJECTED)
        if number == mav.MAV_CMD_SET_MESSAGE_INTERVAL:
            hz = 1e6 / fields["param2"]
            if hz > self.most_hz + 1e-6:
                return int(mav.MAV_RESULT_DENIED)
            self.streams[int(fields["param1"])] = hz
        elif number == mav.MAV_CMD_REQUEST_MESSAGE and fields["param1"] == mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN:
            self.tell_origin()
        elif number == mav.MAV_CMD_REQUEST_MESSAGE and fields["param1"] == mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT:
            lat_e7, lon_e7 = self.place_e7
            self.say("GLOBAL_POSITION_INT", time_boot_ms=round(self.clock_s * 1e3), lat=lat_e7, lon=lon_e7)
        elif number == mav.MAV_CMD_DO_SET_MODE:
            px4 = self.kind[1] == mav.MAV_AUTOPILOT_PX4
            self.mode = int(fields["param2"]) << 16 | int(fields["param3"]) << 24 if px4 else int(fields["param2"])
        elif number == mav.MAV_CMD_COMPONENT_ARM_DISARM:
            if self.refuses_to_arm and fields["param1"]:
                self.say("STATUSTEXT", severity=mav.MAV_SEVERITY_CRITICAL, text=self.refuses_to_arm)
                return int(mav.MAV_RESULT_FAILED)
            self.armed = bool(fields["param1"])
        elif number == mav.MAV_CMD_NAV_TAKEOFF:
            if self.aloft:
                return int(mav.MAV_RESULT_FAILED)
            self.up_m = fields["param7"]
        elif number == mav.MAV_CMD_DO_GUIDED_MASTER:
            if not self.gate:
                return int(mav.MAV_RESULT_UNSUPPORTED)
            self.master = int(fields["param2"])
        return int(mav.MAV_RESULT_ACCEPTED)


def robot_of(puppet: Puppet, **options: object) -> MavlinkRobot:
    assert isinstance(puppet.clock, VehicleClock)
    config = MavlinkConfig.model_validate({"workspace": ROOM, **options})
    spec = RobotSpec(1, 0.0, 0.0, 0.0, promised=replace(config.promised(), **config.promise.given))
    return MavlinkRobot(spec, puppet.clock, puppet, config)


def ready(puppet: Puppet, **options: object) -> MavlinkRobot:
    robot = robot_of(puppet, **options)
    robot.init(20.0)
    puppet.sent.clear()
    return robot


def tick(puppet: Puppet, robot: MavlinkRobot, times: int = 1) -> list[str]:
    """Tick as a supervisor does; return what the vehicle did instead of what it was told, a text for each tick."""
    disobeyed = []
    for _ in range(times):
        puppet.live(0.025)
        puppet.live(0.025)
        robot.read_state()
        try:
            robot.renew_lease()
        except Uncontrolled as failure:
            disobeyed.append(str(failure))
    return disobeyed
