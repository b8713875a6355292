"""What the tests of the machines share: some events, and a tester that explores every order."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

from soter.machine import Event, Machine, MachineRef, Runtime

Outcome = TypeVar("Outcome", bound=Hashable)


class A(Event):
    pass


class B(Event):
    pass


class C(Event):
    pass


class D(Event):
    pass


@dataclass(frozen=True, slots=True)
class Num(Event):
    n: int


@dataclass(frozen=True, slots=True)
class To(Event):
    ref: MachineRef


class Logger(Machine, abstract=True):
    """A machine that notes what it does."""

    def __init__(self, log: list[Any] | None = None) -> None:
        self.log: list[Any] = [] if log is None else log


class ManualClock:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def __call__(self) -> float:
        return self.time_s


def runtime(**options: Any) -> Runtime:
    """Make a runtime whose time stands still."""
    options.setdefault("now", lambda: 0.0)
    return Runtime(**options)


def start(machine: type[Machine], *args: Any, **kwargs: Any) -> tuple[Runtime, MachineRef]:
    """Run a machine of a live runtime up to where it rests."""
    made = runtime()
    ref = made.create(machine, *args, **kwargs)
    made.run()
    return made, ref


def feed(made: Runtime, ref: MachineRef, *events: Event) -> None:
    """Post events, all before the first is handled."""
    for event in events:
        made.post(ref, event)
    made.run()


class Replay:
    """Repeats a list of choices, then takes the first option, and notes how many options there were."""

    def __init__(self, choices: list[int]) -> None:
        self.choices = choices
        self.taken: list[tuple[int, int]] = []

    def pick(self, n: int) -> int:
        index = self.choices[len(self.taken)] if len(self.taken) < len(self.choices) else 0
        self.taken.append((index, n))
        return index


def explore(
    program: Callable[[Runtime], Callable[[], Outcome]], *, max_steps: int = 200, max_runs: int = 20_000
) -> tuple[list[Outcome], int]:
    """Run a program in every order.

    Args:
        program: Sets a runtime up and returns what tells the outcome after the run.
        max_steps: Where a run is cut off.
        max_runs: Where the exploration fails.

    Returns:
        The outcomes in the order of their first appearance, and the number of runs.
    """
    outcomes: dict[Outcome, None] = {}
    choices: list[int] = []
    for runs in range(1, max_runs + 1):
        replay = Replay(choices)
        made = runtime(pick=replay.pick)
        outcome = program(made)
        made.run(max_steps)
        outcomes[outcome()] = None
        taken = replay.taken
        while taken and taken[-1][0] == taken[-1][1] - 1:
            taken.pop()
        if not taken:
            return list(outcomes), runs
        choices = [index for index, _ in taken[:-1]] + [taken[-1][0] + 1]
    raise AssertionError(f"more than {max_runs} runs")
