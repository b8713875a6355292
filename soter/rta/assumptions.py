"""The numbered assumptions of the safety argument, and the log of those that a run saw fail."""

from __future__ import annotations

import math
from enum import Enum
from typing import Final, NamedTuple, Self

SPELL_S: Final = 2.0
"""Looks at which the same assumption fails belong to one spell if no more fleet time than this separates them."""


class Assumption(Enum):
    """One numbered assumption. The numbers are stable: causes, results and documents refer to them.

    Attributes:
        id: its number, such as "A1".
        statement: what is assumed, in one sentence.
        monitor: how a running mission notices that it does not hold, and what goes unnoticed.
    """

    MOTION = (
        "A1",
        (
            "A robot moves as its reach model allows: no faster than v_max_m_s, and within the other limits that "
            "the model of a module uses."
        ),
        "Every sample is tested against the reach set of the sample before it.",
    )
    BRAKING = (
        "A2",
        "A robot that is told to stop decelerates by at least brake_m_s2.",
        "Told to stop, a robot that has begun to may get no farther and slow down no less than it promises.",
    )
    LATENCY = (
        "A3",
        "A command is delivered, and acted upon within latency_s.",
        (
            "A robot that was told to stop may not still be at full speed where it should rest; an interface that "
            "raises counts as well."
        ),
    )
    SAMPLE_AGE = (
        "A4",
        "There is a finite sample of the robot, and it is at most sample_age_s old.",
        "The age and the numbers of every sample are looked at, at every tick.",
    )
    JITTER = (
        "A5",
        "A decision module looks every Delta, at most jitter_s late.",
        "The time between two looks of every decision module is measured.",
    )
    POSITION_NOISE = (
        "A6",
        "A reported position is wrong by at most position_noise_m.",
        (
            "A sample outside the reach set whose own speeds cannot explain the way between the two. A bias that "
            "does not change, or creeps, is not seen."
        ),
    )
    PEERS = (
        "A7",
        "Every other robot runs SOTER or respects the declared bound, and is heard of in time or comes to rest.",
        (
            "Every peer's samples are tested against the bound that is declared for peers, and against the time "
            "for which a peer may be silent. Whether it runs SOTER is not seen."
        ),
    )
    DISCHARGE = (
        "A8",
        "The charge falls no faster than at driving power, and is reported as it is.",
        (
            "Every charge is tested against the one before it, and must fall while the robot drives. A charge that is "
            "off by the same amount all along is not seen."
        ),
    )
    WORKSPACE = (
        "A9",
        "Fence, boxes and chargers are known and do not move.",
        (
            "Between two looks no margin may fall by more than its model allows. What the workspace file does not "
            "have is not seen."
        ),
    )
    LEASE = (
        "A10",
        "A robot whose lease is not renewed stops by itself within lease_s.",
        "A robot whose lease was withheld may not get farther than the lease, latency and braking take it.",
    )
    SCHEDULING = (
        "A11",
        "The supervisor's process is scheduled; where it is not, the lease runs out and the robot stops.",
        "A time between two looks that is longer than Delta, jitter_s and the lease together.",
    )
    AUTHORITY = (
        "A12",
        "The AC has no other way to the actuator than its port, and nobody else has any.",
        (
            "A robot that reports its controller may not report another one than was put in charge, nor none, once "
            "latency_s has passed; nor may others say velocities to a robot's base, where the adapter hears that; nor "
            "may a robot say of itself that it does something else than it is told."
        ),
    )
    START = (
        "A13",
        "Every module's rule holds at the start.",
        "The margin at the first look of every decision module.",
    )
    RECOVERY = (
        "A14",
        "Under its safe controllers a robot that is inside phi_safe stays inside (P2a).",
        "The margin at every later look of every decision module.",
    )
    CLOCK = (
        "A15",
        (
            "Neither fleet time nor a stamp ever goes back, and no stamp is ahead of fleet time. A jump ahead is "
            "a late look."
        ),
        "The time of every tick and the stamp of every sample are compared with those before, and with each other.",
    )

    CONTRACT = (
        "A16",
        (
            "A safe controller of the user's does not fail, and lets go within lets_go_s where the battery's module "
            "needs to drive."
        ),
        (
            "What it raises or publishes that is no waypoint, and the time for which a robot that has to charge "
            "stands while such a module has it. The return path is driven after lets_go_s where it keeps the module's "
            "rule."
        ),
    )

    id: str
    statement: str
    monitor: str

    def __new__(cls, number: str, statement: str, monitor: str) -> Self:
        member = object.__new__(cls)
        member._value_ = member.id = number
        member.statement = statement
        member.monitor = monitor
        return member

    def __str__(self) -> str:
        return self.id


class Worst(NamedTuple):
    """The look at which an assumption failed by the most, of all excesses in one unit.

    Attributes:
        excess: by how much the observed value exceeded the assumed one.
        unit: unit of the excess.
        time_s: fleet time.
        cause: what was seen then, in words.
    """

    excess: float
    unit: str
    time_s: float
    cause: str


class Breach(NamedTuple):
    """How often, and how badly, an assumption failed for one robot.

    Attributes:
        times: number of looks at which it failed.
        first_s: fleet time of the first of them.
        cause: what was seen at the first, in words.
        last_s: fleet time of the last of them.
        worst: the worst look for each unit in which an excess was measured; empty if none was measured.
    """

    times: int
    first_s: float
    cause: str
    last_s: float
    worst: tuple[Worst, ...] = ()

    def joined(self, later: Breach) -> Breach:
        """Return this breach and a later one of the same assumption as one breach."""
        worst = self.worst
        for new in later.worst:
            old = next((each for each in worst if each.unit == new.unit), None)
            if old is None:
                worst = (*worst, new)
            elif new.excess > old.excess:
                worst = tuple(new if each is old else each for each in worst)
        return Breach(self.times + later.times, self.first_s, self.cause, max(self.last_s, later.last_s), worst)


class AssumptionLog:
    """Which assumptions did not hold for one robot. Written by its supervisor, in the supervisor's thread.

    Attributes:
        breaches: by assumption, in the order of their first breach.
        spells: by assumption, its current spell: the latest failed looks, each within `SPELL_S` of the one before.
    """

    __slots__ = ("breaches", "spells")

    def __init__(self) -> None:
        self.breaches: dict[Assumption, Breach] = {}
        self.spells: dict[Assumption, Breach] = {}

    def note(self, assumption: Assumption, now_s: float, cause: str, excess: float = math.nan, unit: str = "") -> None:
        """Count one look at which the assumption failed; keep the first cause and the worst.

        Args:
            assumption: the one that failed.
            now_s: fleet time.
            cause: what was seen, in words.
            excess: by how much the observed value exceeded the assumed one; NaN if that cannot be measured.
            unit: unit of the excess.
        """
        worst = (Worst(excess, unit, now_s, cause),) if math.isfinite(excess) else ()
        seen = Breach(1, now_s, cause, now_s, worst)
        before, spell = self.breaches.get(assumption), self.spells.get(assumption)
        self.breaches[assumption] = seen if before is None else before.joined(seen)
        goes_on = spell is not None and now_s - spell.last_s <= SPELL_S
        self.spells[assumption] = spell.joined(seen) if spell is not None and goes_on else seen
