"""Harness of the conformance kit for this adapter: fresh simulated robots, and ways to break the link to them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from typing import Any, Final

import zenoh

from soter.adapters.velocity_controlled.harness import (
    VelocityControlledHarness,
    VelocityControlledRelay,
)
from soter.adapters.zenoh.backend import ZenohBackend
from soter.adapters.zenoh.messages import Twist, Vector3, encode
from soter.adapters.zenoh.options import Keys, ZenohConfig, ZenohRobotOptions
from soter.adapters.zenoh.session import SessionOptions, close_session, endpoints, open_session
from soter.adapters.zenoh.simulator import ZenohSimulator
from soter.adapters.zenoh.talk import Listener, Voice
from soter.conformance import WIDE_ROOMS, in_wide_rooms
from soter.conformance.harness import LIMITS, Killable, Switchable
from soter.conformance.impaired import Line
from soter.sdk import Fleet, Waypoint, program
from soter.sdk.wire import WireFleet

_TO_ROBOT: Final = ("order", "cmd_vel_ac", "cmd_vel_sc")
_TO_SOTER: Final = ("odom", "battery", "gate")
_AT_ONCE: Final = 256


class ZenohRelay(VelocityControlledRelay):
    """Passes messages on, both ways. The two sides have no link to each other.

    Args:
        there: the session with the robots.
        here: the session with SOTER.
        namespaces: by robot id, the namespace of its keys.
        prefix: of the namespaces on SOTER's side; needed if both sides are on one network.
    """

    def __init__(
        self, there: SessionOptions, here: SessionOptions, namespaces: Mapping[int, str], prefix: str = ""
    ) -> None:
        super().__init__()
        self._sessions: Final[list[zenoh.Session]] = []
        self._bases: Final[dict[int, tuple[Voice, Voice]]] = {}
        try:
            for options in (there, here):
                self._sessions.append(open_session(options))
            robots, self.session = self._sessions
            for robot_id, namespace in namespaces.items():
                near, far = Keys().of(namespace), Keys().of(prefix + namespace)
                self._bases[robot_id] = Voice(robots, near.cmd_vel), Voice(self.session, far.cmd_vel)
                for name in _TO_ROBOT:
                    self._connect(robot_id, self.session, getattr(far, name), robots, getattr(near, name))
                for name in _TO_SOTER:
                    self._connect(robot_id, robots, getattr(near, name), self.session, getattr(far, name))
        except BaseException:
            self.close()
            raise

    def intrude(self, robot_id: int, seconds: float, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        voices = self._bases[robot_id]

        def drive(message: bytes) -> None:
            for voice in voices:
                voice.say_bytes(message)

        self.repeat(Line(robot_id, drive), encode(Twist(Vector3(x=speed_m_s), Vector3(z=yaw_rate_rad_s))), seconds)

    def close(self) -> None:
        super().close()
        for session in self._sessions:
            close_session(session)

    def _connect(self, robot_id: int, source: zenoh.Session, heard: str, sink: zenoh.Session, said: str) -> None:
        line = Line(robot_id, Voice(sink, said).say_bytes)
        messages: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(_AT_ONCE)
        Listener(source.declare_subscriber(heard, messages), lambda each: self.pass_on(line, each.payload.to_bytes()))


class ZenohHarness(VelocityControlledHarness):
    """Opens simulated robots behind a relay, new ones for every fleet; all sessions are peers."""

    name = "zenoh"

    def open(self, robots: int) -> Fleet:
        simulator = self._start(robots)
        relay = ZenohRelay(self.beside(simulator.session), self.of_relay(), simulator.namespaces, self.prefix())
        self.relay = relay
        namespaces = {robot_id: self.prefix() + name for robot_id, name in simulator.namespaces.items()}
        self._seen_by_soter = _config(self.to_relay(relay), simulator.truth, namespaces)
        self.fleet = self.second()
        return self.fleet

    def second(self) -> Fleet:
        return ZenohBackend().open(self._seen_by_soter, self.asked(len(self._seen_by_soter.robots)))

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        simulator = self._start(1)
        config = _config(self.beside(simulator.session), simulator.truth, simulator.namespaces)
        return self.driven(f"{__name__}:open_given", config.model_dump_json(exclude={"workspace", "limits"}), target)

    def switchable(self) -> Switchable:
        """Return a fleet of one fresh robot without a relay and without ground truth, to be switched off and on."""
        simulator = self._start(1)
        session = simulator.session
        # A client is found again at its router; a peer must listen at its old endpoints again.
        again = session if session.mode == "client" else SessionOptions(listen=session.connect)
        config = _config(self.beside(session), None, simulator.namespaces)
        self.fleet = ZenohBackend().open(config, self.asked(1))
        return Switchable(self.fleet, self._end, lambda: self._start(1, again))

    def killable(self) -> Killable:
        """Return a fleet of one robot that the backend simulates itself, and the call that kills its base."""
        fleet = self.faster(1.0)
        assert isinstance(fleet.simulator, ZenohSimulator)
        return Killable(fleet, fleet.simulator.world.kill)

    def faster(self, speedup: float) -> WireFleet[Any]:
        config = ZenohConfig(workspace=WIDE_ROOMS, limits=LIMITS, speedup=speedup)
        self.fleet = fleet = ZenohBackend().open(config, self.specs(1))
        return fleet

    def of_robots(self) -> SessionOptions:
        """Return the session options of the simulated world."""
        return SessionOptions()

    def beside(self, robots: SessionOptions) -> SessionOptions:
        """Return the options of another session with the robots, made of those of the muxes' sessions."""
        return robots

    def of_relay(self) -> SessionOptions:
        """Return the options of the relay's session with SOTER."""
        return SessionOptions()

    def to_relay(self, relay: ZenohRelay) -> SessionOptions:
        """Return the options of SOTER's own session."""
        return SessionOptions(connect=tuple(endpoints(relay.session)))

    def prefix(self) -> str:
        """Return the prefix of the robots' keys on SOTER's side of the relay."""
        return ""

    def _start(self, robots: int, session: SessionOptions | None = None) -> ZenohSimulator:
        session = self.of_robots() if session is None else session
        simulator = ZenohSimulator(WIDE_ROOMS, self.specs(robots), session, limits=LIMITS)
        self._watch(simulator)
        return simulator


class RoutedHarness(ZenohHarness):
    """A `ZenohHarness` whose sessions are all clients of one router, which is a process of its own."""

    name = "zenoh, routed"

    def __init__(self) -> None:
        super().__init__()
        self._router: subprocess.Popen[bytes] | None = None
        self._clients = SessionOptions()

    def close(self) -> None:
        super().close()
        if self._router is not None:
            program.end([self._router])
            self._router = None

    def of_robots(self) -> SessionOptions:
        self._router = subprocess.Popen(
            [sys.executable, "-m", "soter.cli", "zenoh-router", "--listen", "tcp/127.0.0.1:0",
             "--parent", str(os.getpid())],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )  # fmt: skip
        said = program.first_line(self._router).decode()
        self._clients = SessionOptions(mode="client", connect=(said.split(" at ")[1].split()[0].rstrip(".,"),))
        return self._clients

    def of_relay(self) -> SessionOptions:
        return self._clients

    def to_relay(self, relay: ZenohRelay) -> SessionOptions:
        return self._clients

    def prefix(self) -> str:
        return "far/"


def open_given(argument: str) -> Fleet:
    """Open the first robot with options that are given as JSON; called in the kit's driver process."""
    config = ZenohConfig.model_validate({**json.loads(argument), "workspace": WIDE_ROOMS})
    return ZenohBackend().open(config, in_wide_rooms(1))


def _config(session: SessionOptions, truth: str | None, namespaces: Mapping[int, str]) -> ZenohConfig:
    robots = {robot_id: ZenohRobotOptions(namespace=name) for robot_id, name in namespaces.items()}
    return ZenohConfig(workspace=WIDE_ROOMS, robots=robots, session=session, truth=truth)
