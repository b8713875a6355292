"""Who may command a vehicle, and for how long: master, keeper, subordinates, lease."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.sim.mavlink.client import ACCEPTED, CUSTOM, DENIED, FAILED, REJECTED, UNSUPPORTED, Client, Rig

SYSTEM, SC, AC = 255, 191, 192
LEASE_S = 0.25
HOLD, AUTO, GUIDED = 4, 10, 15


class Team(Rig):
    """A vehicle in GUIDED, a supervisor that sends as the SC, an AC and an operator."""

    def __init__(self) -> None:
        super().__init__()
        self.sc: Client = self.connect(SYSTEM, SC)
        self.ac: Client = self.connect(SYSTEM, AC)
        self.operator: Client = self.connect(254, 190)
        assert self.master(SYSTEM, SC, self.sc) == ACCEPTED
        assert self.mode(GUIDED, self.sc) == ACCEPTED
        assert self.arm(self.sc) == ACCEPTED

    def keep(self, component: int, duration_s: float) -> None:
        """Renew the lease in every period, as a supervisor does."""
        for _ in range(round(duration_s / self.period_s)):
            self.renew(component)
            self.run(self.period_s)

    def renew(self, component: int, since_ms: int = 0) -> None:
        """Send one renewal, and wait for nothing."""
        number = mav.MAV_CMD_DO_GUIDED_MASTER
        self.sc.send(mav.MAVLink_command_int_message(1, 1, 0, number, 0, 0, SYSTEM, component, 0, 0, since_ms, 0, 0))

    def heading_for(self) -> tuple[float, float] | None:
        """The target that the vehicle has."""
        target = self.autopilot.guided.target()
        return None if target is None else (target.x_m, target.y_m)  # type: ignore[union-attr]

    def reported(self) -> int:
        """What the vehicle last said of who is in charge."""
        return int(self.operator.take("NAMED_VALUE_INT")[-1].value)


@pytest.fixture
def team() -> Iterator[Team]:
    with Team() as team:
        yield team


def test_only_the_masters_targets_are_obeyed(team: Team) -> None:
    team.renew(AC)
    team.run(team.period_s)
    for client in (team.sc, team.operator, team.client):
        team.target(9.0, 5.0, by=client)
    team.keep(AC, 1.0)
    assert team.heading_for() is None
    assert team.at() == (5.0, 5.0)
    team.target(9.0, 5.0, by=team.ac)
    team.keep(AC, 1.0)
    assert team.heading_for() == (9.0, 5.0)
    assert team.speed() > 0.2


def test_a_change_of_master_drops_the_target_and_the_vehicle_brakes(team: Team) -> None:
    team.renew(AC)
    team.target(9.0, 5.0, by=team.ac)
    team.run(team.period_s)
    team.target(9.0, 5.0, by=team.ac)
    team.keep(AC, 2.0)
    before_m = team.at()[0]
    team.keep(SC, team.period_s)
    assert team.heading_for() is None
    team.target(9.0, 5.0, by=team.ac)
    team.keep(SC, 1.0)
    assert team.speed() == 0.0
    assert team.at()[0] - before_m < 0.0242 + 0.22 * 2.0 * team.period_s
    # Naming the AC again brings nothing back.
    team.keep(AC, 1.0)
    assert team.speed() == 0.0


def test_the_lease_ends_on_the_vehicles_own_clock_and_stops_it(team: Team) -> None:
    team.target(9.0, 5.0, by=team.sc)
    team.keep(SC, 2.0)
    assert team.speed() == pytest.approx(0.22)
    # Neither targets nor heartbeats renew it.
    moving_s = 0.0
    while team.speed() > 0.2:
        team.target(9.0, 5.0, by=team.sc)
        team.sc.send(mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))
        team.run(team.period_s)
        moving_s += team.period_s
    assert LEASE_S - 2.0 * team.period_s <= moving_s <= LEASE_S + 2.0 * team.period_s
    team.run(1.0)
    assert team.speed() == 0.0
    assert team.reported() == -(256 * SYSTEM + SC)
    # Who renews it has judged the vehicle safe: the target is still there.
    team.keep(SC, 1.0)
    assert team.speed() > 0.2
    assert team.reported() == 256 * SYSTEM + SC


def test_the_lease_lasts_as_long_as_the_parameter_says(team: Team) -> None:
    team.renew(SC)
    team.sc.send(mav.MAVLink_param_set_message(1, 1, b"SOTER_LEASE_MS", 1000, mav.MAV_PARAM_TYPE_INT32))
    team.target(9.0, 5.0, by=team.sc)
    team.keep(SC, 2.0)
    team.run(0.9)
    assert team.speed() == pytest.approx(0.22)
    team.run(0.2)
    assert team.speed() < 0.2


def test_a_renewal_counts_from_when_it_was_sent(team: Team) -> None:
    team.target(9.0, 5.0, by=team.sc)
    team.keep(SC, 1.0)
    now_ms = team.autopilot.boot_ms
    # It has been under way for 0.2 s.
    team.run(0.2)
    team.renew(SC, now_ms)
    team.run(team.period_s)
    assert team.autopilot.guided.alive(team.autopilot.now_s)
    team.run(0.05)
    assert not team.autopilot.guided.alive(team.autopilot.now_s)
    # One from the future counts from now.
    team.renew(SC, team.autopilot.boot_ms + 60_000)
    team.run(LEASE_S + 2.0 * team.period_s)
    assert not team.autopilot.guided.alive(team.autopilot.now_s)


def test_a_change_of_master_that_was_overtaken_changes_nothing(team: Team) -> None:
    team.keep(SC, 0.5)
    earlier_ms = team.autopilot.boot_ms - 50
    assert team.master(SYSTEM, SC, team.sc, since_ms=team.autopilot.boot_ms) == ACCEPTED
    assert team.master(SYSTEM, AC, team.sc, since_ms=earlier_ms) == REJECTED
    assert team.autopilot.guided.master == (SYSTEM, SC)


def test_a_target_that_was_overtaken_is_dropped(team: Team) -> None:
    def packet(east_m: float, seq: int) -> bytes:
        sender = mav.MAVLink(None, SYSTEM, SC)
        sender.seq = seq
        message = mav.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x0DF8, 5.0, east_m, 0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        return message.pack(sender)

    for seq, east_m in ((254, 6.0), (1, 7.0), (255, 8.0)):
        team.sc.send_raw(packet(east_m, seq))
    team.run(team.period_s)
    assert team.heading_for() == (7.0, 5.0)
    # Who begins to count anew is heard again after a while.
    team.keep(SC, 6.0)
    team.sc.send_raw(packet(8.0, 200))
    team.run(team.period_s)
    assert team.heading_for() == (8.0, 5.0)


def test_while_the_lease_lives_nobody_else_can_name_a_master(team: Team) -> None:
    for client in (team.ac, team.operator):
        team.renew(SC)
        assert team.master(client.system, client.component, client) == DENIED
    assert f"Denied: {SYSTEM}/{AC} is not in command" in team.client.texts()
    assert team.autopilot.guided.master == (SYSTEM, SC)


def test_a_subordinate_sends_targets_and_nothing_else_even_when_the_lease_is_dead(team: Team) -> None:
    team.renew(AC)
    team.run(1.0)
    assert not team.autopilot.guided.alive(team.autopilot.now_s)
    assert team.master(SYSTEM, AC, team.ac) == DENIED
    assert team.mode(AUTO, team.ac) == DENIED
    assert team.mode(HOLD, team.ac) == DENIED
    assert team.disarm(team.ac) == DENIED
    assert team.command(mav.MAV_CMD_DO_CHANGE_SPEED, 1, 0.1, by=team.ac) == DENIED
    assert team.command_int(mav.MAV_CMD_DO_REPOSITION, -1, 1, by=team.ac) == DENIED
    team.ac.send(mav.MAVLink_set_mode_message(1, CUSTOM, HOLD))
    team.ac.send(mav.MAVLink_param_set_message(1, 1, b"SOTER_LEASE_MS", 5000, mav.MAV_PARAM_TYPE_INT32))
    team.ac.send(mav.MAVLink_mission_count_message(1, 1, 2, 0))
    team.ac.send(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    team.ac.send(mav.MAVLink_mission_set_current_message(1, 1, 0))
    team.run(0.2)
    assert team.ac.take("COMMAND_ACK")[-1].result == DENIED
    assert team.ac.take("PARAM_VALUE")[-1].param_value == 250
    assert {ack.type for ack in team.ac.take("MISSION_ACK")} == {mav.MAV_MISSION_DENIED}
    assert team.autopilot.mode.value == "GUIDED"
    # Looking is free.
    assert team.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_ATTITUDE, by=team.ac) == ACCEPTED


def test_an_operator_may_stop_it_at_any_time_and_take_over_when_the_lease_is_dead(team: Team) -> None:
    team.renew(SC)
    team.run(team.period_s)
    assert team.mode(11, team.operator) == DENIED
    team.renew(SC)
    assert team.arm(team.operator) == DENIED
    team.target(9.0, 5.0, by=team.sc)
    team.keep(SC, 2.0)
    assert team.mode(HOLD, team.operator) == ACCEPTED
    team.keep(SC, 1.0)
    assert team.speed() == 0.0
    assert team.mode(GUIDED, team.operator) == DENIED
    team.run(1.0)
    assert team.mode(GUIDED, team.operator) == ACCEPTED
    assert team.master(254, 190, team.operator) == ACCEPTED
    team.target(5.0, 6.0, by=team.operator)
    team.run(team.period_s)
    assert team.heading_for() == (5.0, 6.0)


def test_the_keeper_gives_the_vehicle_back_to_everybody(team: Team) -> None:
    team.target(9.0, 5.0, by=team.sc)
    team.keep(AC, 0.1)
    assert team.master(0, 0, team.sc) == ACCEPTED
    assert team.reported() == 0
    assert team.heading_for() is None
    assert team.mode(HOLD, team.ac) == ACCEPTED
    assert team.mode(GUIDED, team.operator) == ACCEPTED
    team.target(9.0, 5.0, by=team.operator)
    # Without a lease it goes on by itself.
    team.run(3.0)
    assert team.speed() == pytest.approx(0.22)


def test_who_is_in_charge_is_said_at_once_and_can_be_streamed(team: Team) -> None:
    team.operator.heard.clear()
    team.renew(AC)
    team.run(team.period_s)
    assert team.reported() == 256 * SYSTEM + AC
    number = mav.MAVLINK_MSG_ID_NAMED_VALUE_INT
    assert team.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, number, 50_000, by=team.operator) == ACCEPTED
    team.operator.heard.clear()
    team.keep(AC, 1.0)
    values = team.operator.take("NAMED_VALUE_INT")
    assert len(values) == 20
    assert {(each.name, each.value) for each in values} == {("GMASTER", 256 * SYSTEM + AC)}


@pytest.mark.parametrize("params", [(256.0, 1.0), (1.0, -1.0), (math.nan, 1.0), (1.0, math.inf)])
def test_masters_that_cannot_be_are_denied(team: Team, params: tuple[float, float]) -> None:
    assert team.command(mav.MAV_CMD_DO_GUIDED_MASTER, *params, by=team.sc) == DENIED
    assert team.command(mav.MAV_CMD_DO_GUIDED_MASTER, SYSTEM, SC, 0, 0, math.nan, by=team.sc) == DENIED
    assert team.autopilot.guided.master == (SYSTEM, SC)


def test_repositions_are_the_masters_too(team: Team) -> None:
    team.renew(AC)
    team.run(team.period_s)
    assert team.command_int(mav.MAV_CMD_DO_REPOSITION, -1, 0, x=1, y=1, by=team.sc) == DENIED
    team.keep(SC, 0.1)
    assert team.command_int(mav.MAV_CMD_DO_REPOSITION, -1, 0, x=1, y=1, by=team.sc) == ACCEPTED


def test_a_plain_autopilot_knows_nothing_of_all_this() -> None:
    with Rig(plain=True) as rig:
        assert rig.master(255, 191) == UNSUPPORTED
        assert not any(name.startswith("SOTER") for name in rig.autopilot.parameters.names)
        assert rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_NAMED_VALUE_INT) == FAILED
        rig.guided()
        rig.target(9.0, 5.0, by=rig.connect(1, 1))
        rig.run(3.0)
        assert rig.speed() == pytest.approx(0.22)
