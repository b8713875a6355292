"""The audience of the machines: specs, which judge what is sent, and observers of the changes of state."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

from soter.machine.errors import LivenessError, MachineError
from soter.machine.events import Event, Halt, MachineRef

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.machine.context import SpecContext
    from soter.machine.core import Core


class Transition(NamedTuple):
    """One change of state, as observers see it.

    Attributes:
        time_s: When, in seconds on the runtime's clock.
        machine: Which machine.
        source: The state that was left; None when the machine starts.
        event: The event that led to it; None at the start.
        target: The state that was entered, perhaps the same; None when the machine stops.
    """

    time_s: float
    machine: MachineRef
    source: str | None
    event: Event | None
    target: str | None


def _observes(spec: SpecContext, event: type[Event]) -> bool:
    observed: tuple[type[Event], ...] = type(spec.machine).__observes__
    # As in states, Halt counts only where it is named.
    return event in observed if event is Halt else issubclass(event, observed)


class Audience:
    """The specs and observers of a runtime, and their failures."""

    def __init__(self, core: Core) -> None:
        self.core = core
        self.specs: list[SpecContext] = []
        self.spec_ids: set[int] = set()
        self.observers: list[Callable[[Transition], None]] = []
        # Failures of specs and observers, not of the machine whose step it is; that step is finished before they
        # are reported.
        self.failures: deque[Exception] = deque()
        self._watchers: dict[type, tuple[SpecContext, ...]] = {}

    def attach(self, spec: SpecContext) -> None:
        """Start a spec."""
        self.spec_ids.add(spec.ref.id)
        self.specs.append(spec)
        self._watchers.clear()
        try:
            spec.perform()
        except MachineError:
            self.core.halt(spec)
            raise

    def detach(self, spec: SpecContext) -> None:
        """Forget a spec that has stopped."""
        self.specs.remove(spec)
        self._watchers.clear()

    def tell(self, event: Event) -> None:
        """Show an event to the specs that observe it, now."""
        watchers = self._watchers.get(event.__class__)
        if watchers is None:
            watchers = tuple(spec for spec in self.specs if _observes(spec, event.__class__))
            self._watchers[event.__class__] = watchers
        for spec in watchers:
            teller, self.core.current = self.core.current, spec
            try:
                spec.tell(event)
            except MachineError as error:
                # Not the sender's failure: its handler goes on, and the failure is reported after the step.
                self.core.halt(spec)
                self.failures.append(error)
            finally:
                self.core.current = teller

    def note(self, transition: Transition) -> None:
        """Tell the observers. An exception of theirs is no machine's failure and leaves `run` after the step."""
        for observer in tuple(self.observers):
            try:
                observer(transition)
            except Exception as exc:  # noqa: BLE001 - raised again by report()
                self.failures.append(exc)

    def check_temperature(self, limit: int) -> None:
        hot = [(s.ref.name, s.state.name) for s in self.specs if s.temperature(self.core.steps) > limit]
        if hot:
            raise LivenessError(f"hot for more than {limit} steps", hot)
