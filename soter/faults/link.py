"""Faults of the link: commands and samples arrive late, not at all, or twice."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from soter.config.table import wrong
from soter.faults import fault
from soter.sdk import Capabilities, RobotState


class DelayOptions(fault.FaultOptions):
    """Late commands, late samples.

    Attributes:
        commands_s: delay of every command.
        samples_s: delay of every sample.
        jitter_s: largest additional delay, drawn for each; the order is kept.
    """

    commands_s: fault.Seconds = 0.0
    samples_s: fault.Seconds = 0.0
    jitter_s: fault.Seconds = 0.0

    @model_validator(mode="after")
    def _delays_something(self) -> Self:
        if self.commands_s + self.samples_s + self.jitter_s <= 0.0:
            raise wrong(("commands_s",), self.commands_s, "above 0, or a samples_s or jitter_s above 0")
        return self


class Delay(fault.Fault[DelayOptions]):
    """Commands and samples come late, in their order."""

    options_model: ClassVar[type[fault.FaultOptions]] = DelayOptions

    def __init__(self, options: DelayOptions, context: fault.Context) -> None:
        super().__init__(options, context)
        self._under_way: deque[tuple[float, RobotState]] = deque()
        self._last: RobotState | None = None
        self._seen: RobotState | None = None

    def widened(self, capabilities: Capabilities) -> Capabilities:
        options = self.options
        # A jitter without a delay is for both commands and samples.
        commands = options.commands_s > 0.0 or options.samples_s == 0.0
        late_s = self.up_to_ticks(self._latest_s)
        return replace(
            capabilities,
            latency_s=capabilities.latency_s + (options.commands_s + options.jitter_s if commands else 0.0),
            sample_age_s=capabilities.sample_age_s + late_s,
        )

    def spacing(self) -> fault.Spacing:
        latest = self.ticks(self._latest_s)
        # A fault that repeats lets some samples through at once, and others late.
        soonest = self.ticks(self.options.samples_s) if self.options.every_s is None and latest else 0
        return fault.Spacing(held=latest - soonest)

    @property
    def _latest_s(self) -> float:
        """The longest delay of a sample."""
        options = self.options
        return options.samples_s + options.jitter_s if options.samples_s > 0.0 or options.commands_s == 0.0 else 0.0

    def command(self, time_s: float, command: fault.SentCommand) -> Sequence[fault.Passage]:
        options = self.options
        if options.commands_s == 0.0 and options.samples_s > 0.0:
            return (fault.Passage(command),)
        self.affected += 1
        return (fault.Passage(command, options.commands_s + self._jitter_s()),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        options = self.options
        if options.samples_s == 0.0 and options.commands_s > 0.0:
            return sample
        under_way = self._under_way
        if sample is not None and sample is not self._seen:
            self._seen = sample
            delay_s = options.samples_s + self._jitter_s() if on else 0.0
            self.affected += on
            after_s = under_way[-1][0] if under_way else 0.0
            under_way.append((max(after_s, time_s + delay_s), sample))
        while under_way and under_way[0][0] <= time_s + fault.ROUNDING_S:
            self._last = under_way.popleft()[1]
        return self._last

    def _jitter_s(self) -> float:
        return self.context.random.uniform(0.0, self.options.jitter_s) if self.options.jitter_s else 0.0


class LossOptions(fault.FaultOptions):
    """Commands and samples that get lost.

    Attributes:
        commands: probability that a transmission of a command is lost.
        samples: probability that a sample is lost.
        burst: most losses in a row; 0 for no limit, which no promise can cover.
        resend: whether a lost command is sent again at the next tick, as on a link with acknowledgements.
    """

    commands: fault.Probability = 0.0
    samples: fault.Probability = 0.0
    burst: Annotated[int, Field(ge=0, le=1_000_000)] = 1
    resend: bool = True

    @model_validator(mode="after")
    def _bounded_if_declared(self) -> Self:
        if self.commands + self.samples <= 0.0:
            raise wrong(("commands",), self.commands, "above 0, or a samples above 0")
        if self.declared and self.burst == 0:
            raise wrong(("burst",), self.burst, "1 or more; or declared = false, since nothing bounds such a loss")
        if self.declared and self.commands > 0.0 and not self.resend:
            raise wrong(("resend",), self.resend, "true; or declared = false, since no promise covers a lost command")
        return self


class Loss(fault.Fault[LossOptions]):
    """Commands and samples get lost, some in a row."""

    options_model: ClassVar[type[fault.FaultOptions]] = LossOptions

    def __init__(self, options: LossOptions, context: fault.Context) -> None:
        super().__init__(options, context)
        self._last: RobotState | None = None
        self._seen: RobotState | None = None
        self._row = 0
        self._commands_row = 0

    def widened(self, capabilities: Capabilities) -> Capabilities:
        options = self.options
        gap_s = options.burst * self.context.tick_s
        return replace(
            capabilities,
            latency_s=capabilities.latency_s + (gap_s if options.commands > 0.0 else 0.0),
            sample_age_s=capabilities.sample_age_s + (gap_s if options.samples > 0.0 else 0.0),
        )

    def spacing(self) -> fault.Spacing:
        return fault.Spacing(self.options.burst if self.options.samples > 0.0 else 0)

    def command(self, time_s: float, command: fault.SentCommand) -> Sequence[fault.Passage]:
        options = self.options
        if not options.resend:
            lost = self._drawn(options.commands, self._commands_row)
            self._commands_row = self._commands_row + 1 if lost else 0
            return () if lost else (fault.Passage(command),)
        tick_s, end_s = self.context.tick_s, options.end_s(time_s)
        if options.commands == 1.0 and options.burst == 0:
            # A link that is cut: waiting commands get through at its end.
            self.affected += 1
            return (fault.Passage(command, end_s - time_s),) if end_s < math.inf else ()
        tries = 0
        while time_s + tries * tick_s < end_s - fault.ROUNDING_S and self._drawn(options.commands, tries):
            tries += 1
        return (fault.Passage(command, tries * tick_s),)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if sample is self._seen:
            return self._last
        self._seen = sample
        if on and self._last is not None and self._drawn(self.options.samples, self._row):
            self._row += 1
        else:
            self._row = 0
            self._last = sample
        return self._last

    def _drawn(self, probability: float, row: int) -> bool:
        """Draw whether a transmission is lost, after `row` losses in a row."""
        burst = self.options.burst
        # Drawn in any case, so that earlier losses do not shift the random numbers of later transmissions.
        lost = self.context.random.random() < probability and (burst == 0 or row < burst)
        self.affected += lost
        return lost


class DuplicateOptions(fault.FaultOptions):
    """Commands and samples that come twice.

    Attributes:
        commands: probability that a command comes twice.
        samples: probability that a sample comes again in place of a newer one.
        after_s: time between a command and its copy.
        reorder: whether later commands may overtake the copy, so that an old command acts after newer ones.
    """

    commands: fault.Probability = 0.0
    samples: fault.Probability = 0.0
    after_s: fault.Seconds = 0.0
    reorder: bool = False

    @model_validator(mode="after")
    def _in_order_if_declared(self) -> Self:
        if self.commands + self.samples <= 0.0:
            raise wrong(("commands",), self.commands, "above 0, or a samples above 0")
        if self.declared and self.reorder:
            raise wrong(
                ("reorder",), self.reorder, "false; or declared = false, since no promise covers an old command"
            )
        return self


class Duplicate(fault.Fault[DuplicateOptions]):
    """Commands come twice; old samples come again."""

    options_model: ClassVar[type[fault.FaultOptions]] = DuplicateOptions

    def __init__(self, options: DuplicateOptions, context: fault.Context) -> None:
        super().__init__(options, context)
        self._last: RobotState | None = None
        self._seen: RobotState | None = None
        self._repeated = False

    def widened(self, capabilities: Capabilities) -> Capabilities:
        options = self.options
        return replace(
            capabilities,
            # In order, a copy delays the commands after it. There are no copies of copies.
            latency_s=capabilities.latency_s + (options.after_s if options.commands > 0.0 else 0.0),
            sample_age_s=capabilities.sample_age_s + (self.context.tick_s if options.samples > 0.0 else 0.0),
        )

    def spacing(self) -> fault.Spacing:
        return fault.Spacing(1 if self.options.samples > 0.0 else 0)

    def command(self, time_s: float, command: fault.SentCommand) -> Sequence[fault.Passage]:
        options = self.options
        if command.call is fault.Call.HALT or self.context.random.random() >= options.commands:
            return (fault.Passage(command),)
        self.affected += 1
        return fault.Passage(command), fault.Passage(command, options.after_s, options.reorder)

    def sample(self, time_s: float, on: bool, sample: RobotState | None) -> RobotState | None:
        if sample is self._seen:
            return self._last
        self._seen = sample
        again = on and self.context.random.random() < self.options.samples
        if again and not self._repeated and self._last is not None:
            self._repeated = True
            self.affected += 1
        else:
            self._repeated = False
            self._last = sample
        return self._last
