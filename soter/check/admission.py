"""Decides within milliseconds, before any robot is opened, whether a mission may be run.

Also finds how much faster than the host's clock a simulated world may run before a module is ill-formed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from soter.check.conditions import Certainty, Finding, conditions, rejection
from soter.check.proof import prove
from soter.config import MissionFile
from soter.errors import IllFormedModule
from soter.geometry.workspace import Workspace
from soter.rta import Port, Region, Topic
from soter.rta.module import looks_at_peers, margin_of, no_answer
from soter.sdk import Backend, BackendConfig, Capabilities
from soter.specs import asked
from soter.stack.actuator import PortForwarder
from soter.stack.declaration import Declared, declare, terrains_of
from soter.stack.infrastructure import standing
from soter.stack.peers import Peers
from soter.stack.right_of_way import BATTERY, WAIT_S, RightOfWay
from soter.stack.safe_controller import WAYPOINT

_LONGEST_DWELL_S: Final = 0.8 * WAIT_S
"""Longest dwell of a rule about pairs: a robot that dwells counts as waiting."""

_STEPS: Final = 20
"""Bisection steps of the search for the highest speed-up; far finer than the figure in the message."""


def declare_all(
    mission: MissionFile, workspace: Workspace, promised: Mapping[int, Capabilities]
) -> dict[int, Declared]:
    """Declare every robot's modules without a robot.

    Raises:
        IllFormedModule: a robot does not promise what the model of a module needs.
    """
    terrains = terrains_of(workspace, promised)
    made = {}
    for robot_id, capabilities in promised.items():
        forwarder = PortForwarder(Port(robot_id, lambda _: None), Topic(WAYPOINT), mission.base_tick_s)
        made[robot_id] = declare(
            mission, workspace, terrains[robot_id], robot_id, capabilities,
            Peers.of(robot_id, promised, mission.base_tick_s), forwarder, RightOfWay(),
        )  # fmt: skip
    return made


def highest_speedup(
    mission: MissionFile, workspace: Workspace, backend: type[Backend], config: BackendConfig, most: float
) -> float | None:
    """Return the highest speed-up at which all modules are well-formed, None without one; at `most` some are not.

    Latency, age and jitter are the host's: in the time of a world that runs N times as fast, they are N times as long.
    """

    def well_formed(speedup: float) -> bool:
        promised = asked(backend, config.model_copy(update={"speedup": speedup}), mission, workspace)
        try:
            for declared in declare_all(mission, workspace, promised).values():
                declared.check(mission.base_tick_s)
        except IllFormedModule:
            return False
        return True

    low, high = 0.0, most
    for _ in range(_STEPS):
        middle = (low + high) / 2.0
        if well_formed(middle):
            low = middle
        else:
            high = middle
    return low if low > 0.0 else None


def refused_at(
    failure: IllFormedModule, mission: MissionFile, workspace: Workspace, backend: type[Backend], config: BackendConfig
) -> IllFormedModule:
    """Return the failure with what else may be done: the highest admissible speed-up, and where to look further.

    What would do for one condition may not do for another.
    """
    why, most = failure.why, getattr(config, "speedup", None)
    highest = highest_speedup(mission, workspace, backend, config, most) if isinstance(most, float) else None
    if highest is not None:
        fits = math.floor(highest * 100.0) / 100.0
        why += f"; or backends.{mission.backend}.speedup = {fits:g}, not {most:g}"
    # Where code has failed no figures would do.
    hint = "; `soter check` says which figures would do together" if "would do" in why else ""
    return IllFormedModule(failure.module, failure.condition, f"{why}{hint}", failure.would_do, failure.remedy)


@dataclass(frozen=True)
class Admission:
    """What is known about the modules of a mission without trials.

    Attributes:
        findings: whether the modules are well-formed (P1, P3 and further checks before anything moves), one for each
            module and condition, in order of priority. A mission with a rejected one is never run.
        proofs: findings about P2. A mission with one that is not proved is run on request only.
    """

    findings: Sequence[Finding]
    proofs: Sequence[Finding] = ()

    @property
    def refused(self) -> bool:
        """Whether any finding is a rejection."""
        return any(each.verdict is Certainty.REJECTED for each in (*self.findings, *self.proofs))

    @property
    def ill_formed(self) -> Finding | None:
        """The first rejection, which cannot be accepted, or None."""
        return next((each for each in self.findings if each.verdict is Certainty.REJECTED), None)

    @property
    def unproved(self) -> list[Finding]:
        """P3 of predicates, and failed proofs: a mission with them is run only if they are accepted."""
        predicates = [each for each in self.findings if (each.condition, each.verdict) == ("P3", Certainty.ASSUMED)]
        return [*predicates, *(each for each in self.proofs if each.verdict is not Certainty.PROVED)]

    def untried(self, names: Sequence[str]) -> list[str]:
        """Return which of these modules have no finding about P2, so that only trials can tell."""
        told = {each.module for each in (*self.findings, *self.proofs) if each.condition == "P2a"}
        return [name for name in names if name not in told]


def admit(mission: MissionFile, workspace: Workspace, capabilities: Mapping[int, Capabilities]) -> Admission:
    """Return what is known about the modules of a mission on robots with these promises."""
    try:
        declared = declare_all(mission, workspace, capabilities)
    except IllFormedModule as failure:
        # A module cannot be declared at all: these robots do not promise what its model needs.
        return Admission([rejection(failure)])
    return admit_declared(mission, declared, capabilities)


def admit_declared(
    mission: MissionFile, declared: Mapping[int, Declared], capabilities: Mapping[int, Capabilities]
) -> Admission:
    """Return what is known about modules that are declared already; see `admit`."""
    findings = [found for name in mission.rta.order for found in _conditions(mission, declared, name)]
    if any(each.verdict is Certainty.REJECTED for each in findings):
        return Admission(findings)
    try:
        check_all(mission, declared)
    except IllFormedModule as failure:
        return Admission([*findings, rejection(failure)])
    return Admission([*findings, *_contracts(mission, declared)], prove(mission, declared, capabilities))


def check_all(mission: MissionFile, declared: Mapping[int, Declared]) -> None:
    """Check all modules, that rules hold where robots start (A13), and users' rules where all robots charge (P2b)."""
    places = [each.place for each in declared.values()]
    starts = {place.id: (place.x_m, place.y_m, place.heading_rad) for place in places}
    stations = {place.id: place.charger.centre for place in places}
    charges = BATTERY in mission.rta.order
    for robot_id, each in declared.items():
        each.check(mission.base_tick_s)
        begins, docked = standing(robot_id, starts), standing(robot_id, stations)
        for module in each.modules:
            region = module.phi_safe
            if region is not None and (why := no_answer(region, begins)):
                raise IllFormedModule(
                    module.name,
                    "A13",
                    f"its rule cannot be judged where robot {robot_id} starts, at ({each.place.x_m:g}, "
                    f"{each.place.y_m:g}): {why}; it has to return a number there",
                )
            if region is not None and (margin := margin_of(region, begins)) < 0.0:
                raise IllFormedModule(
                    module.name,
                    "A13",
                    f"its rule does not hold where robot {robot_id} starts, at ({each.place.x_m:g}, "
                    f"{each.place.y_m:g}): the margin is {margin:.3f} {region.unit}; a start where it is 0 or more "
                    "would do",
                )
            safer, of_users = module.phi_safer, module.name in mission.rta.module
            if module.of_pairs and each.others and module.dwell_s > _LONGEST_DWELL_S:
                key = "rta.module" if of_users else "rta"
                raise IllFormedModule(
                    module.name,
                    "P2b",
                    f"{key}.{module.name}.dwell_s is {module.dwell_s:g} s, and robots that wait for each other for "
                    f"{WAIT_S:g} s begin to take turns, so that those that only dwell hold each other up; at most "
                    f"{_LONGEST_DWELL_S:g} s would do",
                )
            if of_users and region is not None and not module.of_pairs and looks_at_peers(region, begins):
                raise IllFormedModule(
                    module.name,
                    "P3",
                    "its rule looks at situation.peers, but its model bounds what this robot alone takes from the "
                    "margin, and peers move as well; PairBound(kit.model, kit.peer_model) would do, or a rule without "
                    "peers",
                )
            if of_users and region is not None:
                later = begins.copy()
                later.now_s = mission.duration_s
                if (then := margin_of(region, later)) != (now := margin_of(region, begins)):
                    raise IllFormedModule(
                        module.name,
                        "P3",
                        f"its rule depends on the time: where robot {robot_id} starts its margin is {now:.3f} "
                        f"{region.unit} at 0 s and {then:.3f} {region.unit} at {later.now_s:g} s, and its model bounds "
                        "what robots take from it; a rule without now_s would do",
                    )
            if not (of_users and charges and isinstance(safer, Region)):
                continue
            if why := no_answer(safer, docked):
                raise IllFormedModule(
                    module.name,
                    "P2b",
                    f"it keeps robot {robot_id} from its AC while all robots charge: with each on its station the "
                    f"margin of phi_safer fails: {why}; it has to return a number there",
                )
            if (margin := margin_of(safer, docked)) < 0.0:
                raise IllFormedModule(
                    module.name,
                    "P2b",
                    f"it keeps robot {robot_id} from its AC while all robots charge: with each on its station the "
                    f"margin of phi_safer is {margin:.3f} {safer.unit}; stations where it is 0 or more, or a phi_safer "
                    "that leaves room for them, would do",
                )


def _conditions(mission: MissionFile, declared: Mapping[int, Declared], name: str) -> list[Finding]:
    """Return the findings about P1 and P3 of a module, for the robot with the worst ones."""
    found = [conditions(each.module(name), each.timing, mission.base_tick_s) for each in declared.values()]
    rejected = [each for each in found if any(one.verdict is Certainty.REJECTED for one in each)]
    return rejected[0] if rejected else min(reversed(found), key=lambda each: _spare(each[-1]))


def _spare(found: Finding) -> float:
    """Return the margin that P3 leaves at the edge of phi_safer."""
    edge, reach, noise = (found.figures.get(name) for name in ("edge_margin", "reach", "noise"))
    return math.inf if edge is None or reach is None or noise is None else float(edge) - float(reach) - float(noise)


def _contracts(mission: MissionFile, declared: Mapping[int, Declared]) -> list[Finding]:
    """Return the finding about P2c of every module before the battery's: that it lets the robot go home."""
    order = mission.rta.order
    if BATTERY not in order:
        return []
    # A contract may differ between robots: the longest counts.
    modules = [
        max((each.module(name) for each in declared.values()), key=lambda one: one.lets_go_s)
        for name in order[: order.index(BATTERY)]
    ]
    return [
        Finding(each.name, "P2c", Certainty.PROVED, "it drives the return path itself while the battery's module waits")
        if math.isinf(each.lets_go_s)
        else Finding(
            each.name, "P2c", Certainty.ASSUMED,
            f"a robot that has to charge, or stands, is let go within {each.lets_go_s:g} s (A16), for which the "
            "reserve pays; then the return path is driven where it keeps the module's rule",
        )
        for each in modules
    ]  # fmt: skip
