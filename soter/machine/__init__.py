"""State machines with the semantics of the P language.

A machine is a class: states as attributes, handlers as decorated methods, events as frozen dataclasses. A
`Runtime` creates machines, takes their steps in a reproducible order, and connects them with a clock and with
other threads. `Spec` machines watch what is sent and judge it.
"""

from soter.machine.audience import Transition
from soter.machine.errors import (
    EventError,
    HandlerError,
    LivenessError,
    MachineDefinitionError,
    MachineError,
    MisuseError,
    SpecError,
    UnhandledEventError,
)
from soter.machine.events import Event, Halt, MachineRef
from soter.machine.intake import Timer
from soter.machine.machines import Machine, Spec
from soter.machine.runtime import Blocked, Runtime, SpecStatus
from soter.machine.states import Goto, Next, Raise, State, Stay

__all__ = [
    "Blocked",
    "Event",
    "EventError",
    "Goto",
    "Halt",
    "HandlerError",
    "LivenessError",
    "Machine",
    "MachineDefinitionError",
    "MachineError",
    "MachineRef",
    "MisuseError",
    "Next",
    "Raise",
    "Runtime",
    "Spec",
    "SpecError",
    "SpecStatus",
    "State",
    "Stay",
    "Timer",
    "Transition",
    "UnhandledEventError",
]
