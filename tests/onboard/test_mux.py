"""Who may move a robot, and for how long."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.onboard.mux import Mux


def make(**options: float) -> Mux[str, int]:
    """A gate with the SC in charge and a lease of 0.2 s."""
    return Mux("SC", 0.2, **options)


def test_nothing_passes_before_the_first_renewal() -> None:
    mux = make()
    assert mux.give("SC", 1, 0.0)
    assert mux.passing(0.0) is None
    mux.renew(0.0)
    assert mux.passing(0.0) == 1


def test_the_command_of_the_other_controller_is_refused_and_changes_nothing() -> None:
    mux = make()
    mux.renew(0.0)
    mux.give("SC", 1, 0.0)
    assert not mux.give("AC", 2, 0.0)
    assert mux.passing(0.0) == 1
    assert mux.in_charge == "SC"


def test_a_switch_drops_the_other_controllers_command() -> None:
    mux = make()
    mux.renew(0.0)
    mux.give("SC", 1, 0.0)
    assert mux.switch("AC")
    assert mux.passing(0.0) is None
    assert not mux.give("SC", 1, 0.0)
    assert mux.give("AC", 2, 0.0)
    assert mux.passing(0.0) == 2


def test_a_switch_to_the_same_controller_is_no_change() -> None:
    mux = make()
    mux.renew(0.0)
    mux.give("SC", 1, 0.0)
    assert not mux.switch("SC")
    assert mux.passing(0.0) == 1


def test_a_stale_lease_stops_and_a_renewed_one_lets_the_command_pass_again() -> None:
    mux = make()
    mux.renew(1.0)
    mux.give("SC", 1, 1.0)
    assert mux.passing(1.199) == 1
    assert mux.passing(1.2) is None
    assert not mux.alive(1.2)
    mux.renew(1.3)
    assert mux.passing(1.3) == 1


def test_a_lease_does_not_outlive_its_time_by_rounding() -> None:
    mux = make()
    mux.renew(0.1)
    mux.give("SC", 1, 0.1)
    assert 0.1 + 0.2 > 0.3
    assert mux.passing(0.3) is None


def test_a_clock_that_went_back_ends_the_lease() -> None:
    mux = make()
    mux.renew(100.0)
    mux.give("SC", 1, 100.0)
    assert mux.passing(0.5) is None
    assert mux.passing(100.1) is None, "it does not live again when the clock shows that time once more"
    mux.renew(100.2)
    assert mux.passing(100.2) == 1


@given(st.lists(st.tuples(st.booleans(), st.integers(-300, 100)), max_size=30))
def test_however_the_clock_goes_a_lease_lives_only_while_it_goes_on(steps_ms: list[tuple[bool, int]]) -> None:
    mux = make()
    now_s, lived_s = 100.0, math.inf
    for renews, step_ms in steps_ms:
        now_s += step_ms / 1000.0
        lived_s = lived_s + step_ms / 1000.0 if step_ms >= 0 else math.inf
        alive = mux.alive(now_s)
        assert alive <= (lived_s < 0.2 + 1e-6)
        if renews:
            mux.renew(now_s)
            lived_s = 0.0


def test_a_streamed_command_dies_by_itself_though_the_lease_lives() -> None:
    mux = make(command_s=0.5)
    mux.give("SC", 1, 0.0)
    mux.renew(0.4)
    assert mux.passing(0.45) == 1
    mux.renew(0.5)
    assert mux.passing(0.5) is None
    assert mux.alive(0.5)


def test_halt_drops_the_command_and_revoke_the_lease_too() -> None:
    mux = make()
    mux.renew(0.0)
    mux.give("SC", 1, 0.0)
    mux.halt()
    assert mux.passing(0.0) is None
    mux.give("SC", 2, 0.0)
    assert mux.passing(0.0) == 2
    mux.revoke()
    mux.give("SC", 3, 0.0)
    assert mux.passing(0.0) is None


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_a_lease_takes_time(value: float) -> None:
    with pytest.raises(ValueError, match="lease_s"):
        Mux("SC", value)
