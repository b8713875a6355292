"""The narrow interface to one robot: five calls, whose rules are enforced here; adapters fill in the hooks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection
from contextlib import suppress
from inspect import isfunction
from typing import ClassVar, Final

from soter.clock import Clock
from soter.errors import LifecycleError, RobotUnavailable, Uncontrolled
from soter.sdk.capabilities import Capabilities
from soter.sdk.goal import Goal, Switch
from soter.sdk.values import Controller, GoalStatus, Link, RobotSpec, RobotState, Waypoint

STALE_AFTER_S: Final = 0.5
DOWN_AFTER_S: Final = 3.0

_KNOWN_OR_NOT: Final = frozenset((float, type(None)))

FUTURE_S: Final = 0.1
"""A sample stamped more than this in the future is dropped: its clock is broken, and it would never grow old."""


class Robot(ABC):
    """One robot. Used from one thread, the supervisor's.

    The public methods are templates: life cycle, authority, finiteness, identity and staleness are enforced here, in
    the same way for all adapters. An adapter fills in the underscored hooks only.

    Args:
        spec: which robot this is.
        clock: the fleet's clock.
    """

    declared: ClassVar[Capabilities]
    """What every robot of this class promises, known before anything is connected.

    A robot that is to promise something else (`RobotSpec.promised`) has its own.
    """

    stale_after_s: float = STALE_AFTER_S
    """A sample older than this makes the link STALE."""

    down_after_s: float = DOWN_AFTER_S
    """A sample older than this makes the link DOWN."""

    def __init__(self, spec: RobotSpec, clock: Clock) -> None:
        # Two underscores: a subclass may call its own attributes whatever it likes.
        self.__spec: Final = spec
        if spec.promised is not None:
            object.__setattr__(self, "declared", spec.promised)
        self.__id: Final = spec.id
        self.__clock: Final = clock
        self.__in_charge = Controller.SC
        self.__in_doubt = False
        self.__capabilities: Capabilities | None = None
        self.__closed = False
        self.__next_goal_id = 1
        self.__goal: Goal | None = None
        self.__sent: Goal | None = None
        self.__state: RobotState | None = None
        self.__switch: Switch | None = None
        self.__discarded = 0
        self.__discarded_for = ""

    def __init_subclass__(cls, *, overrides: Collection[str] = (), **options: object) -> None:
        """Check that a subclass only fills hooks, and overrides nothing that must be the same for all robots.

        Args:
            overrides: public names of this class that it overrides on purpose, as in
                `class Mine(Robot, overrides=("goto",))`.
            options: keywords of other base classes.

        Raises:
            TypeError: it overrides a name by accident.
        """
        super().__init_subclass__(**options)
        above = next(each for each in cls.__mro__[1:] if issubclass(each, Robot))
        for name in sorted(_OWN.keys() - overrides):
            if getattr(cls, name) is not getattr(above, name):
                raise TypeError(f"{cls.__qualname__}.{name} {_collides(name)}")

    # --- the interface -------------------------------------------------------------------------------------

    @property
    def spec(self) -> RobotSpec:
        """The robot's number, its start, and its promises."""
        return self.__spec

    @property
    def id(self) -> int:
        """The robot's number in its fleet."""
        return self.__id

    @property
    def clock(self) -> Clock:
        """The fleet's clock."""
        return self.__clock

    @property
    def in_charge(self) -> Controller:
        """The active controller: the one that was given control last."""
        return self.__in_charge

    @property
    def initialised(self) -> bool:
        """Whether `init()` has succeeded; it stays so after `close()`."""
        return self.__capabilities is not None

    @property
    def discarded(self) -> int:
        """Samples dropped: not finite, not this robot's, older than the one before, or from the future."""
        return self.__discarded

    @property
    def discarded_for(self) -> str:
        """What was wrong with the last sample that was dropped, in words; empty if none was."""
        return self.__discarded_for

    @property
    def capabilities(self) -> Capabilities:
        """What this robot promises: `declared`, or narrower. Known after `init()`."""
        if self.__capabilities is None:
            raise LifecycleError(f"robot {self.__id}: capabilities are known only after init()")
        return self.__capabilities

    def init(self, timeout_s: float) -> None:
        """Connect, arm and get ready. Blocks for at most `timeout_s`; afterwards the SC is active and the robot stands.

        Raises:
            RobotUnavailable: the robot is not there, does not answer, or refuses; the message says which and why.
            LifecycleError: the robot was closed, or is ready already.
            TypeError: an attribute of the object hides one of this class.
        """
        # Not by the object's dict: once it is made, CPython finds every attribute more slowly.
        for name in sorted(_OWN):
            known = getattr(type(self), name)
            if isfunction(known) and getattr(getattr(self, name), "__func__", None) is not known:
                raise TypeError(f"{type(self).__qualname__}: self.{name} {_collides(name)}")
        if self.__closed or self.__capabilities is not None:
            raise LifecycleError(f"robot {self.__id}: init() after {'close()' if self.__closed else 'init()'}")
        found = self._connect(timeout_s)
        wider = found.widened_beyond(self.declared)
        if wider is not None:
            raise RobotUnavailable(
                f"robot {self.__id}: it claims more than is promised for it: {wider} is {getattr(found, wider)}, "
                f"promised {getattr(self.declared, wider)}"
            )
        self.__capabilities = found
        self._hand_over(Controller.SC)

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        """Send a goal and return at once. That it was sent does not mean that it was accepted, or will be reached.

        A goal of a controller that is not active is REJECTED and moves nothing. The goal before it ends as SUPERSEDED.

        Raises:
            ValueError: a coordinate is not finite or absurd; nothing was sent.
            TypeError: the target is no waypoint, or a value in it is no number; nothing was sent.
            LifecycleError: before `init()` or after `close()`.
        """
        self.__require_ready("goto")
        # Targets come from untrusted code: a look-alike or a subclass could pass its own check and fail in the vehicle.
        if type(target) is not Waypoint:
            raise TypeError(f"robot {self.__id}: a target is a Waypoint, not a {type(target).__name__}")
        target.check()
        target = target.in_floats()
        now_s = self.__clock.now()
        goal = Goal(self.__cancel, self.__next_goal_id, target, by, now_s)
        self.__next_goal_id += 1
        if by is not self.__in_charge:
            goal._end(GoalStatus.REJECTED, f"{by} is not in charge, {self.__in_charge} is", now_s)
            return goal
        # Send before anything changes here: if that fails, the vehicle keeps its goal, and can be told to stop.
        self._send_goto(goal)
        if self.__goal is not None:
            self.__goal._end(GoalStatus.SUPERSEDED, f"goal {goal.id} took its place", now_s)
        self.__goal = self.__sent = goal
        return goal

    def read_state(self) -> RobotState:
        """Return the latest sample without waiting, and bring goals and switches up to date with it.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        if self.__capabilities is None or self.__closed:
            self.__require_ready("read_state")
        sample = self._sample()
        state = self.__state
        now_s = self.__clock.now()
        if sample is not None and sample is not state:
            state = self.__admit(sample, now_s)
        if state is None:
            dropped = f"; {self.__discarded} were discarded: {self.__discarded_for}" if self.__discarded else ""
            raise RobotUnavailable(f"robot {self.__id}: no valid sample has arrived yet{dropped}")
        age_s = now_s - state.stamp_s
        if age_s > self.stale_after_s:
            link = Link.DOWN if age_s > self.down_after_s else Link.STALE
            state = state._replace(link=link)
        self.__state = state
        goal = self.__goal
        if goal is not None:
            self.__judge(goal, state, now_s)
        switch = self.__switch
        if switch is not None and state.controller is switch.to and state.stamp_s >= switch.requested_s:
            switch.confirmed_s = now_s
            self.__switch = None
        return state

    def switch_ac_sc(self, to: Controller, reason: str) -> Switch:
        """Make a controller the active one. A change pre-empts the other's goal; no change renews the lease.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        self.__require_ready("switch_ac_sc")
        now_s = self.__clock.now()
        switch = Switch(to, reason, now_s)
        if to is self.__in_charge and not self.__in_doubt:
            self._renew_lease()
            switch.effective_s = now_s
            # Only the robot's own report confirms a change; repeating the call does not.
            if self.__switch is None and self.__state is not None and self.__state.controller is to:
                switch.confirmed_s = now_s
            return switch
        # Send before anything changes here, so that a call that fails can be repeated. The message may have reached the
        # vehicle all the same, so the next change has to be sent to it in any case.
        self.__in_doubt = True
        self._hand_over(to)
        self.__in_doubt = False
        self.__in_charge = to
        if self.__goal is not None:
            self.__goal._end(GoalStatus.PREEMPTED, f"{to} took over: {reason}", now_s)
        self.__goal = self.__sent = None
        # The switch was made all the same; disobedience shows when the lease is renewed next.
        with suppress(Uncontrolled):
            self._renew_lease()
        switch.effective_s = now_s
        self.__switch = switch
        return switch

    def hand_over_again(self) -> None:
        """Resend the last change of control, of which the robot has not heard, as its own report shows.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        self.__require_ready("hand_over_again")
        self._hand_over(self.__in_charge)

    def renew_lease(self) -> None:
        """Renew the lease of the active controller: `switch_ac_sc` to the same one, without a handle."""
        if self.__capabilities is None or self.__closed:
            self.__require_ready("renew_lease")
        self._renew_lease()

    def close(self, timeout_s: float) -> None:
        """Stop the robot and disconnect. Idempotent; may be called at any time."""
        if self.__closed:
            return
        self.__closed = True
        if self.__goal is not None:
            self.__goal._end(GoalStatus.CANCELLED, "the robot was closed", self.__clock.now())
            self.__goal = None
        self._disconnect(timeout_s)

    # --- the hooks that an adapter fills -------------------------------------------------------------------

    @abstractmethod
    def _connect(self, timeout_s: float) -> Capabilities:
        """Get the robot ready within `timeout_s`, at rest and with the SC active; return what it promises."""

    @abstractmethod
    def _send_goto(self, goal: Goal) -> None:
        """Send the goal; never wait."""

    @abstractmethod
    def _sample(self) -> RobotState | None:
        """Return the newest sample in the workspace frame, with link UP; None before the first one."""

    @abstractmethod
    def _hand_over(self, to: Controller) -> None:
        """Shut the other controller's stream, drop its goals, on the vehicle too, and make `to` the active controller.

        If `to` is active already, send that again and leave its goal in force.
        """

    @abstractmethod
    def _renew_lease(self) -> None:
        """Let the vehicle move for another `lease_s`."""

    @abstractmethod
    def _halt(self) -> None:
        """Drop the target that the vehicle works on; it brakes to a stop."""

    @abstractmethod
    def _disconnect(self, timeout_s: float) -> None:
        """Leave the vehicle stopped, and free what was opened. Called once, whether the robot became ready or not."""

    # --- what is enforced once -----------------------------------------------------------------------------

    def __require_ready(self, call: str) -> None:
        if self.__closed:
            raise LifecycleError(f"robot {self.__id}: {call}() after close()")
        if self.__capabilities is None:
            raise LifecycleError(f"robot {self.__id}: {call}() before init()")

    def __admit(self, sample: RobotState, now_s: float) -> RobotState | None:
        previous, stamp_s = self.__state, sample.stamp_s
        total = (
            sample.x_m
            + sample.y_m
            + sample.z_m
            + sample.heading_rad
            + sample.vx_m_s
            + sample.vy_m_s
            + sample.yaw_rate_rad_s
            + stamp_s
        )
        # The sum is no float if any of them is one of NumPy's.
        if (
            type(total) is not float
            or type(sample.vehicle_stamp_s) is not float
            or type(sample.battery) not in _KNOWN_OR_NOT
            or type(sample.vz_m_s) not in _KNOWN_OR_NOT
        ):
            sample = sample.in_floats()
        battery = sample.battery
        if (
            not math.isfinite(total)
            or sample.robot_id != self.__id
            or (battery is not None and not 0.0 <= battery <= 1.0)
            or (previous is not None and stamp_s < previous.stamp_s)
            or stamp_s > now_s + FUTURE_S
        ):
            self.__discarded += 1
            self.__discarded_for = self.__fault_of(sample, now_s)
            return previous
        return sample

    def __fault_of(self, sample: RobotState, now_s: float) -> str:
        """Return why a sample is not admitted."""
        for name, value in zip(sample._fields, sample, strict=True):
            if isinstance(value, float) and not math.isfinite(value):
                return f"{name} is {value}, not finite"
        if sample.robot_id != self.__id:
            return f"it is another robot's, of {sample.robot_id}"
        if sample.battery is not None and not 0.0 <= sample.battery <= 1.0:
            return f"battery is {sample.battery:g}, allowed: 0 to 1"
        if sample.stamp_s > now_s + FUTURE_S:
            return f"it is stamped {sample.stamp_s - now_s:.3f} s in the future"
        older = self.__state is not None and sample.stamp_s < self.__state.stamp_s
        return "it is older than the one before" if older else "its numbers are too large to add up"

    def __judge(self, goal: Goal, state: RobotState, now_s: float) -> None:
        target = goal.target
        dx, dy, dz = state.x_m - target.x_m, state.y_m - target.y_m, state.z_m - target.z_m
        if dx * dx + dy * dy + dz * dz <= goal.radius_sq_m2 and state.stamp_s >= goal.sent_s:
            goal._end(GoalStatus.REACHED, "", now_s)
            self.__goal = None
        elif now_s >= goal.deadline_s:
            # Stop first: a goal whose robot could not be told to stop has not ended.
            self._halt()
            goal._end(GoalStatus.TIMED_OUT, f"not there after {target.timeout_s:g} s", now_s)
            self.__goal = None

    def __cancel(self, goal: Goal) -> None:
        if goal is self.__sent:
            # A reached goal is stopped too: the vehicle may still drive to the middle, or not have heard of it yet.
            self._halt()
            goal._end(GoalStatus.CANCELLED, "cancelled by its owner", self.__clock.now())
            self.__goal = self.__sent = None


_OWN: Final = {
    "spec": "", "id": "", "clock": "", "in_charge": "", "initialised": "", "discarded": "", "discarded_for": "",
    "hand_over_again": "",
    "capabilities": "return them from _connect()", "init": "fill _connect()", "goto": "fill _send_goto()",
    "read_state": "fill _sample()", "switch_ac_sc": "fill _hand_over()", "renew_lease": "fill _renew_lease()",
    "close": "fill _disconnect()",
}  # fmt: skip
"""By public name that adapters must not override: what to do instead."""


def _collides(name: str) -> str:
    instead = _OWN[name]
    return (
        f"hides soter.sdk.Robot.{name}, which is the same for all robots: {f'{instead} instead, or ' * bool(instead)}"
        f"choose another name; where it is meant, say so: class ...(Robot, overrides=({name!r},))"
    )
