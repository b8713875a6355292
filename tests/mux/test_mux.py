"""Who may move a robot, and for how long."""

from __future__ import annotations

import math

import pytest

from soter.mux import Mux


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
