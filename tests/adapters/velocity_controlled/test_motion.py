from __future__ import annotations

import math

import pytest

from soter.adapters.velocity_controlled.motion import Charge, MeasuredMotion


def test_where_it_will_be() -> None:
    later = MeasuredMotion(0.0, 1.0, 1.0, 0.0, 0.2, 0.0, math.pi).after(0.5)
    assert later.heading_rad == pytest.approx(math.pi / 2)
    assert (later.x_m, later.y_m) == pytest.approx(
        (1.0 + 0.1 * math.cos(math.pi / 4), 1.0 + 0.1 * math.sin(math.pi / 4))
    )


def test_between_two_reports_a_battery_is_taken_to_be_driving() -> None:
    charge = Charge(100.0, 0.5)
    assert charge.at_least(100.0, 0.001) == 0.5
    assert charge.at_least(110.0, 0.001) == pytest.approx(0.49)
    assert charge.at_least(90.0, 0.001) == 0.5, "a clock that went back charges nothing"
    assert charge.at_least(1e6, 0.001) == 0.0
