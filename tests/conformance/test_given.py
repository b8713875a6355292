"""Robots that the kit did not start: their room, their way back, what cannot be tried of them; and measuring them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from soter.adapters.mavlink.backend import MavlinkBackend
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.pybullet.backend import KinematicBackend, KinematicConfig
from soter.conformance import CLAUSES, Overall, Verdict, Workshop, find_harness, judge, select
from soter.conformance.bench import Bench
from soter.conformance.figure import Failed
from soter.conformance.given import Given, GivenHarness
from soter.conformance.record import overall
from soter.conformance.survey import survey
from soter.errors import ConfigError
from soter.geometry.draft import Draft, Outline, Spot, circle, site_of
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Controller, Fleet, RobotSpec, Waypoint

FIELD = Workspace(20.0, 20.0, (Box(15.0, 15.0, 16.0, 16.0),), (RobotPlace(4, 8.0, 7.0, Box(7.5, 6.5, 8.5, 7.5), 0.4),))


def given(room_m: float = 3.0, **promises: float) -> Given:
    config = KinematicConfig.model_validate({"workspace": FIELD, "promise": promises})
    spec = RobotSpec(4, 8.0, 7.0, 0.4, promised=KinematicBackend.promises(config))
    return Given("kinematic", config, spec, room_m)


class Elsewhere(GivenHarness):
    """Has its robot stand elsewhere than at its start, and turned."""

    off_m = 0.6

    def open(self, robots: int) -> Fleet:
        place = replace(FIELD.robots[0], x_m=8.0 + self.off_m, heading_rad=2.0)
        spec = replace(self._given.spec, x_m=place.x_m, heading_rad=2.0)
        config = KinematicConfig(workspace=replace(FIELD, robots=(place,)))
        fleet = KinematicBackend().open(config, [spec])
        # What the kit is told is where the mission file has it.
        vars(fleet.robots[0])["_Robot__spec"] = self._given.spec
        return fleet


class Two(GivenHarness):
    """Two robots that stand a little off their starts; the kit knows it by its name."""

    robots_most = 2

    def __init__(self) -> None:
        super().__init__(given())

    def open(self, robots: int) -> Fleet:
        starts = (FIELD.robots[0], replace(FIELD.robots[0], id=5, y_m=12.0, charger=Box(7.5, 11.5, 8.5, 12.5)))
        config = KinematicConfig(workspace=replace(FIELD, robots=tuple(replace(at, x_m=8.1) for at in starts)))
        specs = [RobotSpec(at.id, 8.1, at.y_m, 0.4, promised=KinematicBackend.promises(config)) for at in starts]
        fleet = KinematicBackend().open(config, specs[:robots])
        for robot in fleet.robots:
            vars(robot)["_Robot__spec"] = replace(robot.spec, x_m=8.0)
        return fleet


@pytest.mark.parametrize("room_m", [1.9, 13.9])
def test_a_room_that_is_not_free_is_refused(room_m: float) -> None:
    with pytest.raises(ConfigError, match=r"--room: .* allowed: 2 to 13\.8"):
        given(room_m).check(FIELD)
    given(13.7).check(FIELD)
    with pytest.raises(ConfigError, match=r"allowed: 6 to 13\.8"):
        given(5.9).promising(position_noise_m=0.5).check(FIELD)


def test_a_room_in_a_workspace_of_any_shape_is_free_too() -> None:
    draft = Draft("field", [Outline("fence", [(4.0, 0.0), (20.0, 2.0), (16.0, 20.0), (0.0, 16.0)])])
    draft.keep_outs.append(Outline("pond", circle(12.0, 12.0, 1.0, around=True)))
    draft.stations.append(Spot("station 1", 8.0, 7.0))
    field = site_of(draft, phi_safer_m=0.1, spacing_m=0.5)
    given(8.5).check(field)
    with pytest.raises(ConfigError, match=r"--room: .* and a box is 5\.4\d m away; allowed: 2 to 10\.6"):
        given(11.0).check(field)


def test_what_holds_for_simulated_robots_does_not_for_it() -> None:
    harness = GivenHarness(given(3.5))
    # Several programs at once would drive one real robot, and nobody told its truth what to judge by.
    assert not harness.side_by_side
    assert harness.limits is None
    assert (harness.room_m, harness.leg_m, harness.robots_most) == (3.5, 0.0, 1)
    assert (harness.starts_robots, harness.charges_at_start, harness.contacts) == (False, False, False)


def test_it_is_driven_back_to_the_middle_of_its_room_before_each_clause() -> None:
    harness = Elsewhere(given())
    record = judge(harness, select(["goto.arrives", "deadman.silence", "bounds.rest"]))
    tried = {each.clause.id: each.verdict for each in record.outcomes}
    assert set(tried) >= {"bounds.rest", "truth.goto.arrives", "truth.deadman.silence"}
    assert set(tried.values()) == {Verdict.PASS}


def test_one_that_stands_outside_of_its_room_is_not_moved() -> None:
    harness = Elsewhere(given())
    harness.off_m = 1.6
    (outcome,) = judge(harness, [CLAUSES["goto.arrives"]]).outcomes
    assert outcome.verdict is Verdict.FAIL
    assert "stands 1.6 m from its start" in outcome.reason


def test_one_that_leaves_its_room_is_stopped() -> None:
    bench = Bench(GivenHarness(given()))
    robot = bench.open_one()
    robot.goto(Waypoint(12.0, 7.0), Controller.AC)
    with pytest.raises(Failed, match=r"stopped 1\.5 m from its start"):
        bench.run(60.0)
    bench.close()


def test_what_cannot_be_tried_is_named_and_costs_the_whole_verdict() -> None:
    record = judge(find_harness(given()), select(["several.ids", "process.killed", "link.age", "state.start"]))
    missing = {each.clause.id: each.reason for each in record.outcomes if each.verdict is Verdict.NOT_TESTED}
    assert not record.count(Verdict.FAIL)
    assert "needs 2 robots" in missing["several.ids"]
    assert "start_driver" in missing["process.killed"]
    assert "starts_robots" in missing["state.start"]
    assert overall(record.outcomes, in_process=False, given=True) is Overall.AS_FAR
    assert overall(record.outcomes, in_process=False) is Overall.FAILS


def test_two_robots_that_were_driven_back_to_about_their_starts_are_not_taken_for_each_other() -> None:
    record = judge(Two(), [CLAUSES["several.ids"], CLAUSES["several.second"]])
    assert {each.verdict for each in record.outcomes} == {Verdict.PASS}, [each.reason for each in record.outcomes]


def test_robots_of_a_harness_that_does_not_start_them_are_given_by_its_name_too() -> None:
    with Workshop(f"{__name__}:{Two.__name__}") as workshop:
        assert workshop.given


@pytest.mark.parametrize(("noise_m", "verdict"), [(0.15, Verdict.PASS), (0.25, Verdict.NOT_TESTED)])
def test_ways_are_judged_as_well_as_a_robot_knows_where_it_is(noise_m: float, verdict: Verdict) -> None:
    # It is taken for there when it is as near as that, and legs that are no longer say nothing.
    record = judge(GivenHarness(given(3.0, position_noise_m=noise_m)), select(["state.frame"]))
    (truth,) = [each for each in record.outcomes if each.clause.id == "truth.state.frame"]
    assert truth.verdict is verdict, truth.reason


@pytest.mark.parametrize(("v_max_m_s", "still_m"), [(0.22, 0.005), (1.0, 0.02)])
def test_who_has_driven_fast_may_come_to_rest_as_slowly_as_that(v_max_m_s: float, still_m: float) -> None:
    # Of an ArduRover 15 mm were seen in the second after it had to be at rest from 0.95 m/s.
    bench = Bench(GivenHarness(given(3.0, v_max_m_s=v_max_m_s)), truth=True)
    bench.open_one()
    assert bench.still_m == pytest.approx(still_m)
    bench.close()


def test_measuring_finds_what_a_robot_does_and_what_was_promised_too_well() -> None:
    # It is built for what it promises; what it is said to promise here is something else.
    better = {"brake_m_s2": 3.0, "latency_s": 0.0, "v_max_m_s": 1.0}
    started = given(6.0)
    found = survey(started.promising(**better), margin=0.2)
    said = {each.name: each for each in found.advice}
    assert found.complete
    assert said["v_max_m_s"].measured == pytest.approx(1.0, rel=0.01)
    assert said["brake_m_s2"].declared == pytest.approx(0.8 * said["brake_m_s2"].measured, rel=0.01)  # type: ignore[operator]
    assert said["tube_m"].judge == "truth"
    assert said["body_radius_m"].measured is None
    assert "body_radius_m" not in found.table


def test_the_table_says_what_makes_the_backend_declare_what_was_found() -> None:
    from soter.conformance.survey import _table

    options: dict[str, Any] = {"connection": "udpin:127.0.0.1:14550", "stream_hz": 20.0, "speedup": 2.0}
    config = MavlinkConfig(workspace=FIELD, promise={"setpoint_period_s": 0.1}, **options)
    wanted = {"latency_s": 0.5, "sample_age_s": 0.25, "jitter_s": 0.04, "setpoint_period_s": 0.2, "brake_m_s2": 0.7}
    table = _table(Given("mavlink", config, RobotSpec(4, 8.0, 7.0, 0.0), 4.0), wanted)
    declared = MavlinkBackend.promises(MavlinkConfig(workspace=FIELD, promise=table, **options))
    assert {name: getattr(declared, name) for name in wanted} == pytest.approx(wanted, abs=2e-4)
    assert table["latency_s"] == pytest.approx(0.15)
    assert math.isclose(table["sample_age_s"], 0.1)
