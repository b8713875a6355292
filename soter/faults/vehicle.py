"""Faults of the vehicle itself, for robots that can be impaired: those simulated in this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Final, Self

from pydantic import Field, model_validator

from soter.config.table import wrong
from soter.faults.fault import Fault, FaultOptions, Impairment, Passage, SentCommand
from soter.sdk import Capabilities, RobotState

Part = Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)]

TUBE_PER_GRIP_M: Final = 0.2
"""How far a robot strays from a short leg by uneven slip: metres per unit of difference in grip."""

UNEVEN: Final = 0.05
"""Largest difference in slip between the wheels. Beyond it the robot creeps so fast that the drive ends turns."""

_ROUNDING: Final = 1e-9


class WheelSlipOptions(FaultOptions):
    """Wheels that slip.

    Attributes:
        left: part of the left wheel's motion that reaches the ground.
        right: part of the right wheel's motion that reaches the ground.
    """

    left: Part = 1.0
    right: Part = 1.0

    @model_validator(mode="after")
    def _slips(self) -> Self:
        if self.left == self.right == 1.0:
            raise wrong(("left",), self.left, "below 1, or a right below 1")
        if self.declared and abs(self.left - self.right) > UNEVEN + _ROUNDING:
            allowed = f"at most {UNEVEN:g} apart from right, {self.right:g}; or declared = false"
            raise wrong(("left",), self.left, allowed)
        return self


class WheelSlip(Fault[WheelSlipOptions]):
    """The wheels turn more than the robot moves; the robot veers if one slips more than the other."""

    options_model: ClassVar[type[FaultOptions]] = WheelSlipOptions
    needs_vehicle: ClassVar[bool] = True

    def widened(self, capabilities: Capabilities) -> Capabilities:
        strays_m = TUBE_PER_GRIP_M * abs(self.options.left - self.options.right)
        return replace(capabilities, tube_m=capabilities.tube_m + strays_m)

    def impairment(self) -> Impairment:
        return Impairment(left=self.options.left, right=self.options.right)


class WeakBrakesOptions(FaultOptions):
    """Worn brakes.

    Attributes:
        factor: the part of the promised deceleration that is left.
    """

    factor: Part


class WeakBrakes(Fault[WeakBrakesOptions]):
    """The robot brakes less than promised, and overshoots its targets."""

    options_model: ClassVar[type[FaultOptions]] = WeakBrakesOptions
    needs_vehicle: ClassVar[bool] = True

    def widened(self, capabilities: Capabilities) -> Capabilities:
        v_max_m_s, brake_m_s2 = capabilities.v_max_m_s, capabilities.brake_m_s2
        weak_m_s2 = brake_m_s2 * self.options.factor
        further_m = v_max_m_s * v_max_m_s / 2.0 * (1.0 / weak_m_s2 - 1.0 / brake_m_s2)
        return replace(
            capabilities,
            brake_m_s2=weak_m_s2,
            overshoot_m=capabilities.overshoot_m + further_m,
            # A robot beyond its target is off the leg's segment by as much.
            tube_m=capabilities.tube_m + further_m,
        )

    def impairment(self) -> Impairment:
        return Impairment(brake=self.options.factor)


class KillOptions(FaultOptions):
    """A robot that dies."""


class Kill(Fault[KillOptions]):
    """The robot is gone: motors off, link down. When it comes back it has forgotten everything.

    This needs no promise: silent robots are covered by the handling of stale states.
    """

    options_model: ClassVar[type[FaultOptions]] = KillOptions
    needs_vehicle: ClassVar[bool] = True

    def command(self, time_s: float, command: SentCommand) -> Sequence[Passage]:
        self.affected += 1
        return ()

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        return None if on else sample

    def impairment(self) -> Impairment:
        return Impairment(alive=False)
