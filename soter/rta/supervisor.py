"""The supervisor: every tick it senses, lets the due decision modules judge, and drives by whoever is in charge."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

from soter.rta.decision import DecisionModule
from soter.rta.models import ReachModel
from soter.rta.module import Timing
from soter.rta.neighbours import Neighbours
from soter.rta.situation import Mode, Sample, Situation
from soter.rta.topics import Node, Topic

logger = logging.getLogger(__name__)

SUPERVISOR = "supervisor"
"""Named as the module when a disengagement comes from an assumption that failed, not from a module's margin."""


ALARM_S: Final = 0.3
"""A robot whose assumptions failed stays with its safe controllers until they have held for so long."""


class Actuator(Protocol):
    """The robot as the supervisor needs it. Used from the supervisor's thread only."""

    def read(self) -> Sample:
        """Return the latest sample without waiting."""

    def drive(self, command: Any, mode: Mode) -> None:
        """Pass on a command of the controller in charge; None means stop."""

    def hand_over(self, mode: Mode, module: str, cause: str) -> None:
        """Put another controller in charge; flush what the one before had in flight."""

    def renew(self) -> None:
        """Let the robot move on for another lease."""


class SwitchRecord(NamedTuple):
    """One change of control of a robot, or of the module that drives.

    Attributes:
        time_s: fleet time.
        robot_id: which robot.
        before: module that drove, or None for the AC.
        after: module that drives now, or None for the AC.
        module: the one that caused the change: the first that fired, or the last that released.
        cause: in words.
        joined: further modules that fired in the same tick.
    """

    time_s: float
    robot_id: int
    before: str | None
    after: str | None
    module: str
    cause: str
    joined: tuple[str, ...]


class Watch(Protocol):
    """Somebody who is told of every switch; may not change anything."""

    def on_switch(self, record: SwitchRecord, robot: RobotSupervisor) -> None:
        """Called when a robot changed hands, before its new driver's first command."""


class RobotSupervisor:
    """All decision modules, safe controllers and the hand-over of one robot.

    Attributes:
        mode: who has control.
        driver: the module that drives, or None for the AC.
        situation: what the robot knew at the last tick.
        decide_s: host time of the last decisions, in seconds.
        ac_failure: why the AC will never get control again; empty while it may.

    Args:
        robot_id: which robot.
        actuator: its narrow interface.
        modules: in the order of their right to drive; the first that is in SC drives.
        ac: the forwarder of the AC's port.
        waypoint: the topic that AC and SCs publish.
        models: reach models against which every sample is tested.
        timing: the robot's declared timing.
        watches: told of switches.
    """

    def __init__(
        self,
        robot_id: int,
        actuator: Actuator,
        modules: Sequence[DecisionModule],
        ac: Node,
        waypoint: Topic[Any],
        models: Sequence[ReachModel],
        timing: Timing,
        watches: Sequence[Watch] = (),
    ) -> None:
        self.robot_id: Final = robot_id
        self.modules: Final = tuple(modules)
        for rank, module in enumerate(self.modules):
            module.rank = rank
        self.actuator: Final = actuator
        self.mode = Mode.SC if modules else Mode.AC
        self.driver: DecisionModule | None = self.modules[0] if modules else None
        self.situation = Situation(robot_id, actuator.read(), 0.0)
        self.decide_s = 0.0
        self._ac: Final = ac
        self._waypoint: Final = waypoint
        self._sent = waypoint.count
        self._models: Final = tuple(models)
        self._timing: Final = timing
        self._lateness_s: Final = timing.jitter_s + 1e-6
        self._watches: Final = tuple(watches)
        self.ac_failure = ""
        self._alarm = ""
        self._alarmed_until_s = -math.inf
        self._refused = False
        self._owed: tuple[str, str] | None = None
        self._looked_s = [math.nan] * len(self.modules)
        self._announced_ac = False

    def fail_ac(self, cause: str) -> None:
        """Never give this robot to its AC again: that has failed for good, and the cause says how.

        Its modules go on judging; while none of them needs to drive, the last one does (the battery's: it goes home).
        """
        self.ac_failure = self.ac_failure or cause

    # --- one tick, in three passes over all robots -----------------------------------------------------------

    def sense(self, now_s: float) -> Sample:
        """Read the sample and test it against what the models allow."""
        situation = self.situation
        before = situation.own
        self._alarm = ""
        try:
            sample = self.actuator.read()
            if not math.isfinite(sample.x_m + sample.y_m + sample.stamp_s):
                # Comparisons with NaN are false: a minimum over distances would leave it out, for this robot and peers.
                raise ValueError(f"the sample is not finite: {sample}")
        except Exception as failure:  # noqa: BLE001 - whatever fails here, the robot goes to its SC
            situation.now_s = now_s
            situation.age_s = max(0.0, now_s - before.stamp_s)
            self._raise_alarm(f"no state: {failure}")
            return before
        situation.own = sample
        situation.now_s = now_s
        # A clock that runs ahead a little must not make a reach bound smaller than that of a fresh sample.
        age_s = max(0.0, now_s - sample.stamp_s)
        situation.age_s = age_s
        if age_s > self._timing.sample_age_s + 1e-9:
            self._raise_alarm(f"sample is {age_s:.3f} s old, declared at most {self._timing.sample_age_s:.3f} s")
        elif sample is not before:
            for model in self._models:
                if not model.admits(before, sample, self._timing.noise_m):
                    self._raise_alarm(f"sample outside the reach set of {type(model).__name__}")
                    break
        return sample

    def _raise_alarm(self, cause: str) -> None:
        """Note that an assumption has failed: the AC loses control for a while, whatever the margins are."""
        self._alarm = cause
        self._alarmed_until_s = self.situation.now_s + ALARM_S

    def decide(self, tick: int) -> None:
        """Let every due decision module judge, settle who drives, and hand over if that changed."""
        situation = self.situation
        fired: list[DecisionModule] = []
        released: DecisionModule | None = None
        driver: DecisionModule | None = None
        now_s = situation.now_s
        # While an assumption has failed, what was judged before it did says nothing: everybody looks at every tick,
        # and the AC gets control back only on what was seen afterwards.
        alarmed = now_s < self._alarmed_until_s
        for rank, module in enumerate(self.modules):
            try:
                if alarmed or tick % module.every_ticks == 0:
                    since_s = now_s - self._looked_s[rank]
                    self._looked_s[rank] = now_s
                    if since_s > module.delta_s + self._lateness_s:
                        self._raise_alarm(f"'{module.name}' looked after {since_s:.3f} s, not {module.delta_s:g} s")
                    if module.decide(situation):
                        if module.mode is Mode.SC:
                            fired.append(module)
                        else:
                            released = module
                elif module.mode is Mode.SC:
                    module.observe(situation)
            except Exception as failure:
                logger.exception("robot %d: decision module '%s' failed", self.robot_id, module.name)
                if module.mode is Mode.AC:
                    fired.append(module)
                module.force(now_s, f"decision module failed: {failure!r}")
            if driver is None and module.mode is Mode.SC:
                driver = module
        if driver is None and (now_s < self._alarmed_until_s or self.ac_failure):
            driver = self._without_module()
        if driver is not self.driver or (driver is None and self.mode is Mode.SC):
            self._change_driver(driver, fired, released)
        elif driver is None and not self._announced_ac:
            self._announced_ac = True
            self._hand_over("", "no safety module is enabled")
        elif self._owed is not None:
            self._hand_over(*self._owed)

    def act(self) -> None:
        """Let the controller in charge take its step, send what it published, renew the lease."""
        situation = self.situation
        driver = self.driver
        node = self._ac if driver is None else driver.module.sc
        waypoint = self._waypoint
        try:
            node.step(situation)
        except Exception as failure:  # noqa: BLE001 - a controller that fails must not take others along
            self._isolate(node, failure)
            self._sent = waypoint.count
        if waypoint.count != self._sent:
            self._sent = waypoint.count
            self._attempt(lambda: self.actuator.drive(waypoint.value, self.mode))
        if not self._refused:
            self._attempt(self.actuator.renew)
        self._refused = False

    def _hand_over(self, module: str, cause: str) -> None:
        """Put the controller of the present mode in charge; if that fails it is owed, and tried at every tick.

        Until then the lease is not renewed: a robot that did not hear of its disengagement must not go on.
        """
        self._owed = (module, cause)
        self._attempt(lambda: self.actuator.hand_over(self.mode, module, cause))
        if not self._refused:
            self._owed = None

    def _attempt(self, call: Callable[[], None]) -> None:
        """Call the actuator; where it fails the lease is left to run out, and the AC loses control for a while."""
        try:
            call()
        except Exception as failure:
            logger.exception("robot %d: its interface failed", self.robot_id)
            self._refused = True
            self._raise_alarm(f"interface failed: {failure!r}")

    def _without_module(self) -> DecisionModule | None:
        """Return whose safe controller drives when no module asks for it, but the AC may not."""
        if not self.modules:
            self._attempt(lambda: self.actuator.drive(None, self.mode))
            return None
        return self.modules[-1] if self.ac_failure else self.modules[0]

    # --- changes of hands ------------------------------------------------------------------------------------

    def _change_driver(
        self, driver: DecisionModule | None, fired: Sequence[DecisionModule], released: DecisionModule | None
    ) -> None:
        before = self.driver
        was = self.mode
        self.driver = driver
        self.mode = Mode.AC if driver is None else Mode.SC
        first = fired[0] if fired else released or driver or before
        name = first.name if first is not None else ""
        cause = first.cause if first is not None else ""
        if was is Mode.AC and not fired:
            name, cause = SUPERVISOR, self._alarm or self.ac_failure
        if self.mode is not was or before is not driver:
            # A change of the driver flushes the goal too: the next SC must not inherit a motion it never certified.
            if self.mode is was:
                self._attempt(lambda: self.actuator.drive(None, self.mode))
            else:
                self._announced_ac = True
                self._hand_over(name, cause)
        record = SwitchRecord(
            self.situation.now_s,
            self.robot_id,
            before.name if before is not None and was is Mode.SC else None,
            driver.name if driver is not None else None,
            name,
            cause,
            tuple(module.name for module in fired[1:]),
        )
        for watch in self._watches:
            try:
                watch.on_switch(record, self)
            except Exception:
                # Watches look at what the AC intends, which is untrusted; statistics must not cost the robots anything.
                logger.exception("robot %d: a watch failed", self.robot_id)
        self._sent = self._waypoint.count
        if driver is not None:
            try:
                driver.module.sc.engage(self.situation)
            except Exception as failure:  # noqa: BLE001 - a controller that fails must not take others along
                self._isolate(driver.module.sc, failure)

    def _isolate(self, node: Node, failure: Exception) -> None:
        logger.error("robot %d: node '%s' failed", self.robot_id, node.name, exc_info=failure)
        self._attempt(lambda: self.actuator.drive(None, self.mode))
        if self.mode is Mode.AC:
            self.fail_ac(f"AC failed: {failure!r}")


class Supervisor:
    """The supervisors of all robots of a fleet, ticked together.

    Args:
        robots: one supervisor a robot.
        base_tick_s: period of the tick.
        neighbour_radius_m: peers farther away than this are left out of a robot's situation; must exceed every
            distance at which a module or safe controller takes notice of a peer.
        before_decisions: called once a tick, after all robots were sensed and before any decides: the arbiter.
    """

    def __init__(
        self,
        robots: Sequence[RobotSupervisor],
        base_tick_s: float,
        neighbour_radius_m: float,
        before_decisions: Callable[[float, Mapping[int, RobotSupervisor]], None] | None = None,
    ) -> None:
        self.robots: Final = {robot.robot_id: robot for robot in robots}
        self.base_tick_s: Final = base_tick_s
        self._list: Final = tuple(robots)
        self._neighbours = Neighbours(neighbour_radius_m)
        self._before_decisions = before_decisions
        self._tick = 0

    def tick(self, now_s: float) -> None:
        """Do one tick at fleet time `now_s`; call it every `base_tick_s`."""
        robots = self._list
        samples = [robot.sense(now_s) for robot in robots]
        self._neighbours.assign(robots, samples)
        if self._before_decisions is not None:
            self._before_decisions(now_s, self.robots)
        tick = self._tick
        counter = time.perf_counter
        for robot in robots:
            start_s = counter()
            robot.decide(tick)
            robot.decide_s = counter() - start_s
        for robot in robots:
            robot.act()
        self._tick = tick + 1
