"""The robots of an opened backend that velocities are streamed to, as what they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Final, Generic, TypeVar

from soter.clock import VehicleClock
from soter.sdk.wire import WireFleet
from soter.streamed.robot import StreamedRobot
from soter.streamed.simulator import StreamedSimulator

R = TypeVar("R", bound=StreamedRobot)
S = TypeVar("S", bound=StreamedSimulator)


class StreamedFleet(WireFleet[S], Generic[R, S]):
    """Robots, what they are heard over, and the simulator if it was started for them.

    Args:
        clock: follows the robots' clocks.
        truth: `host:port` at which a simulated world says what really happens, or None.
        simulator: a simulator to end with the fleet, or None.
        make: makes the robots; pushes onto the stack what is to be closed behind them.

    Attributes:
        streamed: the robots, as what they are.
    """

    def __init__(
        self, clock: VehicleClock, truth: str | None, simulator: S | None, make: Callable[[ExitStack], Sequence[R]]
    ) -> None:
        with ExitStack() as shared:
            self.streamed: Final = tuple(make(shared))
            super().__init__(clock, self.streamed, truth, simulator, shared)
