from __future__ import annotations

import math

import pytest

from soter.adapters.velocity_controlled.motion import MeasuredMotion


def test_where_it_will_be() -> None:
    later = MeasuredMotion(0.0, 1.0, 1.0, 0.0, 0.2, 0.0, math.pi).after(0.5)
    assert later.heading_rad == pytest.approx(math.pi / 2)
    assert (later.x_m, later.y_m) == pytest.approx(
        (1.0 + 0.1 * math.cos(math.pi / 4), 1.0 + 0.1 * math.sin(math.pi / 4))
    )
