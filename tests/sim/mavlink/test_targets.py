"""Targets in GUIDED: places and velocities, their frames and masks, and what is not obeyed."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.onboard.drive import OVERSHOOT_M, TUBE_M
from soter_sim.mavlink.frames import Origin
from tests.sim.mavlink.client import ACCEPTED, DENIED, POSITION, UNSUPPORTED, VELOCITY, Rig
from tests.sim.worlds import from_segment

YAW_TOO = POSITION & ~mav.POSITION_TARGET_TYPEMASK_YAW_IGNORE
SPEED_TOO = POSITION & ~0x0038
RATE_TOO = VELOCITY & ~mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE


@pytest.mark.parametrize("mask", [0x0DF8, 0x0FF8])
def test_a_rover_drives_to_a_place_in_a_straight_line(mask: int) -> None:
    with Rig() as rig:
        rig.guided()
        start, end = rig.at(), (6.0, 6.5)
        rig.target(*end, mask=mask)
        for _ in range(round(12.0 / rig.period_s)):
            rig.run(rig.period_s)
            off_m, beyond_m = from_segment(*rig.at(), start, end)
            assert off_m <= TUBE_M
            assert beyond_m <= OVERSHOOT_M
        assert math.dist(rig.at(), end) < 0.01
        assert rig.speed() == 0.0


@pytest.mark.parametrize(
    ("frame", "east", "north", "end"),
    [
        (mav.MAV_FRAME_LOCAL_NED, 6.0, 6.0, (6.0, 6.0)),
        (mav.MAV_FRAME_LOCAL_OFFSET_NED, 1.0, 0.5, (6.0, 5.5)),
        # Facing east, forward is east and right is south: the fields are "north" = forward, "east" = right.
        (mav.MAV_FRAME_BODY_OFFSET_NED, 0.5, 1.0, (6.0, 4.5)),
        (mav.MAV_FRAME_BODY_NED, 0.5, 1.0, (6.0, 4.5)),
    ],
)
def test_frames_of_local_targets(frame: int, east: float, north: float, end: tuple[float, float]) -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(east, north, frame=frame)
        rig.run(15.0)
        assert rig.at() == pytest.approx(end, abs=0.01)


@pytest.mark.parametrize(
    ("frame", "alt_m"),
    [
        (mav.MAV_FRAME_GLOBAL_INT, 488.0),
        (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 0.0),
        (mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, 0.0),
    ],
)
def test_global_targets_and_repositions(frame: int, alt_m: float) -> None:
    with Rig() as rig:
        rig.guided()
        lat_e7, lon_e7 = Origin().geodetic_e7(6.0, 5.5)
        rig.client.send(
            mav.MAVLink_set_position_target_global_int_message(
                0, 1, 1, frame, POSITION, lat_e7, lon_e7, alt_m, 0, 0, 0, 0, 0, 0, 0, 0
            )
        )
        rig.run(10.0)
        assert rig.at() == pytest.approx((6.0, 5.5), abs=0.02)
        lat_e7, lon_e7 = Origin().geodetic_e7(5.0, 5.0)
        reposition = mav.MAV_CMD_DO_REPOSITION
        assert rig.command_int(reposition, 0.1, 0, 0, math.nan, x=lat_e7, y=lon_e7, z=alt_m, frame=frame) == ACCEPTED
        rig.run(4.0)
        assert rig.speed() == pytest.approx(0.1)
        rig.run(16.0)
        assert rig.at() == pytest.approx((5.0, 5.0), abs=0.02)


def test_reposition_is_an_int_command_and_changes_mode_only_if_told_to() -> None:
    with Rig() as rig:
        reposition = mav.MAV_CMD_DO_REPOSITION
        lat_e7, lon_e7 = Origin().geodetic_e7(6.0, 5.0)

        def go(flags: int, z_m: float = 488.0, frame: int = mav.MAV_FRAME_GLOBAL) -> int | None:
            return rig.command_int(reposition, -1, flags, x=lat_e7, y=lon_e7, z=z_m, frame=frame)

        assert rig.command(reposition, -1, 1, 0, 0, 47.4, 8.5, 488.0) == UNSUPPORTED
        assert go(1) == DENIED
        rig.arm()
        assert go(0) == DENIED
        assert rig.autopilot.mode.value == "MANUAL"
        assert go(1, math.nan) == DENIED
        assert go(1, frame=mav.MAV_FRAME_LOCAL_NED) == DENIED
        assert go(mav.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE) == ACCEPTED
        assert rig.autopilot.mode.value == "GUIDED"
        rig.run(8.0)
        assert rig.at() == pytest.approx((6.0, 5.0), abs=0.02)


def test_a_yaw_is_arrived_with_backwards_where_that_is_nearer() -> None:
    with Rig() as rig:
        rig.guided()
        # Facing east at (5, 5): a metre west, to arrive facing east (a yaw of 90 degrees clockwise from north).
        rig.target(4.0, 5.0, mask=YAW_TOO, yaw=0.5 * math.pi)
        rig.run(3.0)
        assert rig.simulation.world.bodies.v[0] < -0.2
        rig.run(5.0)
        x_m, y_m, heading_rad = rig.simulation.world.truth.pose(1)
        assert (x_m, y_m, heading_rad) == pytest.approx((4.0, 5.0, 0.0), abs=0.02)


def test_a_velocity_beside_a_place_caps_the_speed() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(9.0, 5.0, mask=SPEED_TOO, vx=0.03, vy=0.04)
        rig.run(3.0)
        assert rig.speed() == pytest.approx(0.05)


@pytest.mark.parametrize("how", ["plain", "parameter"])
def test_a_plain_rover_looks_at_neither(how: str) -> None:
    with Rig(plain=how == "plain") as rig:
        if how == "parameter":
            rig.client.send(mav.MAVLink_param_set_message(1, 1, b"SOTER_YAW_SPEED", 0, mav.MAV_PARAM_TYPE_INT32))
        rig.guided()
        rig.target(4.0, 5.0, mask=SPEED_TOO & YAW_TOO, vx=0.05, yaw=0.5 * math.pi)
        rig.run(4.0)
        assert rig.simulation.world.bodies.v[0] == pytest.approx(0.22)


@pytest.mark.parametrize(
    ("mask", "fields"),
    [
        (POSITION, {"north_m": math.nan}),
        (POSITION, {"east_m": math.inf}),
        (POSITION, {"up_m": math.nan}),
        (YAW_TOO, {"yaw": math.nan}),
        (SPEED_TOO, {"vx": math.nan}),
        (VELOCITY, {"vy": math.inf}),
        (RATE_TOO, {"yaw_rate": -math.inf}),
    ],
)
def test_what_is_no_number_is_ignored_and_said_so(mask: int, fields: dict[str, float]) -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(9.0, 5.0)
        rig.run(2.0)
        values = {"east_m": 5.0, "north_m": 9.0} | fields
        rig.target(values.pop("east_m"), values.pop("north_m"), values.pop("up_m", 0.0), None, 1, mask=mask, **values)
        rig.run(1.0)
        assert any(text.startswith("Ignored a target: ") for text in rig.client.texts())
        # It goes on to where it went.
        assert rig.speed() == pytest.approx(0.22)
        assert rig.at()[1] == pytest.approx(5.0, abs=0.01)


def test_numbers_that_are_masked_out_do_not_matter() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(6.0, 5.0, vx=math.nan, afx=math.nan, yaw=math.nan, yaw_rate=math.nan)
        rig.run(8.0)
        assert rig.at() == pytest.approx((6.0, 5.0), abs=0.01)


def test_far_places_are_taken_and_absurd_ones_are_not() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(1e6, 5.0)
        rig.run(3.0)
        assert rig.speed() == pytest.approx(0.22)
        for frame in (mav.MAV_FRAME_LOCAL_NED, mav.MAV_FRAME_BODY_OFFSET_NED):
            rig.target(3e38, -3e38, frame=frame)
            rig.run(0.1)
            assert any(text.startswith("Ignored a target: x is ") for text in rig.client.texts())
            rig.run(1.5)
        assert rig.command(mav.MAV_CMD_REQUEST_MESSAGE, mav.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED) == ACCEPTED
        assert rig.client.take("POSITION_TARGET_LOCAL_NED")[-1].y == 1e6


def test_masks_and_frames_that_mean_nothing_are_said_so() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(6.0, 5.0, mask=0x0FFF)
        rig.run(0.1)
        assert any("type mask" in text for text in rig.client.texts())
        rig.target(6.0, 5.0, frame=mav.MAV_FRAME_GLOBAL)
        rig.run(0.1)
        assert any("frame 0 is not supported" in text for text in rig.client.texts())
        rig.run(5.0)
        assert rig.at() == (5.0, 5.0)


def test_targets_at_the_wrong_time_are_ignored_in_silence_and_not_remembered() -> None:
    with Rig() as rig:
        rig.run(1.0)
        rig.client.texts()
        rig.target(9.0, 5.0)
        rig.arm()
        rig.target(9.0, 5.0)
        rig.run(1.0)
        rig.disarm()
        rig.mode(15)
        rig.target(9.0, 5.0)
        rig.run(1.0)
        rig.arm()
        rig.run(2.0)
        assert rig.at() == (5.0, 5.0)
        assert [text for text in rig.client.texts() if "target" in text] == []


def test_hold_stops_and_guided_does_not_resume() -> None:
    with Rig() as rig:
        rig.guided()
        rig.target(9.0, 5.0)
        rig.run(3.0)
        before_m = rig.at()[0]
        assert rig.mode(4) == ACCEPTED
        rig.run(1.0)
        assert rig.speed() == 0.0
        # v^2 / 2a, and what it still drives until it hears of it.
        assert rig.at()[0] - before_m < 0.0242 + 0.22 * 3 * rig.period_s
        assert rig.mode(15) == ACCEPTED
        stopped = rig.at()
        rig.run(2.0)
        assert rig.at() == stopped


def test_a_velocity_is_kept_for_three_seconds() -> None:
    with Rig() as rig:
        rig.guided()
        rig.velocity(0.0, 0.2)
        rig.run(2.5)
        assert rig.autopilot.sample().north_m_s == pytest.approx(0.2, abs=0.005)
        rig.velocity(0.0, 0.2)
        rig.run(2.5)
        assert rig.speed() == pytest.approx(0.2, abs=0.005)
        rig.run(1.0)
        assert rig.speed() == 0.0
        rig.run(2.0)
        assert rig.speed() == 0.0


@pytest.mark.parametrize("like", [None, "ardurover"])
def test_a_heading_alone_turns_a_rover_in_place(like: str | None) -> None:
    with Rig(like=like) as rig:
        rig.run(2.5)
        rig.guided()
        rig.target(9.0, 5.0)
        rig.run(1.0)
        rig.velocity(0.0, 0.0, mask=0x09FF, yaw=-0.5 * math.pi)
        rig.run(0.5)
        stopped = rig.at()
        rig.run(2.0)
        assert abs(rig.simulation.world.truth.pose(1)[2]) == pytest.approx(math.pi, abs=0.02)
        assert math.dist(rig.at(), stopped) <= 0.001


def test_a_velocity_with_a_turn_rate_drives_a_circle_also_backwards() -> None:
    with Rig() as rig:
        rig.guided()
        body = mav.MAV_FRAME_BODY_NED
        # Clockwise is negative here: forward and to the right.
        rig.velocity(0.0, 0.1, frame=body, mask=RATE_TOO, yaw_rate=0.5)
        rig.run(1.0)
        sample = rig.autopilot.sample()
        assert sample.yaw_rate_rad_s == pytest.approx(-0.5)
        assert rig.simulation.world.bodies.v[0] == pytest.approx(0.1)
        rig.velocity(0.0, -0.1, frame=body, mask=RATE_TOO, yaw_rate=0.0)
        rig.run(1.0)
        assert rig.simulation.world.bodies.v[0] == pytest.approx(-0.1)
        rig.velocity(0.0, 0.0)
        rig.run(1.0)
        assert rig.speed() == 0.0


@pytest.mark.pybullet
def test_the_engine_with_physics_drives_as_the_other_does() -> None:
    with Rig(engine="pybullet") as rig:
        rig.guided()
        assert rig.master(255, 190) == ACCEPTED
        rig.target(6.0, 5.5)
        for _ in range(200):
            assert rig.master(255, 190) == ACCEPTED
        assert math.dist(rig.at(), (6.0, 5.5)) < 0.02
        rig.target(5.0, 5.0)
        # Nobody renews the lease.
        rig.run(1.0)
        assert rig.speed() < 0.01
