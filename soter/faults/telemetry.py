"""Faults of a robot's samples: frozen, biased, stamped by a clock that jumps, or with a wrong charge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from soter.config.table import wrong
from soter.faults.fault import Context, Fault, FaultOptions, Passage, SentCommand, Spacing
from soter.sdk import Capabilities, RobotState

Offset = Annotated[float, Field(ge=-1000.0, le=1000.0, allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-math.pi, le=math.pi, allow_inf_nan=False)]
Step = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
ChargeOffset = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]


class FreezeOptions(FaultOptions):
    """A frozen state.

    Attributes:
        restamped: whether the old pose gets new stamps, which hide its age. Charge and controller stay true.
    """

    restamped: bool = False

    @model_validator(mode="after")
    def _bounded_if_declared(self) -> Self:
        if self.declared and self.duration_s is None:
            raise wrong(("declared",), self.declared, "false; or give a duration_s, since nothing bounds such an age")
        return self


class Freeze(Fault[FreezeOptions]):
    """The robot's state is frozen, with its old stamp or with new ones."""

    options_model: ClassVar[type[FaultOptions]] = FreezeOptions

    def __init__(self, options: FreezeOptions, context: Context) -> None:
        super().__init__(options, context)
        self._last: RobotState | None = None
        self._stood: int | None = None

    def widened(self, capabilities: Capabilities) -> Capabilities:
        duration_s = self.up_to_ticks(self.options.duration_s or 0.0)
        if self.options.restamped:
            # The stamps hide the age, so the position noise has to cover the distance driven in that time, and in the
            # promised sample age, since the frozen pose may already have been so old.
            hidden_s = duration_s + capabilities.sample_age_s
            noise_m = capabilities.position_noise_m + capabilities.v_max_m_s * hidden_s
            # A robot that moved then may be at rest by now: nothing bounds the error of speed and heading.
            return replace(capabilities, position_noise_m=noise_m, speed_noise_m_s=None, heading_noise_rad=None)
        return replace(capabilities, sample_age_s=capabilities.sample_age_s + duration_s)

    def spacing(self) -> Spacing:
        return Spacing(held=self.ticks(self.options.duration_s or 0.0))

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        frozen, window = self._last, self.options.window(time_s) if on else None
        # One sample comes through between two freezes, even without a reading between them.
        again = self._stood is not None and window != self._stood
        self._stood = window
        if window is None or again or sample is None or frozen is None:
            self._last = sample
            return sample
        self.affected += 1
        if not self.options.restamped:
            return frozen
        return sample._replace(
            x_m=frozen.x_m,
            y_m=frozen.y_m,
            z_m=frozen.z_m,
            heading_rad=frozen.heading_rad,
            vx_m_s=frozen.vx_m_s,
            vy_m_s=frozen.vy_m_s,
            yaw_rate_rad_s=frozen.yaw_rate_rad_s,
        )


class BiasOptions(FaultOptions):
    """A robot whose localisation is off.

    Attributes:
        x_m: error of its position, east.
        y_m: error of its position, north.
        heading_rad: error of its heading, counter-clockwise.
    """

    x_m: Offset = 0.0
    y_m: Offset = 0.0
    heading_rad: Angle = 0.0

    @model_validator(mode="after")
    def _is_off(self) -> Self:
        if self.x_m == self.y_m == self.heading_rad == 0.0:
            raise wrong(("x_m",), self.x_m, "other than 0, or a y_m or heading_rad other than 0")
        return self


class Bias(Fault[BiasOptions]):
    """The robot's localisation is off, in its samples, and when it drives to a target."""

    options_model: ClassVar[type[FaultOptions]] = BiasOptions

    def widened(self, capabilities: Capabilities) -> Capabilities:
        error_m = math.hypot(self.options.x_m, self.options.y_m)
        noise_rad = capabilities.heading_noise_rad
        return replace(
            capabilities,
            position_noise_m=capabilities.position_noise_m + error_m,
            heading_noise_rad=None if noise_rad is None else noise_rad + abs(self.options.heading_rad),
        )

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        target, options = command.target, self.options
        if target is None:
            return (Passage(command),)
        heading = None if target.heading_rad is None else _wrapped(target.heading_rad - options.heading_rad)
        shifted = target._replace(x_m=target.x_m - options.x_m, y_m=target.y_m - options.y_m, heading_rad=heading)
        self.affected += 1
        return (Passage(replace(command, target=shifted)),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if not on or sample is None:
            return sample
        self.affected += 1
        options = self.options
        return sample._replace(
            x_m=sample.x_m + options.x_m,
            y_m=sample.y_m + options.y_m,
            heading_rad=_wrapped(sample.heading_rad + options.heading_rad),
        )


class ClockStepOptions(FaultOptions):
    """A vehicle whose clock jumps.

    Attributes:
        step_s: error of its clock from then on; if it is positive, samples seem younger than they are.
    """

    step_s: Step

    @model_validator(mode="after")
    def _steps(self) -> Self:
        if self.step_s == 0.0:
            raise wrong(("step_s",), self.step_s, "other than 0")
        return self


class ClockStep(Fault[ClockStepOptions]):
    """The stamps of the robot's samples jump."""

    options_model: ClassVar[type[FaultOptions]] = ClockStepOptions

    def widened(self, capabilities: Capabilities) -> Capabilities:
        step_s = self.options.step_s
        # When the clock goes back, at the beginning or at the end of the fault, samples seem older than the last one,
        # and are dropped until the stamps have caught up.
        return replace(
            capabilities,
            sample_age_s=capabilities.sample_age_s + self.up_to_ticks(abs(step_s)),
            # A pose with a wrong stamp is the robot's pose some time before or after the stamp.
            position_noise_m=capabilities.position_noise_m + capabilities.v_max_m_s * abs(step_s),
            speed_noise_m_s=None,
            heading_noise_rad=None,
        )

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if not on or sample is None:
            return sample
        self.affected += 1
        step_s = self.options.step_s
        return sample._replace(stamp_s=sample.stamp_s + step_s, vehicle_stamp_s=sample.vehicle_stamp_s + step_s)


class BatteryOptions(FaultOptions):
    """A wrong charge.

    Attributes:
        offset: added to the charge from 0 to 1 that the robot reports.
    """

    offset: ChargeOffset

    @model_validator(mode="after")
    def _low_if_declared(self) -> Self:
        if self.declared and self.offset > 0.0:
            allowed = "at most 0; or declared = false, since no promise covers a charge that is not there"
            raise wrong(("offset",), self.offset, allowed)
        return self


class Battery(Fault[BatteryOptions]):
    """The robot reports a wrong charge. One that is too low is on the safe side and needs no promise."""

    options_model: ClassVar[type[FaultOptions]] = BatteryOptions

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if not on or sample is None or sample.battery is None:
            return sample
        self.affected += 1
        return sample._replace(battery=min(1.0, max(0.0, sample.battery + self.options.offset)))


def _wrapped(angle_rad: float) -> float:
    """Return an angle in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
