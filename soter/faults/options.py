"""What every `[[fault]]` table of a mission file may say, whatever its kind."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails

from soter.problems import not_allowed
from soter.workspace_xml import MAX_ROBOT_ID

Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
Interval = Annotated[float, Field(ge=0.001, le=1e7, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]

_ROUNDING_S = 1e-9


def wrong(key: str, value: object, allowed: str) -> ValidationError:
    """Return an error on one key of the table that is being validated."""
    return ValidationError.from_exception_data(
        "fault", [InitErrorDetails(type=not_allowed(allowed), loc=(key,), input=value)]
    )


class FaultOptions(BaseModel):
    """The part of a `[[fault]]` table that all kinds share; each kind's own model adds its parameters.

    Attributes:
        kind: a built-in kind, or a class as `module:Class`.
        robot: which robot suffers it: its id, or "all".
        start_s: when it begins, in seconds after the robot is ready.
        duration_s: how long it lasts; to the end of the run if it is not given.
        every_s: it comes again so long after it began; once only if it is not given.
        declared: the robot's promises are widened by what is injected, so that the safety modules pay for it. A fault
            that is not declared breaks the promises: the stack is not told.
    """

    # Strict: "0.1" is no number and 1 is no truth value; a slip is named instead of guessed at.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    kind: str
    robot: Literal["all"] | Annotated[int, Field(ge=1, le=MAX_ROBOT_ID)] = "all"
    start_s: Seconds = 0.0
    duration_s: Interval | None = None
    every_s: Interval | None = None
    declared: bool = True

    @model_validator(mode="after")
    def _repeats_after_its_end(self) -> Self:
        if self.every_s is not None and (self.duration_s is None or self.duration_s >= self.every_s):
            least = "a fault with a duration_s" if self.duration_s is None else f"above duration_s, {self.duration_s:g}"
            raise wrong("every_s", self.every_s, least)
        return self

    @property
    def pause_s(self) -> float:
        """How long it is off between two times that it is on; 0 without an end, infinite if it does not come again."""
        if self.duration_s is None:
            return 0.0
        return math.inf if self.every_s is None else self.every_s - self.duration_s

    def active(self, time_s: float) -> bool:
        """Return whether the fault is on, so many seconds after the robot was ready."""
        since_s = time_s - self.start_s + _ROUNDING_S
        if since_s < 0.0:
            return False
        if self.duration_s is None:
            return True
        if self.every_s is not None:
            since_s %= self.every_s
        return since_s < self.duration_s

    def window(self, time_s: float) -> int | None:
        """Return how often the fault has come again so many seconds after the robot was ready; None while it is off."""
        if not self.active(time_s):
            return None
        return 0 if self.every_s is None else int((time_s - self.start_s + _ROUNDING_S) // self.every_s)

    def end_s(self, time_s: float) -> float:
        """Return when the fault ends that is on so many seconds after the robot was ready; infinite if it does not."""
        if self.duration_s is None:
            return math.inf
        since_s = time_s - self.start_s + _ROUNDING_S
        if self.every_s is not None:
            since_s %= self.every_s
        return time_s + self.duration_s - since_s
