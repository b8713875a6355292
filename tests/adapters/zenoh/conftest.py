"""Robots for the tests: simulated, on this host only, on ports that are free."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import pytest
import zenoh

from soter.adapters.zenoh.backend import ZenohBackend
from soter.adapters.zenoh.options import ZenohConfig
from soter.adapters.zenoh.simulator import ZenohSimulator
from soter.sdk import RobotSpec
from soter.sdk.wire import WireFleet
from tests.adapters.velocity_controlled.driving import ROOM, SPECS
from tests.adapters.zenoh.sessions import opened


@pytest.fixture
def simulator() -> Iterator[ZenohSimulator]:
    """One simulated robot and its mux, for a test that ends one of them."""
    simulator = ZenohSimulator(ROOM.with_robots(1), SPECS[:1])
    yield simulator
    simulator.close()


@pytest.fixture(scope="module")
def shared() -> Iterator[ZenohSimulator]:
    """One simulated robot and its mux, for all tests that leave them alone."""
    simulator = ZenohSimulator(ROOM.with_robots(1), SPECS[:1])
    yield simulator
    simulator.close()


@pytest.fixture
def open_fleet() -> Iterator[Callable[..., WireFleet[Any]]]:
    """Opens a fleet of a simulator's one robot, with options in place of what is right; ready unless told otherwise."""
    with ExitStack() as stack:

        def open_fleet(
            simulator: ZenohSimulator, *, ready: bool = True, specs: Sequence[RobotSpec] = SPECS[:1], **options: Any
        ) -> WireFleet[Any]:
            config = ZenohBackend.located(ZenohConfig(workspace=ROOM.with_robots(1)), simulator)
            given = {name: getattr(config, name) for name in type(config).model_fields}
            config = ZenohConfig.model_validate({**given, **options})
            fleet = stack.enter_context(ZenohBackend().open(config, specs))
            if ready:
                fleet.robots[0].init(20.0)
            return fleet

        yield open_fleet


@pytest.fixture
def somebody(shared: ZenohSimulator) -> Iterator[zenoh.Session]:
    """Somebody else's session, beside the shared robot."""
    with opened(shared.session) as (session,):
        yield session
