"""Starts and ends simulated robots on Zenoh: a world and, for each robot, a mux, in processes of their own."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from soter.adapters.velocity_controlled.robot import VelocityControlledRobot
from soter.adapters.velocity_controlled.simulator import VelocityControlledSimulator
from soter.adapters.zenoh.options import CLOCK
from soter.adapters.zenoh.session import SessionOptions
from soter.geometry.workspace import Workspace
from soter.scratch import Scratch
from soter.sdk import RobotSpec, RuleLimits


class ZenohSimulator(VelocityControlledSimulator):
    """Robots on Zenoh keys simulated in real time, each with its mux. On this host only, unless told otherwise.

    Args:
        workspace: fence, boxes, chargers.
        robots: the robots.
        session: options of the world's session; the muxes are peers or clients beside it.
        stamped: whether velocities are TwistStamped.
        speedup: world seconds per host second.
        truth_port: the port of the ground truth; 0 for any free port.
        private: whether all sessions must know a name and a password of this world's own, unless `session` has options
            of its own.
        limits: the mission's limits, by which the ground truth is judged.

    Attributes:
        session: options of a session that connects to the robots.

    Raises:
        RobotUnavailable: the simulation does not start.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        session: SessionOptions = SessionOptions(),  # noqa: B008 - frozen
        *,
        stamped: bool = False,
        speedup: float = 1.0,
        truth_port: int = 0,
        private: bool = False,
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
    ) -> None:
        # Only this user can read the folder, and sandboxed processes cannot.
        self._folder: Final = Scratch("zenoh")
        if private and session == SessionOptions(open_timeout_s=session.open_timeout_s, lease_s=session.lease_s):
            session = self._private(session)
        self._flags: Final = ["--speedup", repr(speedup), *(["--stamped"] if stamped else [])]
        super().__init__(
            "soter_sim.zenoh", "", robots, os.environ,
            "--truth-port", str(truth_port), "--session", self._written("world", session), *self._flags,
        )  # fmt: skip
        told = self._hand_over(workspace, limits)
        self.session: Final = _beside(session, told["endpoints"])
        self._session_file: Final = self._written("beside", self.session)
        for robot_id in self.namespaces:
            self.start_mux(robot_id)

    def start_mux(self, robot_id: int) -> None:
        promised, namespace = self.promised(robot_id), self.namespaces[robot_id]
        self.muxes[robot_id] = self._start(
            "soter.adapters.zenoh.mux", "--robot", namespace, "--session", self._session_file,
            "--clock", f"{namespace}/{CLOCK}", "--lease", repr(VelocityControlledRobot.counted_s(promised)),
            "--v-max", repr(promised.v_max_m_s), "--yaw-rate-max", repr(promised.yaw_rate_max_rad_s),
            *self._flags, pipes=False,
        )  # fmt: skip

    def close(self) -> None:
        super().close()
        self._folder.close()

    def _private(self, session: SessionOptions) -> SessionOptions:
        """Return session options with a random name and password, which others must know to connect.

        The session is a router, so that no other session listens: among peers each one would have to check passwords.
        """
        name, password = secrets.token_hex(8), secrets.token_hex(16)
        return session.model_copy(update={
            "mode": "router", "listen": ("tcp/127.0.0.1:0",),
            "username": name, "password_file": self._file("password", password),
            "users_file": self._file("users", f"{name}:{password}"),
        })  # fmt: skip

    def _written(self, name: str, session: SessionOptions) -> str:
        return str(self._file(f"{name}.json", session.model_dump_json()))

    def _file(self, name: str, text: str) -> Path:
        path = self._folder.path / name
        path.write_text(text, encoding="utf-8")
        return path


def _beside(world: SessionOptions, endpoints: Sequence[str]) -> SessionOptions:
    """Return the options of a session that connects to a world at these endpoints, and to its muxes."""
    if world.mode == "client":
        return world
    # A peer finds the other peers of a peer by itself; clients reach each other through a router.
    mode = "client" if world.mode == "router" else "peer"
    return world.model_copy(update={"mode": mode, "listen": (), "connect": tuple(endpoints), "users_file": None})
