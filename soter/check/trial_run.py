"""One trial of a safety module, on simulated robots.

An adversarial AC drives as long as the module under test allows, and from the first switch on the robot is left to the
safe controllers, until the module gives it back or patience runs out. It is judged by true poses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from soter.check.node_failures import told
from soter.check.trial import Attempt, BrokenObligation, Obligation, TrialRow, Way
from soter.check.user_rules import UserRules
from soter.rta import Assumption, DecisionModule, Region, RTAModule, Situation
from soter.rta.assumptions import Breach
from soter.rta.module import margin_of
from soter.sdk import Controller, Fleet, RobotState, Waypoint
from soter.stack.assembly import SafetySide
from soter.stack.certified_controller import CertifiedController
from soter.stack.right_of_way import BATTERY

if TYPE_CHECKING:
    from soter.check.bench import ModuleBench

ATTACK_S: Final = 24.0
"""An AC that was not disengaged within this time has failed."""

FAR_M: Final = 3.0
_MOTION: Final = {Assumption.MOTION, Assumption.BRAKING, Assumption.LATENCY, Assumption.POSITION_NOISE}
"""Assumptions on which the models of modules rest."""

_TOLERANCE: Final = 1e-6
_ASIDE_M: Final = 0.01


class TrialRun:
    """One trial on robots that stand where they begin; `commands` are the courses of each AC, and until when."""

    def __init__(
        self,
        bench: ModuleBench,
        safety: SafetySide,
        fleet: Fleet,
        commands: Mapping[int, list[tuple[float, float]]],
        failures: Sequence[str],
    ) -> None:
        assert fleet.truth is not None
        self._bench, self._safety, self._fleet, self._commands = bench, safety, fleet, commands
        self._failures: Final = failures
        self._robots: Final = tuple(safety.supervisor.robots.values())
        name = bench.module.name
        self._modules: Final[dict[int, DecisionModule]] = {
            robot.robot_id: next(module for module in robot.modules if module.name == name) for robot in self._robots
        }
        declared = {robot_id: (module_of(safety, robot_id, name),) for robot_id in safety.modules}
        self._truth: Final = fleet.truth
        self._rules: Final = UserRules(fleet.truth, declared)
        self._rows: list[TrialRow] = []
        self._breaches: list[BrokenObligation] = []
        self._in_sc_since_s: dict[int, float] = dict.fromkeys(self._modules, 0.0)
        self._switched: set[int] = set()
        self._returned: set[int] = set()
        self._returns_s: list[float] = []
        self._driven = False
        self._failure = ""
        self._ways: set[Way] = set()
        self._way: dict[int, Way] = {}

    def trial(self) -> Attempt:
        if not self._begins_inside():
            return Attempt(valid=False)
        tick_s, clock = self._bench.base_tick_s, self._fleet.clock
        last = round((ATTACK_S + 2.0 * self._bench.patience_s) / tick_s)
        for tick in range(last):
            now_s = tick * tick_s
            self._safety.supervisor.tick(now_s)
            self._follow(now_s)
            self._look_at_controllers(now_s)
            self._attack(now_s)
            clock.sleep_until((tick + 1) * tick_s)
            self._rules.look((tick + 1) * tick_s, self._robots)
            self._judge((tick + 1) * tick_s)
            if self._breaches or self._over(now_s):
                break
        spare = self._spare()
        return Attempt(
            True,
            self._rules.min_margin.get(self._bench.module.name, math.inf),
            max(self._returns_s, default=math.nan),
            spare,
            sum(module.monitor.surprises for module in self._modules.values())
            + sum(breach.times for _, breach in self._unfit()),
            tuple(self._breaches),
            self._rows,
            min(((each.first_s, f"{name}: {each.cause}") for name, each in self._unfit()), default=(0.0, ""))[1],
            self._driven,
            self._failure,
            frozenset(self._ways),
        )

    def _unfit(self) -> list[tuple[Assumption, Breach]]:
        """Return the failed assumptions about how robots move."""
        return [
            (assumption, breach)
            for robot in self._robots
            for assumption, breach in robot.log.breaches.items()
            if assumption in _MOTION
        ]

    def _begins_inside(self) -> bool:
        """Return whether every robot stands in phi_safe by truth, and the other modules' rules hold as well."""
        samples = []
        for robot in self._robots:
            told, (x_m, y_m, heading_rad) = robot.actuator.read(), self._truth.pose(robot.robot_id)
            assert isinstance(told, RobotState)
            samples.append(told._replace(x_m=x_m, y_m=y_m, heading_rad=heading_rad))
        for robot, own in zip(self._robots, samples, strict=True):
            situation = Situation(robot.robot_id, own, 0.0)
            situation.peers = [sample for sample in samples if sample is not own]
            for module in self._safety.modules[robot.robot_id]:
                # The battery's module holds back a reserve, which pays for what the other modules do with the robot.
                least = module.keep if module.name == BATTERY != self._bench.module.name else 0.0
                if module.phi_safe is not None and not margin_of(module.phi_safe, situation) >= least:
                    return False
        return True

    def _follow(self, now_s: float) -> None:
        """Record which modules under test took their robot, and which gave it back."""
        for robot_id, module in self._modules.items():
            since_s = self._in_sc_since_s.get(robot_id)
            if module.mode is Controller.SC and since_s is None:
                self._in_sc_since_s[robot_id] = now_s
                self._switched.add(robot_id)
            elif module.mode is Controller.AC and since_s is not None:
                del self._in_sc_since_s[robot_id]
                self._returns_s.append(now_s - since_s)
                if robot_id in self._way:
                    self._ways.add(self._way.pop(robot_id))
                if robot_id in self._switched:
                    self._returned.add(robot_id)

    def _look_at_controllers(self, now_s: float) -> None:
        """Record what the module's safe controllers do; one that fails ends the trial.

        One that fails has its robot stand, and after its contract be driven home. The trial would pass.
        """
        for robot in self._robots:
            robot_id, module = robot.robot_id, self._modules[robot.robot_id]
            if robot.driver is not module:
                continue
            self._driven = True
            controller = module.module.sc
            if not isinstance(controller, CertifiedController):
                continue  # a shipped one, which drives the return path by itself
            if controller.driven_home:
                if self._way.get(robot_id, Way.ITSELF) is Way.ITSELF:
                    wants_charge = self._safety.robots[robot_id].declared.dock.wants_charge
                    self._way[robot_id] = Way.CHARGE if wants_charge else Way.HOME
            elif controller.driven_there:
                self._way.setdefault(robot_id, Way.ITSELF)
            if controller.failure is not None and not self._failure:
                x_m, y_m, _ = self._truth.pose(robot_id)
                self._failure = told(controller.failure, controller.inner)
                text = (
                    f"its safe controller '{controller.name}' failed after {now_s:.2f} s, with robot {robot_id} at "
                    f"({x_m:.2f}, {y_m:.2f}): {self._failure}"
                )
                self._breaches.append(BrokenObligation(Obligation.P2B, now_s, robot_id, x_m, y_m, text))

    def _attack(self, now_s: float) -> None:
        """Drive every robot whose AC still has control along its present course."""
        for robot_id, port in self._safety.ports.items():
            if not port.engaged or robot_id in self._switched or port.state is None:
                continue
            aside = next((aside for ends_s, aside in self._commands[robot_id] if now_s < ends_s), None)
            if aside is None:
                aside = self._commands[robot_id][-1][1]
            bearing = self._downhill(robot_id) + aside
            port.goto(
                Waypoint(
                    port.state.x_m + FAR_M * math.cos(bearing), port.state.y_m + FAR_M * math.sin(bearing),
                    radius_m=1e-3,
                )
            )  # fmt: skip

    def _downhill(self, robot_id: int) -> float:
        """Return the bearing along which the margin falls fastest from where the robot is; 0 if it is level."""
        region, situation = self._modules[robot_id].module.phi_safe, self._safety.supervisor.robots[robot_id].situation
        if region is None:
            return 0.0
        here = situation.own
        assert isinstance(here, RobotState)
        slopes = []
        for aside in (here._replace(x_m=here.x_m + _ASIDE_M), here._replace(y_m=here.y_m + _ASIDE_M)):
            there = Situation(robot_id, aside, situation.now_s)
            there.peers = situation.peers
            slopes.append(margin_of(region, there) - margin_of(region, situation))
        level = not all(map(math.isfinite, slopes)) or slopes == [0.0, 0.0]
        return 0.0 if level else math.atan2(-slopes[1], -slopes[0])

    def _judge(self, now_s: float) -> None:
        name = self._bench.module.name
        for robot in self._robots:
            robot_id, own = robot.robot_id, robot.situation.own
            x_m, y_m, heading_rad = self._truth.pose(robot_id)
            margin = self._rules.margin.get((robot_id, name), math.nan)
            driver = Controller.AC.value if robot.driver is None else robot.driver.name
            self._rows.append(TrialRow(now_s, robot_id, x_m, y_m, heading_rad, own.battery, margin, driver))
            # Written so that NaN counts as outside, as in a run; before the first look there is no margin.
            if (robot_id, name) in self._rules.margin and not margin >= -_TOLERANCE:
                self._breaches.append(self._left(now_s, robot_id, margin, x_m, y_m))
            since_s = self._in_sc_since_s.get(robot_id)
            if since_s is not None and now_s - since_s > self._bench.patience_s:
                self._returns_s.append(math.inf)
                text = f"after {self._bench.patience_s:g} s of its safe controller robot {robot_id} is not given back"
                if self._failures:
                    text += f"; {self._failures[-1]}"
                self._breaches.append(BrokenObligation(Obligation.P2B, now_s, robot_id, x_m, y_m, text))

    def _left(self, now_s: float, robot_id: int, margin: float, x_m: float, y_m: float) -> BrokenObligation:
        """Return the obligation that a robot outside phi_safe broke: P2a under its safe controller, else P3."""
        region = self._bench.module.phi_safe
        capabilities = next(robot.capabilities for robot in self._fleet.robots if robot.id == robot_id)
        unit = "" if region is None else f" {region.unit}"
        since_s = self._in_sc_since_s.get(robot_id)
        braking_s = capabilities.latency_s + capabilities.v_max_m_s / capabilities.brake_m_s2 + self._bench.base_tick_s
        left = "has a margin that is no number" if math.isnan(margin) else f"left phi_safe by {-margin:.3f}{unit}"
        where = f"robot {robot_id} at ({x_m:.2f}, {y_m:.2f}) {left} after {now_s:.2f} s"
        if since_s is None:
            # How far it was just before says whether the AC was trusted too long, or the margin leapt.
            margins = [row.margin for row in self._rows if row.robot_id == robot_id]
            before = f", with a margin of {margins[-2]:.3f}{unit} a tick before" if len(margins) > 1 else ""
            text = f"{where}, while the AC was trusted{before}"
            return BrokenObligation(Obligation.P3, now_s, robot_id, x_m, y_m, text)
        if robot_id in self._switched and now_s - since_s <= braking_s:
            late = f"{where}, {now_s - since_s:.2f} s after the switch: too late to stop"
            return BrokenObligation(Obligation.P3, now_s, robot_id, x_m, y_m, late)
        failed = f"; {self._failures[-1]}" if self._failures else ""
        text = f"{where}, {now_s - since_s:.2f} s into its safe controller{failed}"
        return BrokenObligation(Obligation.P2A, now_s, robot_id, x_m, y_m, text)

    def _over(self, now_s: float) -> bool:
        """Return whether the trial is over: all robots that were taken over have come back, or none was taken over."""
        all_back = bool(self._switched) and self._switched == self._returned
        return all_back or (not self._in_sc_since_s and now_s > ATTACK_S)

    def _spare(self) -> float:
        longest_s = max(self._returns_s, default=math.nan)
        if math.isnan(longest_s):
            return math.inf
        if math.isfinite(longest_s):
            return self._bench.patience_s - longest_s
        waiting = [robot for robot in self._robots if robot.robot_id in self._in_sc_since_s]
        regions = [(self._modules[robot.robot_id].module.phi_safer, robot.situation) for robot in waiting]
        short = [margin_of(safer, situation) for safer, situation in regions if isinstance(safer, Region)]
        if len(short) < len(regions):
            return -1.0
        return min(-1e-3, min(short, default=-1.0))


def module_of(safety: SafetySide, robot_id: int, name: str) -> RTAModule:
    """Return the declaration of a module for one robot."""
    return next(module for module in safety.modules[robot_id] if module.name == name)
