"""Starts simulated robots on keys: a world and, for each robot, the mux, in processes of their own; and ends them."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from soter.adapters.zenoh.options import CLOCK
from soter.adapters.zenoh.session import SessionOptions
from soter.sdk import RobotSpec
from soter.streamed.simulator import StreamedSimulator
from soter.workspace import Workspace


class Simulator(StreamedSimulator):
    """A world in real time as robots on keys, each with its mux. On this host only, unless told otherwise.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        session: how the world is reached; the muxes are peers or clients beside it.
        stamped: whether velocities are TwistStamped.
        speedup: seconds of the world in one of the host.
        truth_port: where the world tells the truth; 0 for any port that is free.

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
    ) -> None:
        self._folder: Final = tempfile.TemporaryDirectory(prefix="soter-zenoh-")
        self._flags: Final = ["--speedup", repr(speedup), *(["--stamped"] if stamped else [])]
        super().__init__(
            "soter_sim.zenoh", "", robots, os.environ,
            "--truth-port", str(truth_port), "--session", self._written("world", session), *self._flags,
        )  # fmt: skip
        told = self._hand_over(workspace)
        self.session: Final = _beside(session, told["endpoints"])
        self._session_file: Final = self._written("beside", self.session)
        for robot_id in self.namespaces:
            self.start_mux(robot_id)

    def start_mux(self, robot_id: int) -> None:
        self.muxes[robot_id] = self._start(
            "soter.adapters.zenoh.mux", "--robot", self.namespaces[robot_id], "--session", self._session_file,
            "--clock", CLOCK, *self._flags, pipes=False,
        )  # fmt: skip

    def close(self) -> None:
        super().close()
        self._folder.cleanup()

    def _written(self, name: str, session: SessionOptions) -> str:
        path = Path(self._folder.name) / f"{name}.json"
        path.write_text(session.model_dump_json(), encoding="utf-8")
        return str(path)


def _beside(world: SessionOptions, endpoints: Sequence[str]) -> SessionOptions:
    """Return how to get in touch with a world, which listens there, and with its muxes."""
    if world.mode == "client":
        return world
    # A peer finds the other peers of a peer by itself; between clients a router has to pass on.
    mode = "client" if world.mode == "router" else "peer"
    return world.model_copy(update={"mode": mode, "listen": (), "connect": tuple(endpoints)})
