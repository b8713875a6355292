"""Robots of any class that live in a simulated world in this process, as the kit opens them."""

from __future__ import annotations

from collections.abc import Sequence

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.clock import VirtualClock
from soter.conformance import Harness
from soter.conformance.find import open_floor
from soter.conformance.harness import FOR_EVER_S, LEG_M, specs_at
from soter.conformance.harness import LIMITS as JUDGED_BY
from soter.sdk import Capabilities, Fleet, RobotSpec, RuleLimits
from soter_sim import World


class SimulatedFleet(Fleet):
    """Robots that live in a simulated world in this process."""

    def __init__(self, kind: type[SimulatedRobot], specs: Sequence[RobotSpec], engine: str) -> None:
        # What is wrong with some is that the limits do not reach their world.
        limits: RuleLimits = getattr(kind, "judged_by", JUDGED_BY)
        self.world = World(open_floor().with_robots(len(specs)), specs, engine, limits)
        clock = getattr(kind, "clock_class", VirtualClock)(self.world.advance)
        super().__init__(clock, [kind(spec, clock, self.world) for spec in specs], self.world.truth)

    def _close(self) -> None:
        self.world.close()


class SimulatedHarness(Harness):
    """Opens robots of any class that lives in a simulated world in this process."""

    leg_m = LEG_M
    charges_at_start = True
    contacts = True
    robots_most = 3
    limits = JUDGED_BY

    def __init__(self, kind: type[SimulatedRobot], engine: str = "kinematic") -> None:
        self.name = kind.__name__
        self.kind = kind
        self.engine = engine

    def open(self, robots: int) -> Fleet:
        return SimulatedFleet(self.kind, specs_of(robots), self.engine)

    def promising(self, promised: Capabilities, robots: int = 1) -> Fleet:
        return SimulatedFleet(self.kind, specs_of(robots, promised), self.engine)

    def charged(self, charge: float, lasts_s: float = FOR_EVER_S, charge_s: float = FOR_EVER_S) -> Fleet:
        return SimulatedFleet(self.kind, specs_of(1, None, charge, lasts_s, charge_s), self.engine)

    def choosing(self, order: Sequence[int]) -> Fleet:
        there = specs_of(self.robots_most)
        chosen = [there[each] for each in order]
        # What is wrong with some is which they open.
        opens = getattr(self.kind, "opens", None)
        return SimulatedFleet(self.kind, opens(there, chosen) if opens else chosen, self.engine)

    def another(self) -> Harness:
        return self

    def close(self) -> None:
        pass


def specs_of(
    robots: int,
    promised: Capabilities | None = None,
    charge: float | None = None,
    lasts_s: float = FOR_EVER_S,
    charge_s: float = FOR_EVER_S,
) -> list[RobotSpec]:
    return specs_at(open_floor().robots[:robots], promised, charge, lasts_s, charge_s)
