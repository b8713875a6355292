"""Injected faults: the `[[fault]]` tables of a mission file, on any backend."""

from soter.faults.fault import Call, Command, Context, Fault, FaultOptions, Impairable, Impairment, Passage, Spacing
from soter.faults.kinds import BUILT_IN, FaultTable, read_faults
from soter.faults.robot import FaultReport, FaultyFleet, FaultyRobot

__all__ = [
    "BUILT_IN",
    "Call",
    "Command",
    "Context",
    "Fault",
    "FaultOptions",
    "FaultReport",
    "FaultTable",
    "FaultyFleet",
    "FaultyRobot",
    "Impairable",
    "Impairment",
    "Passage",
    "Spacing",
    "read_faults",
]
