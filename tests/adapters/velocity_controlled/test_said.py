"""What a mux may have passed on, and what somebody else must have said."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.zenoh.wire import KEPT_S, Said

SPEEDS = st.floats(-3.0, 3.0)
LIMITS = st.floats(0.01, 3.0)


@given(SPEEDS, SPEEDS, LIMITS, LIMITS, st.floats(0.0, KEPT_S))
def test_what_was_asked_for_explains_whatever_a_mux_makes_of_it(
    forward: float, turn: float, v_max: float, yaw_max: float, age_s: float
) -> None:
    said = Said()
    said.note(forward, turn, 10.0)
    limited = max(-v_max, min(v_max, forward)), max(-yaw_max, min(yaw_max, turn))
    assert said.explains(*limited, 10.0 + age_s)
    assert said.explains(0.0, 0.0, 10.0 + age_s)


@given(SPEEDS, SPEEDS, st.floats(0.01, 1.0))
def test_what_is_faster_or_turns_elsewhere_is_somebody_elses(forward: float, turn: float, more: float) -> None:
    said = Said()
    said.note(forward, turn, 10.0)
    assert not said.explains(forward + (more if forward >= 0.0 else -more), turn, 10.0)
    assert not said.explains(forward, -turn - (more if turn >= 0.0 else -more), 10.0)
    assert not said.explains(0.1, 0.1, 10.0 + KEPT_S + 0.1)
