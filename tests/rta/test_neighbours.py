"""Nobody who is near is left out, and nobody is their own peer."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from soter.rta import RobotSupervisor, Situation
from soter.rta.fleet import FEW, Neighbours
from tests.rta.doubles import At

RADIUS_M = 2.5


class Stub(RobotSupervisor):
    """Only the situation of a supervisor."""

    def __init__(self, sample: At) -> None:
        self.situation = Situation(sample.robot_id, sample, 0.0)


def assign(places: list[tuple[float, float]]) -> tuple[list[At], list[list[int]]]:
    samples = [At(x, y, robot_id=number) for number, (x, y) in enumerate(places)]
    robots = [Stub(sample) for sample in samples]
    Neighbours(RADIUS_M).assign(robots, samples)
    return samples, [[peer.robot_id for peer in robot.situation.peers] for robot in robots]


def check(places: list[tuple[float, float]]) -> None:
    samples, peers = assign(places)
    for own, found in zip(samples, peers, strict=True):
        near = {
            other.robot_id
            for other in samples
            if other is not own and math.dist(other[:2], own[:2]) < RADIUS_M * (1.0 - 1e-9)
        }
        assert near <= set(found)
        assert own.robot_id not in found
        assert len(found) == len(set(found))
        for peer in found:
            assert own.robot_id in peers[peer], "who is a peer has a peer"


coordinates = st.floats(-20.0, 20.0) | st.integers(-8, 8).map(lambda n: n * RADIUS_M)


@given(st.lists(st.tuples(coordinates, coordinates), max_size=40))
def test_everybody_near_is_a_peer(places: list[tuple[float, float]]) -> None:
    check(places)


def test_robots_on_one_spot_are_peers_of_each_other() -> None:
    check([(1.0, 1.0)] * 10)
    check([(1.0, 1.0)] * 3)


def test_few_robots_are_all_peers_and_many_are_not() -> None:
    few, many = [(10.0 * number, 0.0) for number in range(FEW)], [(10.0 * number, 0.0) for number in range(FEW + 1)]
    assert all(len(found) == FEW - 1 for found in assign(few)[1])
    assert all(found == [] for found in assign(many)[1])
