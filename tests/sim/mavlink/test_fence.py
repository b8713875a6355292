"""The fence that a simulated vehicle holds: what it takes, and what it does when it has left it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter_sim.mavlink.fence import Fence
from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.kinds import Mode
from soter_sim.mavlink.mission import Item
from tests.sim.mavlink.client import ACCEPTED, Client, Rig

FENCE = mav.MAV_MISSION_TYPE_FENCE
INSIDE, OUTSIDE = mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE, NO_CIRCLE = mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, mav.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION


def polygon(command: int, *corners: tuple[float, float], says: float | None = None) -> list[Item]:
    params = (float(len(corners)) if says is None else says, 0.0, 0.0, 0.0)
    return [Item(0, command, params, *Origin().geodetic_e7(*at), 0.0, 1) for at in corners]


def circle(command: int, radius_m: float, east_m: float, north_m: float) -> Item:
    return Item(0, command, (radius_m, 0.0, 0.0, 0.0), *Origin().geodetic_e7(east_m, north_m), 0.0, 1)


ROOM = polygon(INSIDE, (3.0, 3.0), (8.0, 3.0), (8.0, 8.0), (3.0, 8.0))
POND = polygon(OUTSIDE, (6.0, 4.0), (7.0, 4.0), (7.0, 6.0))


def upload(rig: Rig, items: Sequence[Item], by: Client | None = None) -> int:
    """Upload a fence and return the result."""
    client = by or rig.client
    client.take("MISSION_ACK")
    client.send(mav.MAVLink_mission_count_message(1, 1, len(items), FENCE))
    for _ in range(len(items) + 2):
        rig.run(rig.period_s)
        for request in client.take("MISSION_REQUEST_INT"):
            assert request.mission_type == FENCE
            item = items[request.seq]
            client.send(
                mav.MAVLink_mission_item_int_message(
                    1, 1, request.seq, item.frame, item.command, 0, 1, *item.params, item.x, item.y, item.z, FENCE
                )
            )
    (ack,) = client.take("MISSION_ACK")
    assert ack.mission_type == FENCE
    return int(ack.type)


def held(rig: Rig) -> list[tuple[int, float, int, int]]:
    """Download the fence."""
    client = rig.client
    client.send(mav.MAVLink_mission_request_list_message(1, 1, FENCE))
    rig.run(rig.period_s)
    found = []
    for seq in range(client.take("MISSION_COUNT")[-1].count):
        client.send(mav.MAVLink_mission_request_int_message(1, 1, seq, FENCE))
        rig.run(rig.period_s)
        found += [(each.command, each.param1, each.x, each.y) for each in client.take("MISSION_ITEM_INT")]
    return found


def test_what_was_uploaded_comes_back_and_outlives_a_reboot() -> None:
    with Rig() as rig:
        assert held(rig) == []
        assert upload(rig, [*ROOM, *POND]) == ACCEPTED
        sent = [(item.command, item.params[0], item.x, item.y) for item in [*ROOM, *POND]]
        assert held(rig) == sent
        assert rig.command(mav.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == ACCEPTED
        rig.run(1.0)
        assert held(rig) == sent
        rig.client.send(mav.MAVLink_mission_clear_all_message(1, 1, FENCE))
        rig.run(rig.period_s)
        assert held(rig) == []


@pytest.mark.parametrize(
    ("items", "result"),
    [
        (ROOM[:2], mav.MAV_MISSION_INVALID_PARAM1),
        (ROOM[:3], mav.MAV_MISSION_INVALID_PARAM1),
        ([*ROOM[:3], *POND], mav.MAV_MISSION_INVALID),
        (polygon(INSIDE, (3.0, 3.0), (8.0, 3.0), (8.0, 8.0), says=2.5), mav.MAV_MISSION_INVALID_PARAM1),
        (polygon(INSIDE, (3.0, 3.0), (8.0, 3.0), (8.0, 8.0), says=math.nan), mav.MAV_MISSION_INVALID_PARAM1),
        ([circle(CIRCLE, 0.0, 5.0, 5.0)], mav.MAV_MISSION_INVALID_PARAM1),
        ([circle(CIRCLE, math.nan, 5.0, 5.0)], mav.MAV_MISSION_INVALID_PARAM1),
        ([Item(0, mav.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), 1, 1, 0.0, 1)], mav.MAV_MISSION_UNSUPPORTED),
    ],
)
def test_a_fence_that_is_none_is_refused_and_the_one_before_stays(items: list[Item], result: int) -> None:
    with Rig() as rig:
        assert upload(rig, POND) == ACCEPTED
        assert upload(rig, items) == result
        assert len(held(rig)) == len(POND)


@pytest.mark.parametrize(
    ("items", "at", "left"),
    [
        (ROOM, (5.0, 5.0), False), (ROOM, (2.9, 5.0), True), (ROOM, (5.0, 8.1), True),
        ([*ROOM, *POND], (6.8, 4.5), True), ([*ROOM, *POND], (6.2, 5.5), False),
        ([circle(CIRCLE, 2.0, 5.0, 5.0)], (6.9, 5.0), False), ([circle(CIRCLE, 2.0, 5.0, 5.0)], (6.5, 6.5), True),
        ([circle(NO_CIRCLE, 2.0, 5.0, 5.0)], (6.5, 6.5), False), ([circle(NO_CIRCLE, 2.0, 5.0, 5.0)], (5.0, 5.1), True),
    ],
)  # fmt: skip
def test_what_it_means(items: list[Item], at: tuple[float, float], left: bool) -> None:
    fence = Fence()
    fence.items = tuple(items)
    assert fence.left(*at, Origin()) is left


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.GUIDED), (1, Mode.RTL), (2, Mode.HOLD)])
def test_who_leaves_it_does_what_the_parameter_says(action: int, mode: Mode) -> None:
    with Rig() as rig:
        assert upload(rig, ROOM) == ACCEPTED
        rig.autopilot.parameters.set("FENCE_ACTION", action)
        rig.guided()
        rig.target(5.0, 9.5)
        assert rig.command(mav.MAV_CMD_DO_FENCE_ENABLE, 1) == ACCEPTED
        rig.until(lambda: rig.at()[1] > 8.0)
        rig.run(2.0)
        assert rig.autopilot.mode is mode
        assert any("Fence Failsafe" in text or "Polygon fence" in text for text in rig.client.texts())
        assert (rig.autopilot.failed is None) is (action != 2)


def test_a_fence_that_is_off_is_not_looked_at() -> None:
    with Rig() as rig:
        assert upload(rig, ROOM) == ACCEPTED
        rig.guided()
        rig.target(5.0, 8.5)
        rig.until(lambda: rig.at()[1] > 8.3)
        assert rig.autopilot.mode is Mode.GUIDED
        assert rig.command(mav.MAV_CMD_DO_FENCE_ENABLE, 2) != ACCEPTED
        rig.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_SYS_STATUS, 1e5)
        rig.run(0.5)
        assert not rig.client.take("SYS_STATUS")[-1].onboard_control_sensors_enabled & mav.MAV_SYS_STATUS_GEOFENCE
