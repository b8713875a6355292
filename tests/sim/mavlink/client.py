"""A ground station for tests, on plain sockets, and simulated vehicles that live in the test's own time."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, Self

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec
from soter_sim.mavlink.autopilot import Autopilot
from soter_sim.mavlink.simulation import Settings, Simulation
from tests.sim.worlds import empty

HOST: Final = "127.0.0.1"
GUIDED: Final = {"rover": 15, "copter": 4}
POSITION: Final = 0x0DF8
VELOCITY: Final = 0x0DC7
CUSTOM: Final = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
ACCEPTED: Final = mav.MAV_RESULT_ACCEPTED
REJECTED: Final = mav.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: Final = mav.MAV_RESULT_DENIED
UNSUPPORTED: Final = mav.MAV_RESULT_UNSUPPORTED
FAILED: Final = mav.MAV_RESULT_FAILED

Message = mav.MAVLink_message


def signing_time() -> int:
    """The time as signatures have it: units of 10 microseconds from the start of 2015."""
    return int((time.time() - 1_420_070_400) * 100_000)


class Client:
    """One component of a ground station, on a connection of its own.

    Args:
        address: as the simulation gives it: `tcp:HOST:PORT` to connect to, `udpin:HOST:PORT` to listen on.
        system: its system id.
        component: its component id.
        key: sign with this.

    Attributes:
        heard: all messages that have come and were not taken yet, oldest first.
        bad: how many packets could not be read.
    """

    def __init__(self, address: str, system: int = 255, component: int = 190, key: bytes | None = None) -> None:
        kind, host, port = address.split(":")
        self.system, self.component = system, component
        self.heard: list[Message] = []
        self.bad = 0
        self._peer: Any = None
        if kind == "tcp":
            self._socket = socket.create_connection((host, int(port)))
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind((host, int(port)))
        self._socket.setblocking(False)
        self._mav = mav.MAVLink(None, system, component)
        self._mav.robust_parsing = True
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.timestamp = signing_time()

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def send(self, message: Message) -> None:
        """Send a message."""
        self.send_raw(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256

    def send_raw(self, data: bytes) -> None:
        """Send bytes."""
        if self._socket.type == socket.SOCK_STREAM:
            self._socket.sendall(data)
        else:
            self._socket.sendto(data, self._peer)

    def pump(self) -> None:
        """Read all that has come."""
        while True:
            try:
                data, peer = self._socket.recvfrom(1 << 20)
            except BlockingIOError:
                return
            if not data:
                return
            self._peer = peer or self._peer
            for message in self._mav.parse_buffer(data) or ():
                if message.get_type() == "BAD_DATA":
                    self.bad += 1
                else:
                    self.heard.append(message)

    def take(self, name: str, system: int = 1) -> list[Message]:
        """Return the messages of a type from a vehicle, and forget them."""
        self.pump()
        found = [each for each in self.heard if each.get_type() == name and each.get_srcSystem() == system]
        self.heard = [each for each in self.heard if each not in found]
        return found

    def texts(self, system: int = 1) -> list[str]:
        """Return what a vehicle has said in words, and forget it."""
        return [str(message.text) for message in self.take("STATUSTEXT", system)]


class Rig:
    """Simulated vehicles that only move when the test says so, and a client.

    Args:
        workspace: where they are; a large empty room by default.
        robots: at (5, 5), (6, 5), ... by default.
        count: how many, if `robots` is not given.
        key: for signing.
        settings: for `Settings`; a TCP port, and autopilots that are ready at once, by default.
    """

    def __init__(
        self,
        workspace: Workspace | None = None,
        robots: Sequence[RobotSpec] | None = None,
        *,
        count: int = 1,
        **settings: Any,
    ) -> None:
        if robots is None:
            robots = [RobotSpec(number, 4.0 + number, 5.0, 0.0) for number in range(1, count + 1)]
        chosen = {"boot_s": 0.0} | ({} if "udp" in settings else {"tcp": (0,)}) | settings
        self.settings = Settings(**chosen)
        self.simulation = Simulation(workspace or empty(), robots, self.settings)
        self.period_s = self.simulation.world.period_s
        self.clients: list[Client] = []
        self.client = self.connect(key=self.settings.key)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for client in self.clients:
            client.close()
        self.simulation.close()

    @property
    def autopilot(self) -> Autopilot:
        """The first vehicle's."""
        return self.simulation.autopilots[0]

    def connect(self, system: int = 255, component: int = 190, key: bytes | None = None) -> Client:
        """Return another client."""
        client = Client(self.simulation.links[0].address, system, component, key)
        self.clients.append(client)
        self.run(2.0 * self.period_s)
        return client

    def run(self, duration_s: float) -> None:
        """Let simulated time pass."""
        for _ in range(round(duration_s / self.period_s)):
            self.simulation.step()
            for client in self.clients:
                client.pump()

    def until(self, done: Callable[[], bool], timeout_s: float = 60.0) -> float:
        """Let simulated time pass until something is true; return how long that took."""
        began_s = self.simulation.world.now_s
        while not done():
            passed_s = self.simulation.world.now_s - began_s
            assert passed_s < timeout_s, f"not within {timeout_s} simulated seconds"
            self.run(self.period_s)
        return self.simulation.world.now_s - began_s

    # --- commands -------------------------------------------------------------------------------------------

    def command(self, number: int, *params: float, by: Client | None = None, to: int = 1) -> int | None:
        """Send a COMMAND_LONG and return its result; None without an answer."""
        values = [*params, *[0.0] * (7 - len(params))]
        client = by or self.client
        client.send(mav.MAVLink_command_long_message(to, 1, number, 0, *values))
        return self._result(client, number, to)

    def command_int(
        self, number: int, *params: float, x: int = 0, y: int = 0, z: float = 0.0, frame: int = 0,
        by: Client | None = None, to: int = 1,
    ) -> int | None:  # fmt: skip
        """Send a COMMAND_INT and return its result; None without an answer."""
        values = [*params, *[0.0] * (4 - len(params))]
        client = by or self.client
        client.send(mav.MAVLink_command_int_message(to, 1, frame, number, 0, 0, *values, x, y, z))
        return self._result(client, number, to)

    def _result(self, client: Client, number: int, to: int) -> int | None:
        client.take("COMMAND_ACK", to)
        self.run(2.0 * self.period_s)
        acks = [ack for ack in client.take("COMMAND_ACK", to) if ack.command == number]
        assert all((ack.target_system, ack.target_component) == (client.system, client.component) for ack in acks)
        return int(acks[-1].result) if acks else None

    def mode(self, number: int, by: Client | None = None, to: int = 1) -> int | None:
        """Ask for a mode and return the result."""
        return self.command(mav.MAV_CMD_DO_SET_MODE, CUSTOM, number, by=by, to=to)

    def arm(self, by: Client | None = None, to: int = 1) -> int | None:
        """Ask to arm and return the result."""
        return self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, by=by, to=to)

    def disarm(self, by: Client | None = None, to: int = 1) -> int | None:
        """Ask to disarm and return the result."""
        return self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, by=by, to=to)

    def guided(self, to: int = 1) -> None:
        """Make a vehicle ready to be sent somewhere."""
        assert self.mode(GUIDED[self.settings.vehicle], to=to) == ACCEPTED
        assert self.arm(to=to) == ACCEPTED

    def fly(self, height_m: float = 1.0, to: int = 1) -> None:
        """Make a copter hover."""
        self.guided(to)
        assert self.command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m, to=to) == ACCEPTED
        autopilot = self.simulation.autopilots[to - 1]
        self.until(lambda: abs(autopilot.sample().z_m - height_m) < 0.01, 20.0)

    def master(self, system: int, component: int, by: Client | None = None, since_ms: int = 0) -> int | None:
        """Name who is in charge and return the result."""
        return self.command_int(mav.MAV_CMD_DO_GUIDED_MASTER, system, component, by=by, x=since_ms)

    def target(
        self, east_m: float, north_m: float, up_m: float = 0.0, by: Client | None = None, to: int = 1, **fields: float
    ) -> None:
        """Send a place to go to, relative to the origin unless `frame` says otherwise."""
        names = ("vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate")
        frame, mask = int(fields.pop("frame", mav.MAV_FRAME_LOCAL_NED)), int(fields.pop("mask", POSITION))
        (by or self.client).send(
            mav.MAVLink_set_position_target_local_ned_message(
                0, to, 1, frame, mask, north_m, east_m, -up_m, *(fields.get(name, 0.0) for name in names)
            )
        )

    def velocity(self, east_m_s: float, north_m_s: float, up_m_s: float = 0.0, **fields: float) -> None:
        """Send a velocity to keep."""
        wanted = {"mask": VELOCITY, "vx": north_m_s, "vy": east_m_s, "vz": -up_m_s}
        self.target(0.0, 0.0, 0.0, None, 1, **wanted | fields)

    def at(self, robot: int = 1) -> tuple[float, float]:
        """Return where a robot really is, east and north."""
        return self.simulation.world.truth.pose(robot)[:2]

    def speed(self, robot: int = 1) -> float:
        """Return how fast a robot really is."""
        return abs(self.simulation.world.bodies.v[robot - 1])
