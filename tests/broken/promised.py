"""Adapters in process that keep less than they promise."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from soter.clock import VirtualClock
from tests.broken.edits import edited, promising, targeted
from tests.broken.in_process import Broken
from tests.broken.parts import (
    SECOND,
    Exact,
    acting_late,
    ago,
    braking_at,
    leased,
    scaled,
    with_control,
)


class FollowsTheHost(VirtualClock):
    """Goes on while nobody sleeps."""

    def now(self) -> float:
        return super().now() + 1e-3 * self.steady_s()


PROMISES: Final = (
    edited("HostTime", "Promises virtual time, and follows the host's.", "bounds.clock", "virtual time",
           clock_class=FollowsTheHost),
    promising(Broken, "BrakeTenPercent", "Promises brakes that are 10 % better.", "bounds.braking", "brake_m_s2",
            brake_m_s2=1.1),
    promising(Broken, "TopSpeedTenPercent", "Promises a top speed that is 10 % lower.", "goto.v_max", "v_max_m_s",
              v_max_m_s=0.2),
    promising(Broken, "TurnTenPercent", "Promises turns that are 10 % slower.", "bounds.yaw_rate", "yaw_rate_max",
              yaw_rate_max_rad_s=2.58),
    promising(Broken, "BodyTenPercent", "Promises a body that is 10 % smaller.", "truth.bounds.body", "body_radius_m",
              body_radius_m=0.095),
    promising(Exact, "OvershootTenPercent", "Promises to run on less than it does.", "bounds.overshoot",
            "brakes too late",
              overshoot_m=0.001),
    promising(Exact, "AccelerationTenPercent", "Promises to gain speed 10 % more slowly.", "bounds.acceleration",
              "accel_m_s2", accel_m_s2=0.9),
    promising(Exact, "AccelerationUnknown", "Promises an acceleration of 0.02, and has 1.", "bounds.acceleration",
              "accel_m_s2", accel_m_s2=0.02),
    promising(Broken, "TooFast", "Promises twice the top speed that it has.", "bounds.braking", "v_max_m_s",
            v_max_m_s=0.44),
    promising(Broken, "NoSamples", "Promises no battery, and reports one.", "capabilities.optional", "battery",
              reports_battery=False),
    edited("SpeedThreePercentLow", "Says a speed 3 % low, and promises exact ones.", "truth.bounds.velocity",
           "speed_noise_m_s", declared=Exact.declared, _sample=lambda self: scaled(self._honest(), 0.97)),
    edited("HeadingHundredthOff", "Has headings 0.01 rad off, and promises exact ones.", "truth.bounds.noise",
           "heading_noise_rad", declared=Exact.declared,
           _sample=lambda self: (s := self._honest())._replace(heading_rad=math.remainder(s.heading_rad + 0.01,
            6.2831853))),
    edited("NoiseTenPercent", "Has 10 % more noise than promised.", "truth.bounds.noise", "position_noise_m",
           declared=replace(Broken.declared, position_noise_m=0.01),
           _sample=lambda self: (s := self._honest())._replace(x_m=s.x_m + 0.0112)),
    edited("AgeTenPercent", "Has samples 10 % older than promised.", "state.age", "sample_age_s",
           declared=replace(Broken.declared, sample_age_s=0.09), _sample=lambda self: ago(self, self._honest(), 2)),
    targeted("CannotReverse", "Promises to reverse, and turns round.", "state.backwards", "cannot reverse",
             lambda _, t: t._replace(heading_rad=None)),
    edited("BrakesNinety", "Brakes at 90 % of what it promises.", "bounds.braking", "brake_m_s2",
           _connect=with_control(braking_at(0.9))),
    edited("BrakesSeventy", "Brakes at 70 % of what it promises, and promises a latency that it does not need.",
           "bounds.braking", "brake_m_s2", declared=replace(Broken.declared, latency_s=0.2),
           _connect=with_control(braking_at(0.7))),
    edited("BrakesFiftyFive", "Brakes at 55 % of what it promises.", "bounds.braking", "brake_m_s2",
           _connect=with_control(braking_at(0.55))),
    edited("ArcsFirst", "Promises to turn in place, and drives while it turns.", "bounds.pivot", "drives off",
           _connect=with_control(lambda _, state, v, w: (0.1 if abs(w) > 0.5 else v, w))),
    edited("TubeBySteering", "Steers a little to the left all the time.", "bounds.tube", "curve",
           _connect=with_control(lambda _, state, v, w: (v, w + (0.35 if abs(v) > 0.1 else 0.0)))),
    edited("LeaseTenPercent", "Has a lease 10 % longer than promised.", "deadman.lease", "lease_s is",
           __init__=leased(0.15), declared=replace(Broken.declared, lease_s=0.136)),
    edited("LeaseTwice", "Has a lease twice as long as promised.", "deadman.lease", "lease_s is",
           __init__=leased(0.2)),
    edited("LeaseTwiceOfSecond", "Has a lease three times as long for the second robot.", "several.second",
           "lease_s is", __init__=leased(0.3, robot_id=SECOND)),
    edited("LatencyTenPercent", "Acts 10 % later than promised.", "bounds.latency", "latency_s",
           declared=replace(Broken.declared, latency_s=0.09), **acting_late(2)),
    edited("LateGotos", "Acts on a goto 0.1 s late.", "bounds.latency", "latency_s", **acting_late(2, halts=False)),
    edited("LateStops", "Acts on a stop 0.1 s late.", "bounds.latency", "latency_s", **acting_late(2, gotos=False)),
    edited("OneInFiveLate", "Acts on one command in five 0.1 s late.", "bounds.latency", "latency_s", **acting_late(2,
            every=5)),
    edited("OneInFifteenLate", "Acts on one command in fifteen 0.2 s late.", "bounds.latency", "latency_worst_s",
           **acting_late(4, every=15)),
)  # fmt: skip
