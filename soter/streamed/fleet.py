"""The robots of an opened backend that velocities are streamed to, and what they share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Final, Generic, TypeVar

from soter.clock import VehicleClock
from soter.sdk import Fleet
from soter.sdk.truth import StreamedTruth
from soter.streamed.robot import StreamedRobot
from soter.streamed.simulator import StreamedSimulator

R = TypeVar("R", bound=StreamedRobot)
S = TypeVar("S", bound=StreamedSimulator)


class StreamedFleet(Fleet, Generic[R, S]):
    """Robots, what they are heard over, and the simulator if it was started for them.

    Args:
        clock: follows the robots' clocks.
        truth: `host:port` at which a simulated world says what really happens, or None.
        simulator: a simulator to end with the fleet, or None.
        make: makes the robots; pushes onto the stack what is to be closed behind them.

    Attributes:
        simulator: the same.
        streamed: the robots, as what they are.
    """

    def __init__(
        self, clock: VehicleClock, truth: str | None, simulator: S | None, make: Callable[[ExitStack], Sequence[R]]
    ) -> None:
        self.simulator: Final = simulator
        with ExitStack() as stack:
            heard = None
            if truth is not None:
                heard = StreamedTruth(truth, clock)
                stack.callback(heard.close)
            self.streamed: Final = tuple(make(stack))
            super().__init__(clock, self.streamed, heard)
            self._shared: Final = stack.pop_all()

    def _close(self) -> None:
        with ExitStack() as stack:
            if self.simulator is not None:
                stack.callback(self.simulator.close)
            stack.callback(self._shared.close)
