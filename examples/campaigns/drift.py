"""A fault of one's own, for examples/campaigns/rare.toml: a robot that is ever more wrong about where it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from soter.faults import Context, Fault, FaultOptions, Passage, SentCommand
from soter.sdk import RobotState


class DriftOptions(FaultOptions):
    """A position that drifts.

    Attributes:
        step_m: standard deviation of what each reading adds to the error, along each axis.
    """

    step_m: Annotated[float, Field(gt=0.0, le=1.0)]


class Drift(Fault[DriftOptions]):
    """The robot's position drifts, as that of wheels does which nothing corrects; it drives to places by it."""

    options_model = DriftOptions

    def __init__(self, options: DriftOptions, context: Context) -> None:
        super().__init__(options, context)
        self._x_m = self._y_m = 0.0

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        target = command.target
        if target is None:
            return (Passage(command),)
        there = target._replace(x_m=target.x_m - self._x_m, y_m=target.y_m - self._y_m)
        return (Passage(replace(command, target=there)),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if not on or sample is None:
            return sample
        self.affected += 1
        self._x_m += self.context.random.gauss(0.0, self.options.step_m)
        self._y_m += self.context.random.gauss(0.0, self.options.step_m)
        return sample._replace(x_m=sample.x_m + self._x_m, y_m=sample.y_m + self._y_m)
