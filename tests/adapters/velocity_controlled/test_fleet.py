"""What fleets with a wire close, whatever fails on the way."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import pytest

from soter.adapters.mavlink.backend import MavlinkFleet
from soter.adapters.velocity_controlled.simulator import StreamedFleet
from soter.clock import VehicleClock


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


def streamed(simulator: Simulator) -> StreamedFleet[Any, Any]:
    def make(stack: ExitStack) -> tuple[()]:
        stack.callback(Wire().close)
        return ()

    return StreamedFleet(VehicleClock(), None, simulator, make)


def vehicles(simulator: Simulator) -> MavlinkFleet:
    with ExitStack() as shared:
        shared.callback(Wire().close)
        return MavlinkFleet(VehicleClock(), (), None, simulator, shared)  # type: ignore[arg-type]


@pytest.mark.parametrize("fleet_of", [streamed, vehicles])
def test_a_simulator_ends_though_the_wire_cannot_be_closed(fleet_of: Any) -> None:
    simulator = Simulator()
    with pytest.raises(OSError, match="stuck"):
        fleet_of(simulator).close()
    assert simulator.ended
