"""What a robot finds out about itself may be better than what its kind declares, and never worse."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest

from soter.errors import RobotUnavailable
from soter.sdk import Capabilities
from soter.sdk.capabilities import ABOVE_0, WIDENS, Widens
from tests.sdk.fake import CAPABILITIES, FakeRobot

DECLARED = replace(CAPABILITIES, accel_m_s2=0.5, speed_noise_m_s=0.01, heading_noise_rad=0.01)
NAMES = [each.name for each in fields(Capabilities)]
WORSE_WHEN_LESS = {"brake_m_s2"}
"""What the proofs divide by: a robot that brakes less than declared drives farther."""


def having(name: str, value: object) -> Capabilities:
    changes: dict[str, Any] = {name: value}
    return replace(DECLARED, **changes)


def changed(name: str, *, up: bool) -> Capabilities:
    value = getattr(DECLARED, name)
    return having(name, up if isinstance(value, bool) else value + (0.01 if up else -0.01))


def test_every_promise_states_which_way_it_is_wider() -> None:
    assert list(WIDENS) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_promise_may_change_one_way_only(name: str) -> None:
    declared = DECLARED if not isinstance(getattr(DECLARED, name), bool) else changed(name, up=False)
    worse = changed(name, up=name not in WORSE_WHEN_LESS)
    assert worse.widened_beyond(declared) == name
    assert declared.widened_beyond(worse) == (name if WIDENS[name] is Widens.EITHER_WAY else None)
    assert declared.widened_beyond(declared) is None


@pytest.mark.parametrize("name", ["accel_m_s2", "speed_noise_m_s", "heading_noise_rad"])
def test_what_is_not_promised_may_be_anything(name: str) -> None:
    silent = having(name, None)
    assert silent.widened_beyond(DECLARED) == name
    assert DECLARED.widened_beyond(silent) is None


@pytest.mark.parametrize("value", [math.nan, math.inf, 1.1e6, -1e-9, pytest.param(10**400, id="vast"), "1.0"])
@pytest.mark.parametrize("name", [name for name in NAMES if not isinstance(getattr(DECLARED, name), bool)])
def test_what_no_robot_can_promise_is_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"^Capabilities\.{name} is .*, allowed: a number from (0|1e-06) to 1e\+06$"):
        having(name, value)


@pytest.mark.parametrize("name", [name for name in NAMES if not isinstance(getattr(DECLARED, name), bool)])
def test_nothing_may_be_promised_of_noise_and_delays_only(name: str) -> None:
    if name in ABOVE_0:
        for value in (0.0, 5e-324, 9.9e-7):
            with pytest.raises(ValueError, match="allowed: a number from 1e-06 to"):
                having(name, value)
    else:
        assert getattr(having(name, 0.0), name) == 0.0


def test_a_robot_that_brakes_less_than_its_adapter_declares_does_not_get_ready() -> None:
    robot = FakeRobot()
    robot.found = replace(CAPABILITIES, brake_m_s2=0.5)
    with pytest.raises(RobotUnavailable, match=r"brake_m_s2 is 0\.5, promised 1\.0"):
        robot.init(1.0)
