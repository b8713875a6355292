"""The mission protocol, and missions that are really driven and flown."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.frames import Origin
from tests.sim.mavlink.client import ACCEPTED, FAILED, Client, Message, Rig

WAYPOINT, TAKE_OFF, LAND = mav.MAV_CMD_NAV_WAYPOINT, mav.MAV_CMD_NAV_TAKEOFF, mav.MAV_CMD_NAV_LAND
HOME, DELAY, SPEED = mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_NAV_DELAY, mav.MAV_CMD_DO_CHANGE_SPEED
RELATIVE = mav.MAV_FRAME_GLOBAL_RELATIVE_ALT
AUTO = {"rover": 10, "copter": 3}

Item = tuple[int, Sequence[float], float | None, float | None, float]
"""Command, its first four parameters, metres east and north, height."""


def at(east_m: float, north_m: float, up_m: float = 0.0, wait_s: float = 0.0, command: int = WAYPOINT) -> Item:
    """An item with a place."""
    return command, (wait_s, 0, 0, 0), east_m, north_m, up_m


def do(command: int, *params: float, up_m: float = 0.0) -> Item:
    """An item without one."""
    return command, (*params, *[0.0] * (4 - len(params))), None, None, up_m


def packed(seq: int, item: Item, frame: int = RELATIVE) -> Message:
    """MISSION_ITEM_INT of an item."""
    command, params, east_m, north_m, up_m = item
    x = y = 0
    if east_m is not None and north_m is not None:
        x, y = Origin().geodetic_e7(east_m, north_m)
    return mav.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *params, x, y, up_m, 0)


def upload(rig: Rig, *items: Item, by: Client | None = None, frame: int = RELATIVE) -> int:
    """Upload a mission and return the result."""
    client = by or rig.client
    # Number 0 is home.
    sent = [at(0.0, 0.0), *items]
    client.take("MISSION_ACK")
    client.send(mav.MAVLink_mission_count_message(1, 1, len(sent), 0))
    for _ in range(len(sent) + 2):
        rig.run(rig.period_s)
        for request in client.take("MISSION_REQUEST_INT"):
            assert (request.target_system, request.target_component) == (client.system, client.component)
            client.send(packed(request.seq, sent[request.seq], RELATIVE if request.seq == 0 else frame))
    acks = client.take("MISSION_ACK")
    assert len(acks) == 1
    return int(acks[0].type)


def download(rig: Rig, name: str = "MISSION_ITEM_INT") -> list[Message]:
    """Download the mission."""
    client = rig.client
    request = getattr(mav, f"MAVLink_mission_request{'_int' if name.endswith('INT') else ''}_message")
    client.send(mav.MAVLink_mission_request_list_message(1, 1, 0))
    rig.run(rig.period_s)
    found = []
    for seq in range(client.take("MISSION_COUNT")[-1].count):
        client.send(request(1, 1, seq, 0))
        rig.run(rig.period_s)
        found += client.take(name)
    client.send(mav.MAVLink_mission_ack_message(1, 1, 0, 0))
    return found


def start(rig: Rig, vehicle: str = "rover") -> None:
    """Arm and begin."""
    rig.guided()
    assert rig.mode(AUTO[vehicle]) == ACCEPTED


def test_what_was_uploaded_comes_back_with_home_before_it() -> None:
    with Rig() as rig:
        assert upload(rig, at(6.0, 5.0, wait_s=1.5), do(DELAY, 2.0), do(HOME)) == mav.MAV_MISSION_ACCEPTED
        for name in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            items = download(rig, name)
            assert [item.seq for item in items] == [0, 1, 2, 3]
            assert [item.command for item in items] == [WAYPOINT, WAYPOINT, DELAY, HOME]
            assert (items[1].param1, items[2].param1) == (1.5, 2.0)
            scale = 1.0 if name.endswith("INT") else 1e7
            for item, place in ((items[0], (5.0, 5.0)), (items[1], (6.0, 5.0))):
                assert Origin().local_m(item.x * scale, item.y * scale) == pytest.approx(place, abs=0.5)
        items = download(rig)
        assert Origin().local_m(items[1].x, items[1].y) == pytest.approx((6.0, 5.0), abs=0.01)


def test_a_rover_drives_its_mission_and_says_what_it_reaches() -> None:
    with Rig() as rig:
        assert upload(rig, at(6.0, 5.0, wait_s=2.0), do(SPEED, 1, 0.1), at(6.0, 5.5), do(DELAY, 1.0)) == 0
        start(rig)
        rig.run(1.0)
        current = rig.client.take("MISSION_CURRENT")[-1]
        assert (current.seq, current.total, current.mission_state) == (1, 4, mav.MISSION_STATE_ACTIVE)
        rig.until(lambda: rig.at()[0] > 5.95, 10.0)
        rig.run(1.0)
        assert rig.client.take("MISSION_ITEM_REACHED") == []
        rig.run(3.0)
        assert rig.speed() == pytest.approx(0.1)
        rig.run(8.0)
        assert [each.seq for each in rig.client.take("MISSION_ITEM_REACHED")] == [1, 2, 3, 4]
        assert rig.client.take("MISSION_CURRENT")[-1].mission_state == mav.MISSION_STATE_COMPLETE
        assert rig.at() == pytest.approx((6.0, 5.5), abs=0.05)
        assert rig.speed() == 0.0
        assert rig.autopilot.mode.value == "AUTO"


def test_a_mission_is_paused_by_another_mode_and_goes_on() -> None:
    with Rig() as rig:
        upload(rig, at(6.0, 5.0), at(6.0, 6.0))
        start(rig)
        rig.run(8.0)
        assert rig.mode(4) == ACCEPTED
        rig.run(2.0)
        stopped = rig.at()
        paused = rig.client.take("MISSION_CURRENT")[-1]
        assert (paused.seq, paused.mission_state) == (2, mav.MISSION_STATE_PAUSED)
        rig.run(2.0)
        assert rig.at() == stopped
        assert rig.command(mav.MAV_CMD_MISSION_START) == ACCEPTED
        rig.run(8.0)
        assert rig.at() == pytest.approx((6.0, 6.0), abs=0.1)
        # Once done, it begins anew.
        rig.mode(4)
        rig.mode(10)
        rig.run(8.0)
        assert rig.at()[1] < 5.9


def test_the_current_item_can_be_chosen() -> None:
    with Rig() as rig:
        upload(rig, at(9.0, 5.0), at(5.0, 6.0))
        rig.client.send(mav.MAVLink_mission_set_current_message(1, 1, 2))
        rig.run(0.1)
        assert rig.client.take("MISSION_CURRENT")[-1].seq == 2
        start(rig)
        rig.run(8.0)
        assert rig.at() == pytest.approx((5.0, 6.0), abs=0.1)
        rig.client.texts()
        rig.client.send(mav.MAVLink_mission_set_current_message(1, 1, 9))
        rig.run(0.1)
        assert "Refused: no mission item 9" in rig.client.texts()
        assert rig.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, 1) == ACCEPTED
        for bad in (9, -1, math.nan):
            assert rig.command(mav.MAV_CMD_DO_SET_MISSION_CURRENT, bad) == FAILED
        rig.run(5.0)
        assert rig.at()[0] > 5.1


def test_rtl_as_the_last_item_brings_a_rover_home() -> None:
    with Rig() as rig:
        upload(rig, at(6.0, 5.0), do(HOME))
        start(rig)
        rig.run(25.0)
        assert rig.at() == pytest.approx((5.0, 5.0), abs=0.1)


def test_a_copter_flies_its_mission_lands_and_disarms() -> None:
    with Rig(vehicle="copter") as rig:
        assert upload(rig, do(TAKE_OFF, up_m=1.2), at(6.0, 5.0, 1.5), at(6.0, 5.5, command=LAND)) == 0
        start(rig, "copter")
        highest_m = 0.0
        while rig.autopilot.armed:
            rig.run(rig.period_s)
            highest_m = max(highest_m, rig.autopilot.sample().z_m)
        assert highest_m == pytest.approx(1.5, abs=0.05)
        assert rig.at() == pytest.approx((6.0, 5.5), abs=0.1)
        assert [each.seq for each in rig.client.take("MISSION_ITEM_REACHED")] == [1, 2, 3]


def test_a_copter_on_the_ground_needs_a_take_off_first() -> None:
    with Rig(vehicle="copter") as rig:
        upload(rig, at(6.0, 5.0, 1.5))
        rig.guided()
        assert rig.mode(AUTO["copter"]) == FAILED


def test_heights_above_the_sea_are_understood() -> None:
    with Rig(vehicle="copter") as rig:
        assert upload(rig, do(TAKE_OFF, up_m=489.5), at(5.5, 5.0, 489.0), frame=mav.MAV_FRAME_GLOBAL) == 0
        start(rig, "copter")
        rig.run(15.0)
        assert rig.autopilot.sample().z_m == pytest.approx(1.0, abs=0.05)


NAN = math.nan
REFUSED = [
    ([at(6.0, 5.0, command=TAKE_OFF)], RELATIVE, mav.MAV_MISSION_UNSUPPORTED),
    ([do(mav.MAV_CMD_DO_PARACHUTE)], RELATIVE, mav.MAV_MISSION_UNSUPPORTED),
    ([at(6.0, 5.0)], mav.MAV_FRAME_LOCAL_NED, mav.MAV_MISSION_UNSUPPORTED_FRAME),
    ([at(6.0, 5.0, wait_s=NAN)], RELATIVE, mav.MAV_MISSION_INVALID_PARAM1),
    ([do(SPEED, 1, NAN)], RELATIVE, mav.MAV_MISSION_INVALID_PARAM2),
    ([at(6.0, 5.0, NAN)], RELATIVE, mav.MAV_MISSION_INVALID_PARAM7),
    ([at(6.0, 50_000.0)], RELATIVE, mav.MAV_MISSION_INVALID_PARAM5_X),
    ([at(-50_000.0, 5.0)], RELATIVE, mav.MAV_MISSION_INVALID_PARAM6_Y),
]


@pytest.mark.parametrize(("items", "frame", "result"), REFUSED)
def test_an_item_that_cannot_be_refuses_the_whole_mission(items: list[Item], frame: int, result: int) -> None:
    with Rig() as rig:
        assert upload(rig, at(6.0, 5.0)) == mav.MAV_MISSION_ACCEPTED
        before = rig.autopilot.mission.items
        assert upload(rig, at(7.0, 5.0), *items, frame=frame) in (result, mav.MAV_MISSION_UNSUPPORTED_FRAME)
        assert rig.autopilot.mission.items == before
        rig.client.send(mav.MAVLink_mission_item_int_message(1, 1, 0, 0, WAYPOINT, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0))
        rig.run(rig.period_s)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_ERROR


def test_items_in_degrees_are_taken_too() -> None:
    with Rig() as rig:
        rig.client.send(mav.MAVLink_mission_count_message(1, 1, 2, 0))
        rig.run(rig.period_s)
        item = mav.MAVLink_mission_item_message
        for seq in (0, 1):
            rig.client.send(item(1, 1, seq, RELATIVE, WAYPOINT, 0, 1, 0, 0, 0, 0, 47.3978, 8.5457, 0, 0))
        rig.run(rig.period_s)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_ACCEPTED
        assert rig.autopilot.mission.items[0].x == pytest.approx(473_978_000, abs=40)
        rig.client.send(mav.MAVLink_mission_count_message(1, 1, 2, 0))
        rig.run(rig.period_s)
        rig.client.send(item(1, 1, 0, RELATIVE, WAYPOINT, 0, 1, 0, 0, 0, 0, NAN, 8.5457, 0, 0))
        rig.run(rig.period_s)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_INVALID_PARAM5_X


def test_an_upload_is_asked_for_again_and_then_given_up() -> None:
    with Rig() as rig:
        upload(rig, at(6.0, 5.0))
        rig.client.send(mav.MAVLink_mission_count_message(1, 1, 3, 0))
        rig.run(5.0)
        assert {each.seq for each in rig.client.take("MISSION_REQUEST_INT")} == {0}
        other = rig.connect(254, 1)
        other.send(mav.MAVLink_mission_count_message(1, 1, 2, 0))
        rig.run(0.1)
        assert other.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_DENIED
        rig.client.send(packed(2, at(6.0, 6.0)))
        rig.run(0.1)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_INVALID_SEQUENCE
        rig.run(9.0)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_OPERATION_CANCELLED
        assert len(rig.autopilot.mission.items) == 1


def test_a_repeated_item_changes_nothing() -> None:
    with Rig() as rig:
        rig.client.send(mav.MAVLink_mission_count_message(1, 1, 3, 0))
        for seq in (0, 0, 1, 0, 1, 2):
            rig.client.send(packed(seq, at(6.0 + seq, 5.0)))
        rig.run(rig.period_s)
        assert rig.client.take("MISSION_ACK")[-1].type == mav.MAV_MISSION_ACCEPTED
        places = [item.place(Origin())[0] for item in rig.autopilot.mission.items]
        assert places == pytest.approx([7.0, 8.0], abs=0.01)


def test_clearing_and_what_there_is_no_room_or_no_use_for() -> None:
    with Rig() as rig:
        client = rig.client

        def answer(message: Message) -> int:
            client.take("MISSION_ACK")
            client.send(message)
            rig.run(rig.period_s)
            return int(client.take("MISSION_ACK")[-1].type)

        upload(rig, at(6.0, 5.0))
        rally = mav.MAV_MISSION_TYPE_RALLY
        assert answer(mav.MAVLink_mission_count_message(1, 1, 701, 0)) == mav.MAV_MISSION_NO_SPACE
        assert answer(mav.MAVLink_mission_count_message(1, 1, 2, rally)) == mav.MAV_MISSION_UNSUPPORTED
        assert answer(mav.MAVLink_mission_request_int_message(1, 1, 0, rally)) == mav.MAV_MISSION_UNSUPPORTED
        assert answer(mav.MAVLink_mission_request_int_message(1, 1, 7, 0)) == mav.MAV_MISSION_INVALID_SEQUENCE
        client.send(mav.MAVLink_mission_request_list_message(1, 1, rally))
        rig.run(rig.period_s)
        assert client.take("MISSION_COUNT")[-1].count == 0
        assert len(rig.autopilot.mission.items) == 1
        assert answer(mav.MAVLink_mission_clear_all_message(1, 1, 0)) == mav.MAV_MISSION_ACCEPTED
        assert download(rig) == []
        upload(rig, at(6.0, 5.0))
        assert answer(mav.MAVLink_mission_count_message(1, 1, 0, 0)) == mav.MAV_MISSION_ACCEPTED
        assert len(rig.autopilot.mission.items) == 0


def test_a_mission_that_is_replaced_under_way_begins_anew() -> None:
    with Rig() as rig:
        upload(rig, at(9.0, 5.0))
        start(rig)
        rig.run(3.0)
        upload(rig, at(5.0, 6.0))
        rig.run(12.0)
        assert rig.at() == pytest.approx((5.0, 6.0), abs=0.1)
        # Cleared under way: it stays where it is.
        upload(rig, at(9.0, 6.0))
        rig.run(3.0)
        rig.client.send(mav.MAVLink_mission_clear_all_message(1, 1, 0))
        rig.run(2.0)
        assert rig.speed() == 0.0
