"""What fleets with a wire close, whatever fails on the way."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import pytest

from soter.clock import VehicleClock
from soter.sdk.wire import WireFleet


class Simulator:
    """Knows whether it was ended."""

    def __init__(self) -> None:
        self.ended = False

    def close(self) -> None:
        self.ended = True


class Wire:
    """Cannot be closed."""

    def close(self) -> None:
        raise OSError("the wire is stuck")


def test_a_simulator_ends_though_the_wire_cannot_be_closed() -> None:
    simulator = Simulator()
    with ExitStack() as shared:
        shared.callback(Wire().close)
        fleet: WireFleet[Any] = WireFleet(VehicleClock(), (), None, simulator, shared)
    with pytest.raises(OSError, match="stuck"):
        fleet.close()
    assert simulator.ended
