"""How far ahead is looked comes from one place, `Timing`: who needs it asks there, and nobody works it out alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.adapters.pybullet import KinematicBackend
from soter.check.admission import declare_all
from soter.config import load_mission
from soter.rta import DecisionModule, SpeedBound, Timing
from soter.stack import assembly, declaration
from soter.stack.declaration import timing_of
from soter.stack.peers import PeerBounds
from tests.project.source import ROOT
from tests.rta.doubles import TICK_S, module

MISSION = load_mission(ROOT / "examples" / "surveillance.toml", {"backend": "kinematic"})
ROOM = MISSION.read_workspace()
SECONDS = st.floats(0.0, 1.0)
PROMISED = st.builds(
    replace, st.just(KinematicBackend.robot_class.declared), latency_s=SECONDS, sample_age_s=SECONDS, jitter_s=SECONDS,
    lease_s=st.floats(0.05, 2.0), v_max_m_s=st.floats(0.05, 2.0), brake_m_s2=st.floats(0.2, 3.0),
)  # fmt: skip
DELTAS = st.integers(1, 40).map(lambda ticks: ticks * TICK_S)


@given(PROMISED, DELTAS, st.one_of(st.none(), st.floats(0.1, 30.0)))
def test_every_horizon_is_that_of_timing(promised: Any, delta_s: float, ahead_s: float | None) -> None:
    """Also where `Timing` says something else than it does: so nobody has a formula of their own."""
    with pytest.MonkeyPatch.context() as patch:
        if ahead_s is not None:
            patch.setattr(Timing, "ahead_s", lambda *_: ahead_s)
        timing = timing_of(promised, TICK_S)
        ahead = timing.ahead_s(delta_s)
        look_s = ahead + promised.latency_s + promised.jitter_s
        horizon_s = ahead + promised.latency_s + promised.sample_age_s + promised.jitter_s
        assert (timing.look_s(delta_s), timing.horizon_s(delta_s)) == (look_s, horizon_s)

        made = module(delta_s=delta_s)
        assert made.horizon_s(timing) == horizon_s
        assert DecisionModule(made, timing, TICK_S)._look_s == look_s

        # What the paths and the refuges of safe controllers keep: no module is called up there.
        table: Any = SimpleNamespace(delta_s=delta_s, phi_safe_m=0.0, phi_safer_inset_m=0.0)
        asked: Any = SimpleNamespace(
            base_tick_s=TICK_S,
            rta=SimpleNamespace(order=("obstacle", "geofence"), obstacle=table, geofence=table, collision=table),
        )
        speed, unsure_m = SpeedBound(promised.v_max_m_s, promised.brake_m_s2), declaration._unsure_m(promised)
        kept_m = speed.bound(look_s) + unsure_m
        assert declaration._inset_m(asked, promised, 0.0) == kept_m
        assert declaration._inset_m(asked, promised, 0.1) == pytest.approx(kept_m + 0.1)
        assert declaration._home_clearance_m(asked, promised, 0.1) >= kept_m + 0.1 - 1e-9
        assert declaration._home_clearance_m(asked, promised, 0.0) == max(declaration.HOME_CLEARANCE_M, kept_m)
        both_m = assembly._trigger_m(asked, promised, PeerBounds.of((promised,), TICK_S))
        assert both_m == pytest.approx(2.0 * speed.bound(look_s))


@pytest.mark.parametrize("lease_s", [0.1, 0.9])
def test_ways_home_lead_past_where_the_geofence_takes_over_whatever_the_lease(lease_s: float) -> None:
    promised = replace(KinematicBackend.robot_class.declared, lease_s=lease_s)
    made = declare_all(MISSION, ROOM, {1: promised, 2: promised})[1]
    geofence = made.module("geofence")
    assert geofence.model is not None
    reach_m = geofence.model.bound(made.timing.look_s(geofence.delta_s))
    assert declaration._inset_m(MISSION, promised, 0.0) > reach_m
    assert made.refuges.fence_m > geofence.model.bound(geofence.horizon_s(made.timing))
