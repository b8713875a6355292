"""Starts simulated robots on keys: a world and, for each robot, the mux, in processes of their own; and ends them."""

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
    """A world in real time as robots on keys, each with its mux. On this host only, unless told otherwise.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        session: how the world is reached; the muxes are peers or clients beside it.
        stamped: whether velocities are TwistStamped.
        speedup: seconds of the world in one of the host.
        truth_port: where the world tells the truth; 0 for any port that is free.
        private: whether all sessions know each other by a name and a password of this world's own, unless the
            session's options say how others reach it.
        limits: what the mission promises, which the truth is judged by.

    Attributes:
        session: how somebody else gets in touch with the robots.

    Raises:
        RobotUnavailable: it does not start.
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
        # Readable for this user only; what is boxed in cannot read it either.
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
        promised = self.promised(robot_id)
        self.muxes[robot_id] = self._start(
            "soter.adapters.zenoh.mux", "--robot", self.namespaces[robot_id], "--session", self._session_file,
            "--clock", CLOCK, "--lease", repr(VelocityControlledRobot.counted_s(promised)),
            "--v-max", repr(promised.v_max_m_s), "--yaw-rate-max", repr(promised.yaw_rate_max_rad_s),
            *self._flags, pipes=False,
        )  # fmt: skip

    def close(self) -> None:
        super().close()
        self._folder.close()

    def _private(self, session: SessionOptions) -> SessionOptions:
        """Return a session with a name and a password, drawn at random, that a peer must know to connect.

        It is a router, so that nobody else listens: among peers everybody would have to be asked for the password.
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
    """Return how to get in touch with a world, which listens there, and with its muxes."""
    if world.mode == "client":
        return world
    # A peer finds the other peers of a peer by itself; between clients a router has to pass on.
    mode = "client" if world.mode == "router" else "peer"
    return world.model_copy(update={"mode": mode, "listen": (), "connect": tuple(endpoints), "users_file": None})
