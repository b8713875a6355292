"""Real ArduPilots in their own simulator, on this host, and a witness of where they really are.

The witness hears SIM_STATE on a serial port of its own, which SOTER does not listen to, and judges it by the rules of
the simulated world. It tells what it finds as `soter_sim.truth_server` does, so that `truth = "host:port"` reads it.

SIM_STATE says places in whole 1e-7 degrees, which are 11 mm, forty times a second, and speeds to the last digit. By
these the witness knows where in such a cell a vehicle is, and where it is in between.
"""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from math import atan2, cos, degrees, hypot, radians, remainder
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.frames import GeoPoint, local_m, turned_rad
from soter.adapters.mavlink.simulator import free_port
from soter.geometry.earth import Projection
from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.sdk import RobotSpec, RuleLimits
from soter_sim.bodies import Bodies
from soter_sim.judge import Judge
from soter_sim.truth import WorldTruth
from soter_sim.truth_server import TruthServer
from tests.autopilot import boat

ORIGIN: Final = GeoPoint(47.397742, 8.545594, 488.0)
_STEP_S: Final = 0.02
# ArduRover 4.7 denies more than 0.8 of the 50 Hz of its loop.
_HZ: Final = 40.0
_M_PER_DEG: Final = 111_318.84502145034
_GOES_ON_S: Final = 2.0 / _HZ
"""A vehicle that says nothing more has moved on for no longer than this."""


class _Told(NamedTuple):
    """What a SIM_STATE told: when, by `time.perf_counter()`, where the vehicle was, and how fast."""

    at_s: float
    x_m: float
    y_m: float
    vx_m_s: float
    vy_m_s: float

    def after(self, now_s: float) -> tuple[float, float]:
        """Return where it is later."""
        since_s = min(now_s - self.at_s, _GOES_ON_S)
        return self.x_m + since_s * self.vx_m_s, self.y_m + since_s * self.vy_m_s


class _World:
    """What a `TruthServer` tells of."""

    def __init__(self, workspace: Workspace, robots: Sequence[RobotSpec], v_max_m_s: float, limits: RuleLimits) -> None:
        self.bodies: Final = Bodies(robots)
        self._judge: Final = Judge(workspace, self.bodies, _STEP_S, v_max_m_s, limits)
        self.truth: Final = WorldTruth(self._judge.record, self.bodies)
        self._step = 0

    @property
    def now_s(self) -> float:
        """Time of the last step."""
        return self._step * _STEP_S

    def move(self, x_m: list[float], y_m: list[float]) -> None:
        """Judge a step, and take it."""
        self._judge.look(self._step, x_m, y_m)
        self.bodies.x[:], self.bodies.y[:] = x_m, y_m
        self._step += 1


class _Server(TruthServer):
    """Tells nothing of charges, of which SIM_STATE says nothing."""

    def _told(self) -> dict[str, Any]:
        return {name: what for name, what in super()._told().items() if name != "charges"}


class Autopilots:
    """One ArduPilot a robot, each with the truth of its own simulator.

    Args:
        program: an ArduPilot built for SITL.
        folder: where each may write.
        workspace: whose origin is `ORIGIN`, or one with places on earth.
        robots: which, and where; ids are system ids.
        model: of the simulator, such as "rover-skid".
        parameters: what differs from the defaults of the program.
        limits: what the mission promises.
        fastest_m_s: no vehicle is faster.
        current_m_s: east and north, of the water that boats are in, with `tests.autopilot.boat` for physics; None for
            vehicles of its own simulator.

    Attributes:
        port: to which they send, over UDP.
        truth: where the witness tells what really happens, as host:port.
        processes: one a robot.
        seen: by robot, the last pose and speed: x_m, y_m, heading_rad, v_m_s.
        paths: by robot, all of them: `time.time()` when it was heard, x_m, y_m, v_m_s.
    """

    def __init__(
        self,
        program: Path,
        folder: Path,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        *,
        model: str,
        parameters: dict[str, float],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
        fastest_m_s: float = 10.0,
        current_m_s: tuple[float, float] | None = None,
    ) -> None:
        self.port: Final = free_port()
        self.processes: Final[dict[int, subprocess.Popen[bytes]]] = {}
        self.seen: Final[dict[int, tuple[float, float, float, float]]] = {}
        self.paths: Final[dict[int, list[tuple[float, float, float, float]]]] = {spec.id: [] for spec in robots}
        self._robots: Final = tuple(robots)
        earth = workspace.plan.origin if isinstance(workspace, Site) else None
        self._earth: Final = None if earth is None else Projection(earth, "workspace")
        self._armed: Final[dict[int, bool]] = {}
        self._program, self._folder, self._model = program, folder, model
        self._current_m_s: Final = current_m_s
        self._boats: Final[dict[int, subprocess.Popen[bytes]]] = {}
        self._world: Final = _World(workspace, robots, fastest_m_s, limits)
        self._server: Final = _Server(self._world)  # type: ignore[arg-type]
        self.truth: Final = self._server.address
        self._sockets: Final = {spec.id: _bound() for spec in robots}
        self._peers: Final[dict[int, tuple[str, int]]] = {}
        self._told: Final[dict[int, _Told]] = {}
        self._ended: Final = threading.Event()
        self._thread: Final = threading.Thread(target=self._watch, name="witness", daemon=True)
        folder.mkdir(parents=True, exist_ok=True)
        self._parameters: Final = folder / "autopilot.parm"
        self._parameters.write_text("".join(f"{name} {value}\n" for name, value in parameters.items()))
        for spec in robots:
            self.start(spec.id)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._server.close()
        for robot_id in [*self.processes]:
            self.kill(robot_id)
        for each in self._sockets.values():
            each.close()

    def start(self, robot_id: int) -> None:
        """Start a robot's autopilot, where its spec has it."""
        spec = next(each for each in self._robots if each.id == robot_id)
        lat_deg, lon_deg = self._geodetic(spec.x_m, spec.y_m)
        yaw_deg = degrees(turned_rad(spec.heading_rad)) % 360.0
        own = self._folder / str(robot_id)
        own.mkdir(exist_ok=True)
        witness = self._sockets[robot_id].getsockname()[1]
        model, port = self._model, free_port()
        if self._current_m_s is not None:
            model = "JSON:127.0.0.1"
            self._boats[robot_id] = subprocess.Popen([
                sys.executable, "-m", boat.__name__, str(port), *map(str, self._current_m_s), str(radians(yaw_deg)),
            ])  # fmt: skip
        with (own / "output").open("ab") as output:
            self.processes[robot_id] = subprocess.Popen(
                [
                    self._program, "--model", model, "--wipe", "--instance", str(robot_id), "--sim-port-out", str(port),
                    "--sysid", str(robot_id), "--defaults", self._parameters,
                    "--home", f"{lat_deg:.9f},{lon_deg:.9f},{ORIGIN.alt_m},{yaw_deg:.3f}",
                    "--serial0", f"udpclient:127.0.0.1:{self.port}",
                    "--serial1", f"udpclient:127.0.0.1:{witness}", "--serial2", "none",
                ],
                cwd=own, stdout=output, stderr=subprocess.STDOUT,
            )  # fmt: skip

    def kill(self, robot_id: int) -> None:
        """End a robot's autopilot at once."""
        for started in (self.processes, self._boats):
            process = started.pop(robot_id, None)
            if process is not None:
                process.kill()
                process.wait()

    def armed(self, robot_id: int) -> bool:
        """Return whether a vehicle says to the witness that it is armed."""
        return self._armed.get(robot_id, False)

    def command(self, robot_id: int, number: int, *params: float) -> None:
        """Send a command as another ground station does."""
        values = [*params, *[0.0] * (7 - len(params))]
        self._send(robot_id, mav.MAVLink_command_long_message(robot_id, 1, number, 0, *values))

    def send_to(self, robot_id: int, x_m: float, y_m: float, height_m: float = 0.0) -> None:
        """Send it to a place, as another ground station does."""
        lat_deg, lon_deg = self._geodetic(x_m, y_m)
        frame, mask = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 0x0DF8
        self._send(robot_id, mav.MAVLink_set_position_target_global_int_message(
            0, robot_id, 1, frame, mask, round(lat_deg * 1e7), round(lon_deg * 1e7), height_m, *[0.0] * 8
        ))  # fmt: skip

    def set(self, robot_id: int, name: str, value: float) -> None:
        """Set a parameter as another ground station does."""
        self._send(robot_id, mav.MAVLink_param_set_message(
            robot_id, 1, name.encode(), value, mav.MAV_PARAM_TYPE_REAL32
        ))  # fmt: skip

    def _geodetic(self, x_m: float, y_m: float) -> tuple[float, float]:
        if self._earth is not None:
            return self._earth.place(x_m, y_m)
        east_deg = x_m / (_M_PER_DEG * cos(radians(ORIGIN.lat_deg)))
        return ORIGIN.lat_deg + y_m / _M_PER_DEG, ORIGIN.lon_deg + east_deg

    # --- the witness ---------------------------------------------------------------------------------------

    def _send(self, robot_id: int, message: Any) -> None:
        peer = self._peers.get(robot_id)
        if peer is not None:
            codec = mav.MAVLink(None, 254, mav.MAV_COMP_ID_MISSIONPLANNER)
            self._sockets[robot_id].sendto(message.pack(codec), peer)

    def _watch(self) -> None:
        parsers = {robot_id: mav.MAVLink(None) for robot_id in self._sockets}
        asked_s, due_s = 0.0, time.perf_counter()
        while not self._ended.is_set():
            for robot_id, heard in self._sockets.items():
                self._hear(robot_id, heard, parsers[robot_id])
            if time.perf_counter() - asked_s > 1.0:
                asked_s = time.perf_counter()
                for robot_id in self._sockets:
                    number = mav.MAVLINK_MSG_ID_SIM_STATE
                    self.command(robot_id, mav.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / _HZ)
            now_s = time.perf_counter()
            if now_s >= due_s:
                due_s += _STEP_S
                self._step(now_s)
            select.select([*self._sockets.values()], [], [], max(due_s - time.perf_counter(), 0.0))

    def _hear(self, robot_id: int, heard: socket.socket, parser: Any) -> None:
        parser.robust_parsing = True
        while True:
            try:
                data, self._peers[robot_id] = heard.recvfrom(65536)
            except OSError:
                return
            for message in parser.parse_buffer(data) or ():
                if message.get_srcSystem() != robot_id:
                    continue  # ArduPilot passes on what ground stations send it, heartbeats too
                if message.get_type() == "SIM_STATE":
                    self._told[robot_id] = self._where(message, self._told.get(robot_id))
                    self.seen[robot_id] = self._pose(message, self._told[robot_id])
                    x_m, y_m, _, v_m_s = self.seen[robot_id]
                    self.paths[robot_id].append((time.time(), x_m, y_m, v_m_s))
                elif message.get_type() == "HEARTBEAT":
                    self._armed[robot_id] = bool(message.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)

    def _where(self, message: Any, before: _Told | None) -> _Told:
        """Return where a vehicle is: in the cell that it says, and there as near as can be to where it came to."""
        earth, now_s = self._earth or ORIGIN, time.perf_counter()
        # Places are cut off, not rounded.
        low = local_m(earth, message.lat_int, message.lon_int)
        high = local_m(earth, message.lat_int + 1, message.lon_int + 1)
        if before is None:
            x_m, y_m = 0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])
        else:
            half = before._replace(vx_m_s=0.5 * (before.vx_m_s + message.ve), vy_m_s=0.5 * (before.vy_m_s + message.vn))
            x_m, y_m = (
                min(max(each, least), most) for each, least, most in zip(half.after(now_s), low, high, strict=True)
            )
        return _Told(now_s, x_m, y_m, message.ve, message.vn)

    @staticmethod
    def _pose(message: Any, told: _Told) -> tuple[float, float, float, float]:
        heading_rad = turned_rad(message.yaw)
        way = atan2(message.vn, message.ve)
        ahead = cos(remainder(way - heading_rad, 6.283185307179586))
        speed = hypot(message.vn, message.ve)
        return told.x_m, told.y_m, heading_rad, speed if ahead >= 0.0 else -speed

    def _step(self, now_s: float) -> None:
        bodies = self._world.bodies
        places = [*zip(bodies.x, bodies.y, strict=True)]
        for index, robot_id in enumerate(bodies.ids):
            if robot_id in self._told:
                _, _, bodies.heading[index], bodies.v[index] = self.seen[robot_id]
                places[index] = self._told[robot_id].after(now_s)
        self._world.move([x_m for x_m, _ in places], [y_m for _, y_m in places])
        self._server.tell()


def _bound() -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", 0))
    opened.setblocking(False)
    return opened
