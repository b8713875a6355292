"""Who has no certificate cannot move a robot, and whoever has one can: else the test would show nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from soter.adapters.velocity_controlled.motion import seconds
from soter.adapters.zenoh.messages import Odometry, RosClock, String, Twist, Vector3
from soter.adapters.zenoh.session import SessionOptions
from soter.adapters.zenoh.simulator import ZenohSimulator
from soter.adapters.zenoh.talk import Ear, Voice
from soter.clock import VehicleClock
from soter.onboard.wire import AC, Order
from soter.sdk.truth import StreamedTruth
from tests.adapters.velocity_controlled.driving import ROOM, SPECS
from tests.adapters.zenoh.sessions import Authority, opened
from tests.waiting import eventually

HERE = "127.0.0.1"
TRIES_S = 1.5


class Intruder:
    """Takes the robot over with all that its keys offer, and drives it ahead."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.heard = 0
        self._now_s = 1000.0
        self._seq = 0
        self._orders = Voice(session, "robot1/soter/order")
        self._velocities = [Voice(session, f"robot1/{key}") for key in ("cmd_vel", "cmd_vel_ac", "cmd_vel_sc")]
        Ear(session, "robot1/clock", RosClock, self._note_clock)
        Ear(session, "robot1/odom", Odometry, self._note)

    def push(self) -> None:
        """Try once more."""
        self._seq += 1
        self._orders.say(String(Order("intruder", self._seq, AC, self._now_s).encode()))
        for velocity in self._velocities:
            velocity.say(Twist(Vector3(x=0.2)))
        time.sleep(0.02)

    def _note_clock(self, message: RosClock) -> None:
        self._note(message)
        self._now_s = seconds(message.clock)

    def _note(self, _: object) -> None:
        self.heard += 1


@contextmanager
def robot(session: SessionOptions) -> Iterator[tuple[ZenohSimulator, StreamedTruth]]:
    simulator = ZenohSimulator(ROOM.with_robots(1), SPECS[:1], session)
    try:
        truth = StreamedTruth(simulator.truth, VehicleClock())
        yield simulator, truth
        truth.close()
    finally:
        simulator.close()


def moved_m(truth: StreamedTruth) -> float:
    return math.dist(truth.pose(1)[:2], (SPECS[0].x_m, SPECS[0].y_m))


def try_in_vain(intruders: list[Intruder], truth: StreamedTruth) -> None:
    until_s = time.monotonic() + TRIES_S
    while time.monotonic() < until_s:
        for intruder in intruders:
            intruder.push()
    assert [intruder.heard for intruder in intruders] == [0] * len(intruders)
    assert moved_m(truth) == 0.0


def moves(intruder: Intruder, truth: StreamedTruth) -> bool:
    def moved() -> bool:
        intruder.push()
        return moved_m(truth) > 0.05

    return eventually(moved) and intruder.heard > 0


def test_without_a_certificate_nobody_moves_a_robot_or_hears_it(tmp_path: Path) -> None:
    ours, theirs = Authority(tmp_path / "ours"), Authority(tmp_path / "theirs")
    with robot(SessionOptions(tls=ours.tls(HERE))) as (simulator, truth):
        where = simulator.session.connect
        assert where[0].startswith(f"tls/{HERE}:")
        plain = tuple(each.replace("tls/", "tcp/") for each in where)
        strangers: list[dict[str, Any]] = [
            {"connect": where, "tls": ours.tls()},
            {"connect": where, "tls": theirs.tls(HERE, root=ours.root)},
            {"connect": plain},
        ]
        with opened(*(SessionOptions(**each) for each in strangers)) as sessions:
            try_in_vain([Intruder(session) for session in sessions], truth)
            assert [session.info.links() for session in sessions] == [[], [], []]
        with opened(SessionOptions(connect=where, tls=ours.tls(HERE))) as (session,):
            assert moves(Intruder(session), truth)


def test_a_password_keeps_out_who_does_not_know_it(tmp_path: Path) -> None:
    users, right, wrong = tmp_path / "users", tmp_path / "right", tmp_path / "wrong"
    users.write_text("fleet:open-sesame\n")
    right.write_text("open-sesame\n")
    wrong.write_text("guess\n")
    with robot(SessionOptions(users_file=users, username="fleet", password_file=right)) as (simulator, truth):
        where = simulator.session.connect
        guesser = SessionOptions(connect=where, username="fleet", password_file=wrong)
        with opened(guesser, SessionOptions(connect=where)) as sessions:
            try_in_vain([Intruder(session) for session in sessions], truth)
        with opened(simulator.session) as (session,):
            assert moves(Intruder(session), truth)
