"""What measures each promise of `soter.sdk.Capabilities`, and how sharply; the tests refuse one without an entry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

MEASURED_BY: Final[Mapping[str, tuple[tuple[str, ...], str]]] = {
    "in_process": (("bounds.clock",), "fleet time stands still while nobody sleeps; on a wire it keeps to the host's"),
    "deterministic": (("capabilities.deterministic",), "two runs of the same calls, compared bit for bit"),
    "reverses": (
        ("state.backwards",),
        "a target straight behind with the present heading is driven to without turning",
    ),
    "reports_battery": (
        (
            "capabilities.optional",
            "state.charge",
            "truth.state.charge",
            "truth.state.discharge",
            "state.full",
            "state.emptying",
        ),
        (
            "samples carry a charge, or none; it falls while the robot drives, from one sample to the next by no more "
            "than that explains, rises on the charger, and is the true one to a hundredth, from full to empty, where a "
            "truth tells it"
        ),
    ),
    "reports_controller": (
        ("capabilities.optional", "authority.confirmed", "authority.alternations"),
        "samples carry who is in charge, or none; each of 100 switches shows, 1000 in process",
    ),
    "v_max_m_s": (
        ("goto.v_max",),
        "the fastest of a run through the whole room at full speed, and of one backwards; 5 % too fast fails",
    ),
    "yaw_rate_max_rad_s": (
        ("bounds.yaw_rate", "endurance.minute"),
        (
            "the fastest of three turns; 10 % too fast fails, and so does less than 60 % of it, in process 95 %, also "
            "after much turning"
        ),
    ),
    "brake_m_s2": (
        ("bounds.braking",),
        (
            "median of 6 stops on its way forwards and of 6 backwards, each from its own first deceleration on; 10 % "
            "too weak fails in process, 20 % on a wire; 4 from half the speed, four times less sharply, and in process "
            "the weakest of 6 while it steers"
        ),
    ),
    "body_radius_m": (
        ("truth.bounds.body",),
        "two robots driven together slowly until the truth counts a contact; 10 % too large fails; simulated ones only",
    ),
    "latency_s": (
        ("bounds.latency", "bounds.long_tube", "goto.wakes", "goal.replaced", "endurance.minute"),
        (
            "16 starts and 16 stops at odd phases: nine of ten within it, all within it and jitter_s; a start from "
            "long rest, and 4 goals that replace another, 8 in process, within it and jitter_s; the better of "
            "2 stops after ways of seconds within it. What befalls a share p of all "
            "commands is met with 1 - (1 - p)^32 there; and of 1300 goals, one a tick, samples that name goals say "
            "when they were taken, to a sample: none later than latency_s, on a wire all but one: the host's"
        ),
    ),
    "sample_age_s": (
        ("state.age",),
        (
            "several reads a tick for 8 s while it drives: 95 % within it, 99.5 % within it and jitter_s; on a wire, "
            "where the host may have stood still, again for 8 s if they were not"
        ),
    ),
    "jitter_s": (
        ("bounds.jitter",),
        "200 wakes at moments of all kinds: none early, 95 % within it, 99 % within twice of it; in process 1000, all",
    ),
    "setpoint_period_s": (
        ("bounds.latency",),
        "how far apart the reactions to calls at odd phases are; coarse, since latency_s has it in it",
    ),
    "lease_s": (
        ("deadman.lease", "deadman.hand_over"),
        (
            "mean of 8 times from the last renewal to the first deceleration, less what a cancel takes; the longest "
            "within it, latency_s and jitter_s, and so are two that begin with a hand-over; 10 % too long fails"
        ),
    ),
    "tube_m": (
        ("bounds.tube", "bounds.long_tube", "truth.bounds.leg"),
        (
            "the widest of six legs to all sides, 12 by truth in process, of one backwards, of two towards "
            "targets several metres away, and of legs of 8 m where there is room; 10 % too wide fails where the place "
            "is known to a tenth"
        ),
    ),
    "overshoot_m": (
        ("bounds.overshoot",),
        (
            "the farthest of eight legs, most through the whole room, of one backwards, of one with a wide radius, and "
            "of one whose target replaces another on the way"
        ),
    ),
    "position_noise_m": (
        ("truth.bounds.noise", "bounds.rest", "endurance.minute"),
        (
            "samples against the truth at their own stamps, on a wire 99 % of them sharply; there clocks are known to "
            "a few milliseconds, which at top speed is about a millimetre; and sharply at rest, after 66 s of "
            "driving, 88 s in process"
        ),
    ),
    "pivots_first": (("bounds.pivot",), "no farther than tube_m from its place before it looks along its way"),
    "accel_m_s2": (
        ("bounds.acceleration",),
        (
            "median of 12 starts, and of 3 on its way from forwards to backwards; 10 % too fast fails in process, 20 % "
            "on a wire"
        ),
    ),
    "speed_noise_m_s": (
        ("truth.bounds.velocity", "state.velocity", "bounds.rest"),
        (
            "means over a window against the truth, and against positions, also at a tenth of v_max_m_s; where nothing "
            "is promised 5 % of v_max_m_s; and what is shown at rest in 8 s, where nothing is promised 2 %; a robot "
            "that is to stay at rest may move by the truth by as much, and at most by 5 % of v_max_m_s"
        ),
    ),
    "heading_noise_rad": (
        ("truth.bounds.noise", "bounds.rest", "endurance.minute"),
        "every sample against the truth at its own stamp, and at rest after much turning; 0.05 rad if not promised",
    ),
}
"""By promise, the clauses that measure it, and how."""
