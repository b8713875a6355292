"""The narrow interface to one robot: five calls, enforced once here, filled in by adapters through five hooks."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar, Final

from soter.clock import Clock
from soter.errors import LifecycleError, RobotUnavailable
from soter.sdk.goal import Goal, Switch
from soter.sdk.values import Capabilities, Controller, GoalStatus, Link, RobotSpec, RobotState, Waypoint

STALE_AFTER_S: Final = 0.5
DOWN_AFTER_S: Final = 3.0

FUTURE_S: Final = 0.1
"""A sample stamped later than now by more than this is a broken clock's: believed, it would never grow old."""


class Robot(ABC):
    """One robot. Used from one thread, the supervisor's.

    The public methods are templates: life cycle, authority, finiteness, identity and staleness are enforced
    here, so that every adapter means the same by them. An adapter fills the underscored hooks only.

    Args:
        spec: which robot this is.
        clock: the fleet's clock.
    """

    declared: ClassVar[Capabilities]
    """What every robot of this class promises, readable before anything is connected."""

    stale_after_s: float = STALE_AFTER_S
    """A sample older than this makes the link STALE."""

    down_after_s: float = DOWN_AFTER_S
    """A sample older than this makes the link DOWN."""

    def __init__(self, spec: RobotSpec, clock: Clock) -> None:
        self.spec: Final = spec
        self.id: Final = spec.id
        self.clock: Final = clock
        self._in_charge = Controller.SC
        self._in_doubt = False
        self._capabilities: Capabilities | None = None
        self._closed = False
        self._next_goal_id = 1
        self._goal: Goal | None = None
        self._state: RobotState | None = None
        self._switch: Switch | None = None
        self.discarded = 0
        """Samples dropped: not finite, not this robot's, older than the one before, or from the future."""

    # --- the interface -------------------------------------------------------------------------------------

    @property
    def capabilities(self) -> Capabilities:
        """What this very robot promises: `declared`, or narrower. Known after `init()`."""
        if self._capabilities is None:
            raise LifecycleError(f"robot {self.id}: capabilities are known only after init()")
        return self._capabilities

    def init(self, timeout_s: float) -> None:
        """Connect, arm and get ready. Blocks for at most `timeout_s`; afterwards the SC is in charge and all is still.

        Raises:
            RobotUnavailable: the robot is not there, does not answer, or refuses; the message says which and why.
            LifecycleError: it was closed, or is ready already.
        """
        if self._closed or self._capabilities is not None:
            raise LifecycleError(f"robot {self.id}: init() after {'close()' if self._closed else 'init()'}")
        found = self._connect(timeout_s)
        wider = found.widened_beyond(self.declared)
        if wider is not None:
            raise RobotUnavailable(
                f"robot {self.id}: it claims more than its adapter declares: {wider} is {getattr(found, wider)}, "
                f"declared {getattr(self.declared, wider)}"
            )
        self._capabilities = found
        self._hand_over(Controller.SC)

    def goto(self, target: Waypoint, by: Controller) -> Goal:
        """Ask for a place; sends and returns at once. Being sent is not being accepted, nor being reached.

        A goal of a controller that is not in charge is REJECTED and moves nothing. The goal before it ends as
        SUPERSEDED.

        Raises:
            ValueError: a coordinate is not finite or absurd; nothing was sent.
            TypeError: it is no waypoint, or a value in it is no number; nothing was sent.
            LifecycleError: before `init()` or after `close()`.
        """
        self._require_ready("goto")
        # Targets come from untrusted code: a look-alike or a subclass could pass its own check and fail in the vehicle.
        if type(target) is not Waypoint:
            raise TypeError(f"robot {self.id}: a target is a Waypoint, not a {type(target).__name__}")
        target.check()
        now_s = self.clock.now()
        goal = Goal(self, self._next_goal_id, target, by, now_s)
        self._next_goal_id += 1
        if by is not self._in_charge:
            goal._end(GoalStatus.REJECTED, f"{by} is not in charge, {self._in_charge} is", now_s)
            return goal
        # Before anything changes here: where it fails, the vehicle works on what it had, and can be told to stop.
        self._send_goto(goal)
        if self._goal is not None:
            self._goal._end(GoalStatus.SUPERSEDED, f"goal {goal.id} took its place", now_s)
        self._goal = goal
        return goal

    def read_state(self) -> RobotState:
        """Return the latest sample without waiting, and bring goals and switches up to date with it.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        if self._capabilities is None or self._closed:
            self._require_ready("read_state")
        sample = self._sample()
        state = self._state
        if sample is not None and sample is not state:
            state = self._admit(sample)
        if state is None:
            raise RobotUnavailable(f"robot {self.id}: no valid sample has arrived yet")
        now_s = self.clock.now()
        age_s = now_s - state.stamp_s
        if age_s > self.stale_after_s:
            link = Link.DOWN if age_s > self.down_after_s else Link.STALE
            state = state._replace(link=link)
        self._state = state
        goal = self._goal
        if goal is not None:
            self._judge(goal, state, now_s)
        switch = self._switch
        if switch is not None and state.controller is switch.to and state.stamp_s >= switch.requested_s:
            switch.confirmed_s = now_s
            self._switch = None
        return state

    def switch_ac_sc(self, to: Controller, reason: str) -> Switch:
        """Say who is in charge. A change pre-empts whatever the other had in flight; the same renews the lease.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        self._require_ready("switch_ac_sc")
        now_s = self.clock.now()
        switch = Switch(to, reason, now_s)
        if to is self._in_charge and not self._in_doubt:
            self._renew_lease()
            switch.effective_s = now_s
            # Only the robot's own report confirms; a change that is not confirmed yet is not by being repeated.
            if self._switch is None and self._state is not None and self._state.controller is to:
                switch.confirmed_s = now_s
            return switch
        # First of all, so that where it fails nothing has changed here, and calling again tries again. It may have
        # reached the vehicle all the same, which has to hear of whoever is to be in charge next.
        self._in_doubt = True
        self._hand_over(to)
        self._in_doubt = False
        self._in_charge = to
        if self._goal is not None:
            self._goal._end(GoalStatus.PREEMPTED, f"{to} took over: {reason}", now_s)
            self._goal = None
        self._renew_lease()
        switch.effective_s = now_s
        self._switch = switch
        return switch

    def hand_over_again(self) -> None:
        """Send the last change of control once more: the robot's own report shows that it has not heard of it.

        Raises:
            LifecycleError: before `init()` or after `close()`.
        """
        self._require_ready("hand_over_again")
        self._hand_over(self._in_charge)

    def renew_lease(self) -> None:
        """Renew the lease of the controller in charge: `switch_ac_sc` to the same one, without a handle."""
        self._require_ready("renew_lease")
        self._renew_lease()

    def close(self, timeout_s: float) -> None:
        """Stop the robot and let go of it. Idempotent; may be called at any time."""
        if self._closed:
            return
        self._closed = True
        if self._goal is not None:
            self._goal._end(GoalStatus.CANCELLED, "the robot was closed", self.clock.now())
            self._goal = None
        self._disconnect(timeout_s)

    # --- the hooks that an adapter fills -------------------------------------------------------------------

    @abstractmethod
    def _connect(self, timeout_s: float) -> Capabilities:
        """Get the robot ready within `timeout_s`, still and with the SC in charge; return what it can do."""

    @abstractmethod
    def _send_goto(self, goal: Goal) -> None:
        """Send the goal on its way; never wait."""

    @abstractmethod
    def _sample(self) -> RobotState | None:
        """Return the newest sample in the workspace frame, with link UP; None before the first one."""

    @abstractmethod
    def _hand_over(self, to: Controller) -> None:
        """Shut the other controller's stream, flush what it had in flight, on the vehicle too; put `to` in charge."""

    @abstractmethod
    def _renew_lease(self) -> None:
        """Let the vehicle move for another `lease_s`."""

    @abstractmethod
    def _halt(self) -> None:
        """Drop the target that the vehicle works on; it brakes to a stop."""

    @abstractmethod
    def _disconnect(self, timeout_s: float) -> None:
        """Leave the vehicle stopped and free what was opened. Called once, ready or not."""

    # --- what is enforced once -----------------------------------------------------------------------------

    def _require_ready(self, call: str) -> None:
        if self._closed:
            raise LifecycleError(f"robot {self.id}: {call}() after close()")
        if self._capabilities is None:
            raise LifecycleError(f"robot {self.id}: {call}() before init()")

    def _admit(self, sample: RobotState) -> RobotState | None:
        previous = self._state
        finite = math.isfinite(
            sample.x_m
            + sample.y_m
            + sample.z_m
            + sample.heading_rad
            + sample.vx_m_s
            + sample.vy_m_s
            + sample.yaw_rate_rad_s
            + sample.stamp_s
        )
        battery = sample.battery
        if (
            not finite
            or sample.robot_id != self.id
            or (battery is not None and not 0.0 <= battery <= 1.0)
            or (previous is not None and sample.stamp_s < previous.stamp_s)
            or sample.stamp_s > self.clock.now() + FUTURE_S
        ):
            self.discarded += 1
            return previous
        return sample

    def _judge(self, goal: Goal, state: RobotState, now_s: float) -> None:
        target = goal.target
        dx, dy, dz = state.x_m - target.x_m, state.y_m - target.y_m, state.z_m - target.z_m
        if dx * dx + dy * dy + dz * dz <= goal.radius_sq_m2 and state.stamp_s >= goal.sent_s:
            goal._end(GoalStatus.REACHED, "", now_s)
            self._goal = None
        elif now_s >= goal.deadline_s:
            # First of all: a goal whose robot could not be told to stop has not ended.
            self._halt()
            goal._end(GoalStatus.TIMED_OUT, f"not there after {target.timeout_s:g} s", now_s)
            self._goal = None

    def _cancel(self, goal: Goal) -> None:
        if goal is self._goal:
            self._halt()
            goal._end(GoalStatus.CANCELLED, "cancelled by its owner", self.clock.now())
            self._goal = None
