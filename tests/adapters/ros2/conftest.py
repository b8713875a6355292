"""Robots for the tests: simulated, on this host only, in a ROS domain of their own. Tests import ROS when they run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

from tests.adapters.velocity_controlled.driving import ROOM, SPECS

if TYPE_CHECKING:
    from soter.adapters.ros2.graph import Graph
    from soter.adapters.ros2.simulator import Ros2Simulator
    from soter.sdk import RobotSpec
    from soter.sdk.wire import WireFleet


@pytest.fixture
def simulator() -> Iterator[Ros2Simulator]:
    """One simulated robot and its mux."""
    from soter.adapters.ros2.simulator import Ros2Simulator

    simulator = Ros2Simulator(ROOM.with_robots(1), SPECS[:1])
    yield simulator
    simulator.close()


@pytest.fixture
def open_fleet() -> Iterator[Callable[..., WireFleet[Any]]]:
    """Opens a fleet of a simulator's one robot, with options in place of what is right; ready unless told otherwise."""
    from soter.adapters.ros2.backend import Ros2Backend
    from soter.adapters.ros2.options import Ros2Config

    with ExitStack() as stack:

        def open_fleet(
            simulator: Ros2Simulator,
            *,
            ready: bool = True,
            external_ac: bool = False,
            specs: Sequence[RobotSpec] = SPECS[:1],
            **options: Any,
        ) -> WireFleet[Any]:
            config = Ros2Backend.located(Ros2Config(workspace=ROOM.with_robots(1)), simulator)
            given = {name: getattr(config, name) for name in type(config).model_fields}
            config = Ros2Config.model_validate({**given, **options})
            fleet = Ros2Backend(external_ac=external_ac).open(config, specs)
            stack.enter_context(fleet)
            if ready:
                fleet.robots[0].init(20.0)
            return fleet

        yield open_fleet


@pytest.fixture
def graph(simulator: Ros2Simulator) -> Iterator[Graph]:
    """Somebody else's corner of the same ROS graph."""
    from soter.adapters.ros2.graph import Graph

    graph = Graph(simulator.domain_id, use_sim_time=False, on_loopback=True)
    yield graph
    graph.close()
