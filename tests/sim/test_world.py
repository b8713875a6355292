"""The world's own duties: time, names, and both engines behaving alike."""

from __future__ import annotations

import hashlib
import math
import os
import random
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from soter.onboard.drive import OVERSHOOT_M, TUBE_M
from soter.sdk.values import RobotSpec, Waypoint
from soter_sim import LIMITS, World
from tests.sim.worlds import CASE, constant, driven, empty, from_segment, positions, specs, touring

ROOT = Path(__file__).resolve().parents[2]
ENGINES = [pytest.param("kinematic"), pytest.param("pybullet", marks=pytest.mark.pybullet)]


def fingerprint(engine: str) -> str:
    """A hash over every bit of the states of a minute with bumps."""
    rng = random.Random(4)
    digest = hashlib.sha256()
    with World(CASE, specs((1.0, 1.0, 0.0), (2.5, 2.0, 1.0)), engine) as world:
        targets = [[Waypoint(rng.uniform(0, 5), rng.uniform(0, 5)) for _ in range(12)] for _ in range(2)]
        for robot in (1, 2):
            world.set_control(robot, touring(world, targets[robot - 1]))
        for period in range(1, 1200):
            world.advance(period * 0.05)
            bodies = world.bodies
            for values in (bodies.x, bodies.y, bodies.heading, bodies.v, bodies.yaw_rate, bodies.charge):
                digest.update(struct.pack("2d", *values))
        digest.update(repr(world.truth.report()).encode())
    return digest.hexdigest()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_world_repeats_bit_for_bit_in_another_process(engine: str) -> None:
    here = fingerprint(engine)
    assert fingerprint(engine) == here
    program = f"from tests.sim.test_world import fingerprint; print(fingerprint({engine!r}))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim"))), "PYTHONHASHSEED": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    # Nothing else is printed, not even by PyBullet.
    assert done.stdout == f"{here}\n"
    assert done.stderr == ""


@pytest.mark.parametrize("engine", ENGINES)
def test_time_moves_in_whole_periods_and_never_back(engine: str) -> None:
    with World(empty(), specs((1.0, 1.0, 0.0)), engine) as world:
        world.advance(0.049)
        assert world.now_s == 0.0
        world.advance(0.149999999999)
        assert world.now_s == pytest.approx(0.15)
        world.advance(0.1)
        assert world.now_s == pytest.approx(0.15)
        for bad in (math.nan, math.inf):
            with pytest.raises(ValueError, match="until_s"):
                world.advance(bad)


@pytest.mark.parametrize("engine", ENGINES)
def test_each_control_is_called_once_a_period_with_its_own_state(engine: str) -> None:
    calls: list[tuple[float, ...]] = []

    def control(*state: float) -> tuple[float, float]:
        calls.append(state)
        return 0.1, 0.0

    with World(empty(), specs((1.0, 1.0, 0.0), (5.0, 5.0, 1.0)), engine) as world:
        world.set_control(2, control)
        world.advance(0.5)
        assert [call[0] for call in calls] == pytest.approx([k * 0.05 for k in range(10)])
        assert calls[0][1:] == (5.0, 5.0, 1.0, 0.0, 0.0)
        assert calls[9][4] == pytest.approx(0.1, abs=0.01)
        east, north = world.engine.velocity(1)
        assert math.atan2(north, east) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_promises_of_speed_and_brake_hold(engine: str) -> None:
    with World(empty(), specs((5.0, 5.0, 0.7)), engine) as world:
        world.set_control(1, constant(5.0))
        for period in range(1, 60):
            before = positions(world)[0]
            world.advance(period * 0.05)
            east, north = world.engine.velocity(0)
            assert math.hypot(east, north) <= LIMITS.v_max_m_s + 1e-12
            assert math.dist(before, positions(world)[0]) <= LIMITS.v_max_m_s * 0.05 + 1e-12
        assert math.hypot(*world.engine.velocity(0)) > 0.219
        before = positions(world)[0]
        world.set_control(1, None)
        world.advance(4.0)
        assert math.dist(before, positions(world)[0]) <= LIMITS.v_max_m_s**2 / 2 + 1e-9


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("case", range(6))
def test_the_drive_keeps_its_tube_in_both_engines(engine: str, case: int) -> None:
    rng = random.Random(case)
    bearing, distance = rng.uniform(-math.pi, math.pi), rng.choice([0.05, 0.3, 1.0])
    wanted = rng.choice([None, bearing, bearing + math.pi])
    end = 10 + distance * math.cos(bearing), 10 + distance * math.sin(bearing)
    with World(empty(), specs((10.0, 10.0, rng.uniform(-math.pi, math.pi))), engine) as world:
        world.set_control(1, driven(lambda: Waypoint(*end, heading_rad=wanted)))
        while world.now_s < 12.0:
            world.advance(world.now_s + 0.05)
            off, over = from_segment(*positions(world)[0], (10.0, 10.0), end)
            assert off <= TUBE_M
            assert over <= OVERSHOOT_M
        assert math.dist(positions(world)[0], end) <= 0.01
        assert world.bodies.v[0] == pytest.approx(0.0, abs=1e-4)


def test_bad_worlds_are_refused() -> None:
    with pytest.raises(ValueError, match="did you mean 'kinematic'"):
        World(empty(), specs((1.0, 1.0, 0.0)), "kinematik")
    with pytest.raises(ValueError, match="each number once"):
        World(empty(), [RobotSpec(1, 0, 0, 0), RobotSpec(1, 1, 1, 0)])
    with pytest.raises(ValueError, match="not finite"):
        World(empty(), specs((math.nan, 1.0, 0.0)))
    with pytest.raises(ValueError, match="0 to 1"):
        World(empty(), specs((1.0, 1.0, 0.0), battery=1.5))
    with pytest.raises(ValueError, match="without robots"):
        World(empty(), [])
    with pytest.raises(ValueError, match="no robot 7"):
        World(empty(), specs((1.0, 1.0, 0.0))).set_control(7, None)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_closed_world_stands_still_and_stays_readable(engine: str) -> None:
    world = World(empty(), specs((1.0, 1.0, 0.0)), engine)
    world.advance(1.0)
    world.close()
    world.close()
    world.advance(2.0)
    assert world.now_s == 1.0
    assert world.truth.report().violations == ()
