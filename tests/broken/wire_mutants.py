"""Small edits of the adapter behind a link, and of its vehicle, one line of a table each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from soter.clock import VirtualClock
from soter.onboard.mux import Mux
from soter.sdk import Controller, RobotState
from tests.broken.edits import driven, wired
from tests.broken.on_wire import BrokenWire
from tests.broken.parts import FIRST, SECOND, ago, counted, memory, once_in
from tests.conformance.wire import Intent, Vehicle, WireClock, WireRobot


def _arrives(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.renewed_s is not None:
        self.mux.renew(clock_s)


def _if_renewing(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.renews:
        self.mux.renew(clock_s)


def _any(self: Any, intent: Intent, clock_s: float) -> None:
    self.mux.renew(clock_s)


def _ahead(self: Any, intent: Intent, clock_s: float) -> None:
    if intent.renewed_s is not None:
        self.mux.renew(intent.renewed_s + 0.05)


def _newest(self: Any, intent: Intent, clock_s: float) -> None:
    newest = memory(self, "newest", lambda: [-math.inf])
    if intent.renewed_s is not None and intent.renewed_s >= newest[0]:
        newest[0] = intent.renewed_s
        self.mux.renew(intent.renewed_s)


class Undying(Mux[Controller, Any]):
    """Does not mind a clock that went back."""

    def passing(self, now_s: float) -> Any:
        return self.command if now_s - self._renewed_s < self.lease_s else None


def _undying(self: Any) -> None:
    self.session, self.heard = 0, 0
    self.mux = Undying(Controller.SC, self.lease_s)


def _keeps_its_lease(self: Any) -> None:
    self.offset_s = -self.world.now_s
    before, self.mux = self.mux, Undying(Controller.SC, self.lease_s)
    self.mux.in_charge, self.mux.command, self.mux.lease_s = before.in_charge, before.command, math.inf
    self.mux.renew(0.0)


def _late(periods: int, every: int = 1) -> Callable[..., None]:
    """Return a `take` that acts so many control periods after a message has come."""

    def take(self: Any, intent: Intent, clock_s: float) -> None:
        waiting = memory(self, "waiting", list)
        if counted(self, "taken") % every == 0:
            waiting.append((self.periods + periods, intent))
        else:
            Vehicle.take(self, intent, clock_s)

    return take


def _acting(self: Any, *state: float) -> tuple[float, float]:
    waiting = memory(self, "waiting", list)
    while waiting and waiting[0][0] <= self.periods:
        Vehicle.take(self, waiting.pop(0)[1], state[0] + self.offset_s)
    return Vehicle.control(self, *state)


def _seldom(periods: int) -> Callable[..., None]:
    """Return a `take` by which the vehicle looks at its commands at every so many control periods only."""

    def take(self: Any, intent: Intent, clock_s: float) -> None:
        memory(self, "waiting", list).append((math.ceil(self.periods / periods) * periods, intent))

    return take


def _said_early(self: Any, *arguments: float) -> RobotState:
    """Report the controller of the newest message, before it is acted upon."""
    waiting = memory(self, "waiting", list)
    honest = Vehicle.sample(self, *arguments)
    return honest._replace(controller=waiting[-1][1].in_charge) if waiting else honest


_REAL: Final = WireRobot.declared


def _others_after_silence(self: Any) -> RobotState | None:
    """Hand out the first robot's samples as the second's own, once nothing was heard of it for a while."""
    before = self.latest
    found = WireRobot._sample(self)
    if before is not None and found is not None and found.stamp_s - before.stamp_s > 1.0:
        self.confused = True
    first = _FIRST.get(id(self.clock))
    if self.id == FIRST:
        _FIRST.clear()
        _FIRST[id(self.clock)] = self
    if getattr(self, "confused", False) and self.id == SECOND and first is not None and first.latest is not None:
        return first.latest._replace(robot_id=SECOND)  # type: ignore[no-any-return]
    return found


_FIRST: Final[dict[int, Any]] = {}


def _one_sample_in(many: int) -> Callable[..., RobotState | None]:
    def sample(self: Any) -> RobotState | None:
        found = WireRobot._sample(self)
        kept = memory(self, "kept sample", lambda: [found])
        if kept[0] is None or (found is not None and found.stamp_s - kept[0].stamp_s >= 0.02 * many - 1e-6):
            kept[0] = found
        return kept[0]  # type: ignore[no-any-return]

    return sample


def _second_lost(self: Any, *, renew: bool = False, **changes: Any) -> None:
    """Send to the first robot for good once the second was silent: what was meant for that never arrives."""
    silent = self.latest is not None and self.clock.now() - self.latest.stamp_s > 1.0
    self.lost = getattr(self, "lost", False) or (silent and self.id == SECOND)
    if not self.lost:
        WireRobot.want(self, renew=renew, **changes)


def _sample_edit(edit: Callable[[Any, RobotState], RobotState]) -> Callable[..., RobotState | None]:
    def sample(self: Any) -> RobotState | None:
        found = WireRobot._sample(self)
        return None if found is None else edit(self, found)

    return sample


def _stale_clock(self: Any, sample: RobotState) -> float:
    """Learn the vehicle's clock once, from the first sample."""
    offset_s = memory(self, "offset", lambda: [WireRobot.arrived_s(self, sample) - sample.vehicle_stamp_s])[0]
    return float(sample.vehicle_stamp_s + offset_s)


def _obeys_all(self: Any, intent: Intent, clock_s: float) -> bool:
    return bool(intent.session != self.session or intent.number > self.heard)


def _second_halts(self: Any, intent: Intent, clock_s: float) -> bool:
    if intent.session == self.session:
        return bool(intent.number > self.heard)
    if self.mux.alive(clock_s):
        # It does not obey, but it stops, and forgets who was in charge.
        self.mux.revoke()
        self.session = -1
    return not self.mux.alive(clock_s)


DRIVEN: Final = (
    driven("CountsFromArrival", "Counts the lease from when a renewal arrives.", "deadman.late", "arrives",
            renew=_arrives),
    driven("AnyMessageRenews", "Renews the lease with any message.", "deadman.goto", "renews the lease", renew=_any),
    driven("RenewalsFromArrival", "Counts the lease from when a renewal arrives, and from nothing else.",
            "deadman.late",
           "arrives", renew=_if_renewing),
    driven("LeaseAhead", "Takes every renewal for one of 0.05 s later.", "deadman.lease", "lease_s is", renew=_ahead,
           begin=_undying),
    driven("LeaseTenPercentLonger", "Has a lease 10 % longer than promised.", "deadman.lease", "lease_s is",
           lease_s=0.17),
    driven("LeaseTwice", "Has a lease of 0.3 s, and promises 0.15 s.", "deadman.lease", "lease_s is", lease_s=0.3),
    driven("LivesBackwards", "Lets a lease live on when its clock goes back.", "deadman.clock_back", "goes back",
            begin=_undying),
    driven("NewestRenewalOnly", "Takes no renewal that is older than the newest, by a clock that may go back.",
           "deadman.clock_steps", "obey", renew=_newest),
    driven("RestartsAlive", "Begins with a lease that lives when it restarts.", "deadman.restart", "restarted",
           restart=_keeps_its_lease),
    driven("ObeysAll", "Obeys a second program while the lease of the first lives.", "authority.one_program",
           "one program", follows=_obeys_all),
    driven("SecondTakesAway", "Stops, and forgets its program, when a second one speaks.", "authority.one_program",
           "second program", follows=_second_halts),
    driven("HundredMillisecondsLate", "Acts 100 ms late, and promises 30 ms.", "bounds.latency", "latency_s",
           take=_late(10), control=_acting),
    driven("TenMillisecondsLate", "Acts 20 ms later than it does when right, 10 % beyond its promise.",
            "bounds.latency",
           "latency_s", take=_late(3), control=_acting),
    driven("LooksSeldom", "Looks at its commands every 0.06 s, and promises 0.02 s.", "bounds.latency",
           "latency_s|setpoint", take=_seldom(6), control=_acting),
    driven("AcknowledgedEarly", "Reports a hand-over 0.1 s before it is effective.", "authority.effective",
            "latency|before",
           take=_late(10), control=_acting, sample=_said_early),
    driven("BrakesEighty", "Brakes at 80 % of what it promises.", "bounds.braking", "brake_m_s2",
           control=lambda self, *state: _eighty(self, *state)),
)  # fmt: skip


def _eighty(self: Any, *state: float) -> tuple[float, float]:
    speed, rate = Vehicle.control(self, *state)
    slowest = abs(state[4]) - 0.8 * self.limits.brake_m_s2 * self.world.period_s
    return (math.copysign(slowest, state[4]) if abs(speed) < slowest else speed), rate


class Fast(WireClock):
    """Goes 1 % faster than the host."""

    def now(self) -> float:
        return 1.01 * super().now()

    def sleep_until(self, time_s: float) -> None:
        super().sleep_until(time_s / 1.01)

    def steady_s(self) -> float:
        return VirtualClock.now(self)


class WakesLate(WireClock):
    def sleep_until(self, time_s: float) -> None:
        super().sleep_until(time_s + 0.011)


WIRED: Final = (
    wired("FleetClockFast", "Has fleet time go 1 % faster than the host's.", "bounds.clock", "fast or slow",
            clock_class=Fast),
    wired("WakesLate", "Wakes every tick 11 ms late, and promises 10 ms.", "bounds.jitter", "jitter_s",
            clock_class=WakesLate),
    wired("EachTheFirst", "Has the first robot's samples for the second once the link has come back.",
          "link.reconnects_each", f"samples of robot {FIRST}", _sample=_others_after_silence),
    wired("SecondLost", "Sends nothing to the second robot any more once its link has come back.",
          "link.reconnects_each", "no longer gets its own|right way|stopped short", want=_second_lost),
    wired("OneSampleInFive", "Hands out one sample in five.", "state.age", "sample_age_s", _sample=_one_sample_in(5)),
    wired("ClockLearnedOnce", "Learns the vehicle's clock once and for all.", "deadman.clock_steps", "clock",
          arrived_s=_stale_clock),
    wired("StampsTenAhead", "Stamps samples 20 ms later than they were taken.", "truth.bounds.noise",
            "position_noise_m",
          _sample=_sample_edit(lambda _, s: s._replace(stamp_s=s.stamp_s + 0.02))),
    wired("NaNOnce", "Hands out NaN once in five hundred samples.", "state.ranges", "not finite",
          _sample=_sample_edit(once_in(500, y_m=math.nan))),
    wired("QueuedSamples", "Queues samples.", "state.age", "queue", _sample=_sample_edit(lambda r, s: ago(r, s, 5))),
    wired("AgeTenPercent", "Has samples a little older than promised.", "state.age", "sample_age_s",
          declared=replace(_REAL, sample_age_s=0.018)),
    wired("LatencyTooSmall", "Promises less latency than it has.", "bounds.latency", "latency_s",
          declared=replace(_REAL, latency_s=0.005)),
    wired("TopSpeedTenPercent", "Promises a top speed that is 10 % lower.", "goto.v_max", "v_max_m_s",
          declared=replace(_REAL, v_max_m_s=0.2)),
    wired("BodyTenPercent", "Promises a body that is 10 % smaller.", "truth.bounds.body", "body_radius_m",
          declared=replace(_REAL, body_radius_m=0.095)),
    wired("BrakesTooGood", "Promises brakes that are 20 % better.", "bounds.braking", "brake_m_s2",
          declared=replace(_REAL, brake_m_s2=1.2)),
    wired("SpeedNinePercentLow", "Says a speed 9 % low.", "state.velocity", "too low",
          _sample=_sample_edit(lambda _, s: s._replace(vx_m_s=0.91 * s.vx_m_s, vy_m_s=0.91 * s.vy_m_s))),
    wired("TenMillimetres", "Is 1 cm off, and promises 1 mm.", "truth.bounds.noise", "position_noise_m",
          _sample=_sample_edit(lambda _, s: s._replace(x_m=s.x_m + 0.01))),
)  # fmt: skip

WIRE_MUTANTS: Final[tuple[type[BrokenWire], ...]] = (*DRIVEN, *WIRED)
