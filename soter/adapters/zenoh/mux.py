"""The mux on Zenoh keys: lets one of two controllers drive a robot, and stops it when SOTER falls silent.

`soter zenoh-mux --robot NAME --connect E`, or `python -m soter.adapters.zenoh.mux`. It runs on the robot, beside
zenoh-bridge-ros2dds or another program that puts the robot's base on keys.

It passes `cmd_vel_ac` or `cmd_vel_sc` on to `cmd_vel`, by the latest `soter/order`, and reports its state on
`soter/gate`: at every order that it takes, at every change, and at least every 0.25 s. While the lease is dead, or the
active controller is silent, it publishes rest.
"""

from __future__ import annotations

import argparse
import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import zenoh

from soter.adapters.velocity_controlled.motion import seconds
from soter.adapters.zenoh.messages import RosClock, String, Twist, TwistStamped
from soter.adapters.zenoh.options import Keys, check_key
from soter.adapters.zenoh.programs import add_session, positive, read_session, refusing
from soter.adapters.zenoh.session import close_session, endpoints, open_session
from soter.adapters.zenoh.talk import Ear, Voice, announce, hear_velocity, make_velocity, stamp_of
from soter.config import validate_options
from soter.onboard.gate_node import COMMAND_S, LEASE_S, PERIOD_S, V_MAX_M_S, YAW_RATE_MAX_RAD_S, GateNode
from soter.onboard.program import Ending, favour
from soter.onboard.velocity import REST, Velocity, VelocityGate
from soter.onboard.wire import AC, SC

logger = logging.getLogger(__name__)

_REPORT_S: Final = 0.25
"""Longest time between two reports, for subscribers that come later or missed one."""


class ZenohGateNode(GateNode):
    """Connects the gate of one robot with Zenoh keys. Messages and looks come from several threads, one at a time.

    Args:
        session: an open session, which the caller closes.
        keys: the robot's keys, in full.
        gate: the robot's gate.
        namespace: the robot's namespace, under which the mux announces itself.
        clock: the key of the robot's clock; None for the clock of this host.
        stamped: whether velocities are TwistStamped.
        rate: seconds of the robot's clock per host second.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        gate: VelocityGate,
        namespace: str,
        *,
        clock: str | None = None,
        stamped: bool = False,
        rate: float = 1.0,
    ) -> None:
        super().__init__(gate, rate)
        self._turn: Final = threading.RLock()
        self._stamped: Final = stamped
        self._over = False
        self._clock: Callable[[], float | None] = time.time if clock is None else lambda: self._shown_s
        self._shown_s: float | None = None
        self._velocities: Final = Voice(session, keys.cmd_vel)
        self._reports: Final = Voice(session, keys.gate)
        self._token: Final = announce(session, namespace, "mux")
        self._ears: Final[list[Ear[Any]]] = [
            Ear(session, keys.order, String, lambda message: self.hear_order(message.data)),
            hear_velocity(session, keys.cmd_vel_ac, lambda *each: self.hear(AC, Velocity(*each)), stamped=stamped),
            hear_velocity(session, keys.cmd_vel_sc, lambda *each: self.hear(SC, Velocity(*each)), stamped=stamped),
        ]
        if clock is not None:
            self._ears.append(Ear(session, clock, RosClock, self._show))

    def hear_order(self, text: str | bytes) -> None:
        with self._turn:
            super().hear_order(text)

    def hear(self, by: str, velocity: Velocity) -> None:
        with self._turn:
            super().hear(by, velocity)

    def look(self) -> None:
        with self._turn:
            super().look()

    def report(self) -> None:
        with self._turn:
            super().report()

    def run(self, ended: Callable[[], bool]) -> None:
        """Look and report until `ended` returns True; then publish rest, and nothing more."""
        due_s = report_s = time.monotonic()
        try:
            while not ended():
                if due_s >= report_s:
                    report_s = due_s + _REPORT_S
                    self.report()
                self.look()
                now_s = time.monotonic()
                due_s = max(due_s + PERIOD_S, now_s)
                time.sleep(due_s - now_s)
        finally:
            with self._turn:
                self._over = True
                self._velocities.say(self._message(REST))

    def _show(self, message: RosClock) -> None:
        self._shown_s = seconds(message.clock)

    def _clock_s(self) -> float | None:
        return self._clock()

    def _pass_on(self, velocity: Velocity) -> None:
        if not self._over:
            self._velocities.say(self._message(velocity))

    def _message(self, velocity: Velocity) -> Twist | TwistStamped:
        return make_velocity(*velocity, stamp_of(self._clock() or 0.0) if self._stamped else None)

    def _say(self, report: str) -> None:
        self._reports.say(String(report))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the mux until it is interrupted or, with `--parent PID`, until that process is gone."""
    parser = _parser()
    given = parser.parse_args(arguments)
    logging.basicConfig(format="%(name)s: %(message)s")
    logger.setLevel(logging.INFO)
    with refusing(parser):
        options = read_session(given)
        gate = VelocityGate(given.lease, given.command, given.v_max, given.yaw_rate_max)
        try:
            check_key(given.robot)
        except ValueError as failure:
            parser.error(f"--robot is '{given.robot}', {failure}")
        told = {name: key for name, _, key in (each.partition("=") for each in given.key)}
        keys = validate_options(Keys, told, "command line", "--key").of(given.robot)
        ended = Ending(given.parent)
        session = open_session(options)
        try:
            node = ZenohGateNode(
                session, keys, gate, given.robot, clock=given.clock, stamped=given.stamped, rate=given.speedup
            )
            if given.parent is None:
                logger.info("%s; Ctrl-C ends it", connections(session, given.robot))
            favour()
            node.run(ended)
        finally:
            close_session(session)


def connections(session: Any, robot: str) -> str:
    """Return in words where the mux of a robot listens, and what it is connected to now."""
    places = endpoints(session)
    at = f"listens at {', '.join(places)}, and " if places else ""
    routers, peers = (len(list(each())) for each in (session.info.routers_zid, session.info.peers_zid))
    if not routers and not peers:
        return f"{robot}: {at}has found no other program yet"
    found = f"{routers} Zenoh router{'s' * (routers != 1)} and {peers} peer{'s' * (peers != 1)}"
    return f"{robot}: {at}is connected to {found}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="soter zenoh-mux", description="Lets SOTER's AC or SC drive a robot, and stops it when SOTER is silent.",
    )  # fmt: skip
    parser.add_argument(
        "--robot", required=True, metavar="NAME", help="what the robot's keys begin with, such as robot1"
    )
    add_session(parser)
    parser.add_argument(
        "--key", action="append", default=[], metavar="NAME=KEY",
        help="another key for one of " + ", ".join(Keys.model_fields) + ", as in [backends.zenoh.keys]",
    )  # fmt: skip
    for name, default, meaning in (
        ("lease", LEASE_S, "how long a lease lives after its renewal, in seconds"),
        ("command", COMMAND_S, "how long a velocity counts, in seconds"),
        ("v-max", V_MAX_M_S, "no velocity beyond this passes, in m/s"),
        ("yaw-rate-max", YAW_RATE_MAX_RAD_S, "nor any turn rate beyond this, in rad/s"),
        ("speedup", 1.0, "seconds of the robot's clock by second, for simulated robots"),
    ):
        parser.add_argument(f"--{name}", type=positive, default=default, metavar="N", help=f"{meaning}; {default:g}")
    parser.add_argument("--stamped", action="store_true", help="velocities are TwistStamped instead of Twist")
    parser.add_argument("--clock", metavar="KEY", help="the key of the robot's clock, if it is not that of this host")
    parser.add_argument("--parent", type=int, metavar="PID", help="end when this process is no longer the parent")
    return parser


if __name__ == "__main__":
    main()
