"""One robot's supervisor: every tick it reads the robot, runs due decision modules, and lets the active one drive."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from soter.controller import AC, SC
from soter.errors import Intruder, Uncontrolled, account_of, raised_at
from soter.rta.actuator import Actuator
from soter.rta.assumptions import Assumption, AssumptionLog
from soter.rta.decision import DecisionModule, Drivers
from soter.rta.monitors import ROUNDING_S, Assumed, BrokenAssumption, SampleMonitor, StopMonitor
from soter.rta.situation import Sample, Situation
from soter.rta.topics import Node
from soter.rta.watch import SUPERVISOR, SwitchRecord, Watch

logger = logging.getLogger(__name__)

UNHEARD_S: Final = 3.0
"""A robot that has been silent for longer is uncontrolled: commands may not reach it."""

ALARM_S: Final = 0.3
"""A robot whose assumptions failed stays with its safe controllers until they have held for this long."""


class RobotSupervisor:
    """Runs the decision modules and safe controllers of one robot, and hands it over between controllers.

    Attributes:
        mode: the active controller.
        driver: the module that drives, or None for the AC.
        situation: what is known of the robot and its peers at this tick.
        decide_s: host time that the last decisions took, in seconds.
        ac_failure: why the AC will never get control again; empty while it may.
        uncontrolled: why the robot does not obey its supervisor; empty while it does.
        log: the assumptions that failed.

    Args:
        robot_id: which robot.
        actuator: its narrow interface.
        drivers: the controllers that may drive it.
        assumed: what its samples are tested against.
        watches: called with every switch.
    """

    # With more than 30 attributes in a dict, CPython finds each of them more slowly.
    __slots__ = (
        "_ac", "_accounts", "_alarm", "_alarmed_until_s", "_announced_ac", "_disobeyed_until_s", "_disowned",
        "_handed_over_s", "_heard_within_s", "_held", "_lateness_s", "_looked_s", "_owed", "_peer_unsure", "_refused",
        "_reports", "_samples", "_sent", "_stop", "_stop_owed", "_timing", "_was_held", "_watches", "_waypoint",
        "_without_ac", "ac_failure", "actuator", "decide_s", "driver", "log", "mode", "modules", "robot_id",
        "situation", "uncontrolled",
    )  # fmt: skip

    def __init__(
        self, robot_id: int, actuator: Actuator, drivers: Drivers, assumed: Assumed, watches: Sequence[Watch] = ()
    ) -> None:
        self.robot_id: Final = robot_id
        modules = tuple(drivers.modules)
        self.modules: Final = modules
        for rank, module in enumerate(modules):
            module.rank = rank
        self.actuator: Final = actuator
        self.mode = SC if modules else AC
        first = modules[0] if modules else None
        self.driver: DecisionModule | None = first
        self._without_ac: Final = next((each for each in modules if each.name == drivers.without_ac), first)
        self.situation = Situation(robot_id, actuator.read(), 0.0)
        self.decide_s = 0.0
        self._ac: Final = drivers.ac
        self._waypoint: Final = drivers.waypoint
        self._sent = drivers.waypoint.count
        self._timing: Final = assumed.timing
        self._lateness_s: Final = assumed.timing.jitter_s + 1e-6
        self._samples: Final = SampleMonitor(assumed.models, assumed.timing)
        self.log: Final = AssumptionLog()
        self._stop = StopMonitor(assumed.models, assumed.timing)
        self._watches: Final = tuple(watches)
        self.ac_failure = ""
        self._alarm = ""
        self._alarmed_until_s = -math.inf
        self._refused = self._stop_owed = False
        self._accounts: dict[str, str] = {}
        self._owed: tuple[str, str] | None = None
        self._looked_s = [math.nan] * len(self.modules)
        self._announced_ac = False
        # Modules begin in SC, and so does a robot that is ready.
        self._handed_over_s = -math.inf if modules else math.inf
        self._disowned = self._reports = False
        self._heard_within_s: Final = assumed.heard_within_s
        self._held = self._was_held = self._peer_unsure = False
        self.uncontrolled = ""
        self._disobeyed_until_s = -math.inf

    def fail_ac(self, cause: str) -> None:
        """Never give this robot to its AC again, which has failed for good; the cause says how.

        Its modules go on judging; while none of them needs to drive, `Drivers.without_ac` does (the battery's module,
        which drives home).
        """
        self.ac_failure = self.ac_failure or cause

    def expect_no_obedience(self) -> None:
        """Stop testing whether the robot stops when told to: a recorded robot cannot obey."""
        self._stop = StopMonitor((), self._timing)

    # --- one tick, in three passes over all robots -----------------------------------------------------------

    def sense(self, now_s: float) -> Sample:
        """Read the sample and test it against what the models allow."""
        situation = self.situation
        before = situation.own
        self._held = self._peer_unsure = False
        if now_s < situation.now_s:
            self._clock_went_back(situation.now_s - now_s)
        situation.now_s = now_s
        if self.uncontrolled and now_s >= self._disobeyed_until_s:
            self.uncontrolled = ""
        try:
            sample = self.actuator.read()
            if not math.isfinite(sample.x_m + sample.y_m + sample.stamp_s):
                # Comparisons with NaN are false: a minimum over distances would ignore this robot, its peers' one too.
                raise ValueError(f"the sample is not finite: {sample}")
        except KeyboardInterrupt:
            raise
        except BaseException as failure:  # noqa: BLE001 - whatever fails here, the robot goes to its SC
            self._take_age(before)
            self._raise_alarm(Assumption.SAMPLE_AGE, f"no state: {account_of(failure, str)}")
            return before
        situation.own = sample
        self._take_age(sample)
        try:
            if (found := self._samples.look(now_s, before, sample)) is not None:
                self._raise_alarm(*found)
            if (found := self._stop.look(now_s, sample)) is not None:
                self._raise_alarm(*found)
            self._look_for_owner(sample)
        except KeyboardInterrupt:
            raise
        except BaseException as failure:
            # Models may be the user's own, and the reported controller comes from an adapter.
            logger.exception("robot %d: its sample could not be tested", self.robot_id)
            self._raise_alarm(Assumption.MOTION, f"its sample could not be tested: {account_of(failure)}")
        return sample

    def _clock_went_back(self, by_s: float) -> None:
        self.situation.now_s -= by_s
        for module in self.modules:
            if module.mode is SC:
                # A dwell that began at a time now in the future has not lasted at all.
                module.force(self.situation.now_s, module.cause)
        self._raise_alarm(Assumption.CLOCK, f"fleet time went back by {by_s:.3f} s", by_s, "s")

    def _look_for_owner(self, sample: Sample) -> None:
        """Compare the active controller with the one that the robot reports; if they differ, withhold the lease.

        Otherwise the command of the controller that lost control would still move the robot. A robot that has reported
        a controller and no longer does follows a pilot, another program or nobody, until it is ready again.
        """
        reported = self.actuator.reported(sample)
        if reported is self.mode:
            self._disowned, self._reports = False, True
            return
        settled = self._owed is None and sample.stamp_s > self._handed_over_s + self._timing.latency_s + ROUNDING_S
        self._disowned = settled and reported is not None
        self._reports = self._reports or reported is not None
        if self._disowned:
            self._raise_alarm(Assumption.AUTHORITY, f"the robot reports {reported} in charge, not {self.mode}")
            self._attempt(self.actuator.insist)
        elif settled and self._reports and reported is None:
            self._disobeyed(f"the robot does not report any more that {self.mode} is in charge")

    def _take_age(self, sample: Sample) -> None:
        situation = self.situation
        age_s = situation.now_s - sample.stamp_s
        if age_s < 0.0:
            # A clock that is slightly fast must not make a reach bound smaller than that of a fresh sample.
            age_s = 0.0
        situation.age_s = age_s
        if age_s > UNHEARD_S:
            self._lose_control(f"it has not been heard of for {age_s:.1f} s")

    def _lose_control(self, cause: str) -> None:
        self.uncontrolled, self._disobeyed_until_s = cause, self.situation.now_s + ALARM_S

    def _disobeyed(self, cause: str) -> None:
        self._lose_control(cause)
        self._raise_alarm(Assumption.AUTHORITY, cause)

    def distrust(self, finding: BrokenAssumption) -> None:
        """Take control from the AC for a while, because a peer broke an assumption."""
        self._peer_unsure = True
        self._raise_alarm(*finding)

    def hold(self, finding: BrokenAssumption) -> None:
        """Have the robot stand at this tick, whichever controller drives: its own or a peer's position is not known."""
        self._held = True
        self.distrust(finding)

    def _raise_alarm(self, assumption: Assumption, cause: str, excess: float = math.nan, unit: str = "") -> None:
        """Log that an assumption has failed; the AC loses control for a while, whatever the margins are."""
        self.log.note(assumption, self.situation.now_s, cause, excess, unit)
        self._alarm = f"{assumption}: {cause}"
        self._alarmed_until_s = self.situation.now_s + ALARM_S

    def decide(self, tick: int) -> None:
        """Run every due decision module, choose the driver, and hand over if it changed."""
        situation = self.situation
        fired: list[DecisionModule] = []
        released: DecisionModule | None = None
        driver: DecisionModule | None = None
        now_s = situation.now_s
        # What was judged before an assumption failed no longer counts: in an alarm every module looks at every tick,
        # and the AC gets control back only on later looks.
        alarmed = now_s < self._alarmed_until_s
        for rank, module in enumerate(self.modules):
            try:
                if alarmed or tick % module.every_ticks == 0:
                    since_s = now_s - self._looked_s[rank]
                    self._looked_s[rank] = now_s
                    late_s = since_s - module.delta_s
                    if late_s > self._lateness_s:
                        self._raise_alarm(
                            Assumption.JITTER if late_s <= self._lateness_s + self._timing.lease_s
                            else Assumption.SCHEDULING,
                            f"'{module.name}' looked after {since_s:.3f} s, not {module.delta_s:g} s",
                            late_s - self._timing.jitter_s, "s",
                        )  # fmt: skip
                    if module.decide(situation):
                        if module.mode is SC:
                            fired.append(module)
                        else:
                            released = module
                elif module.mode is SC:
                    module.observe(situation)
            except KeyboardInterrupt:
                raise
            except BaseException as failure:
                cause = f"decision module failed: {account_of(failure)}"
                if module.cause != cause:
                    # Log it once, not at every look: it may go on failing for as long as the run lasts.
                    logger.exception("robot %d: decision module '%s' failed", self.robot_id, module.name)
                if module.mode is AC:
                    fired.append(module)
                module.force(now_s, cause)
            if module.monitor.found is not None:
                self._look_at(module, module.monitor.found)
            if driver is None and module.mode is SC:
                driver = module
        if driver is None and (now_s < self._alarmed_until_s or self.ac_failure):
            driver = self._without_module()
        if driver is not self.driver or (driver is None and self.mode is SC):
            self._change_driver(driver, fired, released)
        elif driver is None and not self._announced_ac:
            self._announced_ac = True
            self._hand_over("", "no safety module is enabled")
        elif self._owed is not None:
            self._hand_over(*self._owed)
        # A failure in `act`, from here on, is a cause at the next tick.
        self._alarm = ""

    def _look_at(self, module: DecisionModule, found: BrokenAssumption) -> None:
        """Log what a module's monitor has found; raise an alarm if the module is in AC."""
        module.monitor.found = None
        if found.assumption is Assumption.WORKSPACE and self.situation.now_s < self._alarmed_until_s:
            # A wrong sample says nothing about the workspace.
            return
        if found.assumption is Assumption.RECOVERY and self._peer_unsure:
            # The margin to where a silent peer may be falls although nobody moves.
            return
        cause = f"'{module.name}': {found.cause}"
        if module.mode is AC:
            self._raise_alarm(found.assumption, cause, found.excess, found.unit)
        else:
            # The module has the robot already, and keeps it until phi_safer.
            self.log.note(found.assumption, self.situation.now_s, cause, found.excess, found.unit)

    def act(self) -> None:
        """Let the active controller take its step, send what it published, renew the lease."""
        situation = self.situation
        driver = self.driver
        node = self._ac if driver is None else driver.module.sc
        waypoint = self._waypoint
        if self._held:
            self._drive(None)
        else:
            try:
                if self._was_held:
                    # Its goal was dropped while the robot was held.
                    node.engage(situation)
                node.step(situation)
            except KeyboardInterrupt:
                raise
            except BaseException as failure:  # noqa: BLE001 - a controller that fails must not take others along
                self._isolate(node, failure)
                self._sent = waypoint.count
            if waypoint.count != self._sent:
                self._sent = waypoint.count
                self._drive(waypoint.value)
            elif self._stop_owed:
                self._drive(None)
        self._was_held = self._held
        withheld = self._refused or self._disowned or situation.age_s > self._heard_within_s + ROUNDING_S
        if not withheld:
            self._attempt(self.actuator.renew)
            withheld = self._refused
        self._stop.lease(situation.now_s, situation.own, withheld)
        self._refused = False

    def _hand_over(self, module: str, cause: str) -> None:
        """Hand the robot over to the controller of the present mode; if that fails, try again at every tick.

        Until it succeeds the lease is not renewed: a robot that has not heard of its disengagement must not go on.
        """
        self._owed = (module, cause)
        if self._attempt(lambda: self.actuator.hand_over(self.mode, module, cause)):
            self._owed = None
            self._stop_owed = False
            self._handed_over_s = self.situation.now_s
            self._stop.told(self.situation.now_s, self.situation.own, stop=True)

    def _drive(self, command: Any) -> None:
        """Pass on a command; None means stop, which is repeated every tick until it could be sent."""
        told = self._attempt(lambda: self.actuator.drive(command, self.mode))
        self._stop_owed = not told and (command is None or self._stop_owed)
        self._stop.told(self.situation.now_s, self.situation.own, stop=command is None)

    def _attempt(self, call: Callable[[], None]) -> bool:
        """Call the actuator; return whether it worked. A failure withholds the lease and takes control from the AC."""
        try:
            call()
            return True
        except KeyboardInterrupt:
            raise
        except BaseException as failure:
            self._refused = True
            words = account_of(failure)
            if words.startswith(Uncontrolled.MARK):
                self._disobeyed(words)
            elif words.startswith(Intruder.MARK):
                self._raise_alarm(Assumption.AUTHORITY, words)
            else:
                logger.exception("robot %d: its interface failed", self.robot_id)
                self._raise_alarm(Assumption.LATENCY, f"interface failed: {words}")
            return False

    def _without_module(self) -> DecisionModule | None:
        """Return the module whose safe controller drives when no module needs to, but the AC may not."""
        if not self.modules:
            self._drive(None)
            return None
        return self._without_ac if self.ac_failure else self.modules[0]

    def _change_driver(
        self, driver: DecisionModule | None, fired: Sequence[DecisionModule], released: DecisionModule | None
    ) -> None:
        before = self.driver
        was = self.mode
        self.driver = driver
        self.mode = AC if driver is None else SC
        first = fired[0] if fired else released or driver or before
        name = first.name if first is not None else ""
        cause = first.cause if first is not None else ""
        if was is AC and not fired:
            name, cause = SUPERVISOR, self._alarm or self.ac_failure
            if driver is not None and driver.mode is SC:
                # Nothing has failed and the margin would do: other robots need room.
                name, cause = driver.name, driver.cause
        if self.mode is not was or before is not driver:
            # A change of driver drops the goal too: the next SC must not inherit a motion that it never certified.
            if self.mode is was:
                self._drive(None)
            else:
                self._announced_ac = True
                self._hand_over(name, cause)
        record = SwitchRecord(
            self.situation.now_s,
            self.robot_id,
            before.name if before is not None and was is SC else None,
            driver.name if driver is not None else None,
            name,
            cause,
            tuple(module.name for module in fired[1:]),
        )
        for watch in self._watches:
            try:
                watch.on_switch(record, self)
            except KeyboardInterrupt:
                raise
            except BaseException:
                # Watches read what the AC intends, which is untrusted; statistics must not harm the robots.
                logger.exception("robot %d: a watch failed", self.robot_id)
        self._sent = self._waypoint.count
        if driver is not None:
            try:
                driver.module.sc.engage(self.situation)
            except KeyboardInterrupt:
                raise
            except BaseException as failure:  # noqa: BLE001 - a controller that fails must not take others along
                self._isolate(driver.module.sc, failure)

    def _isolate(self, node: Node, failure: BaseException) -> None:
        # One that fails in the same way at every tick would fill the disk.
        if self._accounts.get(node.name) != (account := account_of(failure)):
            self._accounts[node.name] = account
            logger.error("robot %d: node '%s' failed", self.robot_id, node.name, exc_info=failure)
        self._drive(None)
        if self.mode is AC:
            self.fail_ac(f"AC failed: {account}")
        else:
            cause = f"safe controller '{node.name}' failed: {account}{raised_at(failure)}"
            self.log.note(Assumption.CONTRACT, self.situation.now_s, cause)
