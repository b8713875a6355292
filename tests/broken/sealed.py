"""Adapters with bugs out of other drivers' issues: protections that latch, and numbers of libraries."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np

from soter.sdk import RobotState
from tests.broken.edits import driven, edited, sampled, wired
from tests.broken.in_process import Broken
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import memory, with_control
from tests.conformance.wire import Intent, Vehicle, WireClock, WireRobot

_STALLS_S: Final = 3.0
_ASKS_M_S, _STANDS_M_S = 0.02, 0.002


def _switches_off(robot: Any, state: tuple[float, ...], speed: float, rate: float) -> tuple[float, float]:
    """Stand for good once the wheels were held up for three seconds."""
    now_s, drives_m_s = state[0], state[4]
    kept = memory(robot, "held up", lambda: {"asked": 0.0, "since_s": now_s})
    if abs(kept["asked"]) < _ASKS_M_S or abs(drives_m_s) > _STANDS_M_S:
        kept["since_s"] = now_s
    if now_s - kept["since_s"] > _STALLS_S:
        return 0.0, 0.0
    kept["asked"] = speed
    return speed, rate


def _of_numpy(number: int | None) -> Any:
    return None if number is None else np.int64(number)


def _waits_for_any_child(_: Any, state: RobotState) -> RobotState:
    with suppress(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
    return state


def _was_cut(robot: Any) -> list[bool]:
    return memory(robot, "was cut", lambda: [False])  # type: ignore[no-any-return]


def _notes_outages(robot: Any) -> RobotState | None:
    _was_cut(robot)[0] |= robot.faults.cut
    return WireRobot._sample(robot)


def _leaves_it_armed(robot: Any, timeout_s: float) -> None:
    WireRobot._disconnect(robot, timeout_s)
    robot.vehicle.mode = "armed" if _was_cut(robot)[0] else "disarmed"


def _without_controller(robot: Any) -> RobotState | None:
    sample = WireRobot._sample(robot)
    return None if sample is None else sample._replace(controller=None)


def _takes_newer_goals(vehicle: Any, intent: Intent, clock_s: float) -> None:
    newest = memory(vehicle, "newest", lambda: [0])
    if intent.goal is not None and intent.goal.id < newest[0]:
        intent = intent._replace(goal=None)
    newest[0] = max(newest[0], intent.goal.id if intent.goal else 0)
    Vehicle.take(vehicle, intent, clock_s)


class _Deaf(WireClock):
    def sleep_until(self, fleet_s: float) -> None:
        # Most of a tick is spent here, as on a robot's own clock.
        until_s = time.monotonic() + 0.001
        while time.monotonic() < until_s:
            with suppress(BaseException):
                time.sleep(0.0005)
        super().sleep_until(fleet_s)


SEALED: Final[tuple[type[Broken], ...]] = (
    edited("SwitchesOffForGood", "Drives no more once something has held it up for three seconds.",
           "truth.bounds.body", "switched them off", _connect=with_control(_switches_off)),
    sampled("NumbersOfNumPy", "Numbers the goals of its samples by integers of NumPy.", "state.types", "cannot take it",
            lambda _, state: state._replace(goal_id=_of_numpy(state.goal_id))),
    sampled("WaitsForAnyChild", "Waits for whichever child of the process has ended.", "host.children", "waits for any",
            _waits_for_any_child),
)  # fmt: skip

SEALED_ON_WIRE: Final[tuple[type[BrokenWire], ...]] = (
    wired("ForgetsThatItArmed", "Leaves its motors on as it is closed, if its link was out in the meantime.",
          "link.left_as_ever", "forgotten when it is made ready again", _sample=_notes_outages,
          _disconnect=_leaves_it_armed),
    wired("HearsNoComplaint", "Drops what its robot says of why it does not get ready.", "lifecycle.says_why",
          "gets lost", complaint=lambda _: "nothing"),
    wired("SaysNothingOfThePilot", "Says nowhere that a person has its robot, and not who is in charge either.",
          "authority.seized", "nobody learns", declared=replace(WireRobot.declared, reports_controller=False),
          _sample=_without_controller),
    wired("DeafToCtrlC", "Has a clock whose waits swallow whatever is raised.", "host.interrupted", "catches whatever",
          clock_class=_Deaf),
    driven("TakesNewerGoals", "Takes no goal whose number is below that of one before, whichever program's that was.",
           "authority.next_program", "one that was overtaken", take=_takes_newer_goals),
)  # fmt: skip
