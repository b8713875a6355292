"""Fault injection by the `[[fault]]` tables of a mission file, on any backend."""

from soter.faults.fault import Call, Context, Fault, FaultOptions, Impairable, Impairment, Passage, SentCommand, Spacing
from soter.faults.kinds import BUILT_IN, FaultTable, read_faults, under_faults
from soter.faults.robot import FaultyFleet, FaultyRobot

__all__ = [
    "BUILT_IN",
    "Call",
    "Context",
    "Fault",
    "FaultOptions",
    "FaultTable",
    "FaultyFleet",
    "FaultyRobot",
    "Impairable",
    "Impairment",
    "Passage",
    "SentCommand",
    "Spacing",
    "read_faults",
    "under_faults",
]
