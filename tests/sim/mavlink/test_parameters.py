"""The parameter protocol."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from tests.sim.mavlink.client import Rig

INT, REAL = mav.MAV_PARAM_TYPE_INT32, mav.MAV_PARAM_TYPE_REAL32


def read(rig: Rig, name: str = "", index: int = -1) -> mav.MAVLink_message | None:
    """Ask for one parameter."""
    rig.client.take("PARAM_VALUE")
    rig.client.send(mav.MAVLink_param_request_read_message(1, 1, name.encode(), index))
    rig.run(rig.period_s)
    return next(iter(rig.client.take("PARAM_VALUE")), None)


def write(rig: Rig, name: str, value: float, kind: int = REAL) -> float | None:
    """Set one parameter and return what the vehicle says its value is."""
    rig.client.take("PARAM_VALUE")
    rig.client.send(mav.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    rig.run(rig.period_s)
    values = rig.client.take("PARAM_VALUE")
    return float(values[-1].param_value) if values else None


@pytest.mark.parametrize("vehicle", ["rover", "copter"])
def test_all_are_listed_once_in_order_and_can_be_read_by_name_and_number(vehicle: str) -> None:
    with Rig(vehicle=vehicle) as rig:
        rig.client.send(mav.MAVLink_param_request_list_message(1, 1))
        # Somebody who is in a hurry gets one list, too.
        rig.run(rig.period_s)
        rig.client.take("PARAM_VALUE")
        rig.client.send(mav.MAVLink_param_request_list_message(1, 1))
        rig.run(1.0)
        listed = rig.client.take("PARAM_VALUE")
        assert [each.param_index for each in listed] == list(range(listed[0].param_count))
        names = [each.param_id for each in listed]
        assert names == sorted(names)
        assert {"SYSID_THISMAV", "FS_GCS_ENABLE", "SOTER_LEASE_MS", "BATT_CAPACITY"} <= set(names)
        assert ("LAND_SPEED" in names) == (vehicle == "copter")
        for each in listed:
            assert len(each.param_id) <= 16
            by_name, by_number = read(rig, each.param_id), read(rig, index=each.param_index)
            assert by_name is not None
            assert by_number is not None
            assert by_name.to_dict() == by_number.to_dict() == each.to_dict()


def test_what_there_is_not_is_not_answered() -> None:
    with Rig() as rig:
        assert read(rig, "NO_SUCH_THING") is None
        assert read(rig, index=999) is None
        assert write(rig, "NO_SUCH_THING", 1.0) is None


def test_a_parameter_is_set_and_everybody_is_told() -> None:
    with Rig() as rig:
        other = rig.connect(254, 1)
        assert write(rig, "WP_SPEED", 0.1) == pytest.approx(0.1)
        assert other.take("PARAM_VALUE")[-1].param_id == "WP_SPEED"
        assert rig.autopilot.parameters["WP_SPEED"] == 0.1
        assert write(rig, "SOTER_LEASE_MS", 400, INT) == 400
        rig.guided()
        rig.target(9.0, 5.0)
        rig.run(2.0)
        assert rig.speed() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [("WP_SPEED", math.nan), ("WP_SPEED", 5.0), ("WP_SPEED", 0.0), ("FS_GCS_ENABLE", 0.5), ("SYSID_THISMAV", 7.0),
     ("SOTER_LEASE_MS", 10.0), ("BATT_CAPACITY", math.inf)],
)  # fmt: skip
def test_a_value_that_is_not_allowed_changes_nothing_and_is_said_so(name: str, value: float) -> None:
    with Rig() as rig:
        before = rig.autopilot.parameters[name]
        assert write(rig, name, value) == pytest.approx(before)
        assert rig.autopilot.parameters[name] == before
        assert any(text.startswith(f"Refused: {name} is ") for text in rig.client.texts())


def test_who_goes_while_it_is_listing_is_forgotten() -> None:
    with Rig() as rig:
        other = rig.connect(254, 1)
        other.send(mav.MAVLink_param_request_list_message(1, 1))
        rig.run(rig.period_s)
        other.close()
        rig.clients.remove(other)
        rig.run(1.0)
        assert read(rig, "WP_SPEED") is not None


def test_who_asks_for_a_file_of_parameters_is_refused_at_once() -> None:
    with Rig() as rig:
        # Open for reading, number 65535, session 3.
        request = bytes((0xFF, 0xFF, 3, 4)).ljust(251, b"\0")
        rig.client.send(mav.MAVLink_file_transfer_protocol_message(0, 1, 1, request))
        rig.run(rig.period_s)
        (answer,) = rig.client.take("FILE_TRANSFER_PROTOCOL")
        assert (answer.target_system, answer.target_component) == (255, 190)
        # The number after it, the same session, refused: one byte, which says that there is no such operation.
        assert bytes(answer.payload)[:8] == bytes((0, 0, 3, 129, 1, 4, 0, 0))
        assert answer.payload[12] == 7
