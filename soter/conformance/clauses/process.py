"""Process: when the process that drives a robot is killed or hangs, the robot stops."""

from __future__ import annotations

import math
import signal
import subprocess
import time
from collections.abc import Callable

from soter.conformance.bench import Bench
from soter.conformance.clause import Tier, clause
from soter.conformance.driver import GIVES_UP
from soter.sdk import Waypoint

_HOOKS = ("start_driver", "observe")
_UP_S = 30.0
_ENDS_S = 20.0
_LOOK_S = 0.02
_SAYS_S, _SILENT_S, _ASKS = 1.0, 3.0, 2


def _watch(
    bench: Bench, end: Callable[[subprocess.Popen[bytes]], None], how: str, *, ends_by_itself: bool = False
) -> None:
    """Let another process drive a robot, end that process, and judge where the robot stops."""
    # Open a fleet to learn its capabilities and start poses, and close it before the driver takes over.
    robot = bench.open_one()
    caps, target = bench.caps, bench.place(robot, 0.9)
    bench.close()
    process = bench.harness.start_driver(target._replace(timeout_s=bench.way_s()))
    try:
        _see_it_move(bench, process, target)
        before = bench.harness.observe(robot.id)
        end(process)
        speedup = bench.harness.speedup
        allowed_s = caps.lease_s + caps.latency_s + caps.setpoint_period_s + bench.brakes_s
        began_s = time.monotonic()
        time.sleep((allowed_s + caps.jitter_s + 0.1) / speedup)
        rest = bench.harness.observe(robot.id)
        waited_s = (time.monotonic() - began_s) * speedup
        time.sleep(1.0 / speedup)
        later = bench.harness.observe(robot.id)
        ended = not ends_by_itself or _ends(process)
    finally:
        process.kill()
        process.wait(5.0)
    slipped = math.dist(rest[:2], later[:2])
    bench.require(
        slipped <= bench.still_m,
        f"{waited_s:.2f} s after its driver {how} the robot still moves, {slipped:.3f} m within another second: the "
        "last set-point lives on; the lease must be on the robot's own side",
    )
    bench.measure(
        "orphaned_run_m", math.dist(before[:2], rest[:2]), caps.v_max_m_s * (allowed_s + 0.1), bench.still_m,
        "the lease is longer than declared",
    )  # fmt: skip
    bench.require(
        ended,
        f"{_ENDS_S:g} s after its driver {how} that process is still there: a thread that is no daemon, or a library "
        "that waits at the end for what cannot be sent any more; nothing that restarts such a program ever does",
    )


def _see_it_move(bench: Bench, process: subprocess.Popen[bytes], target: Waypoint) -> None:
    fast = 0.1 * bench.harness.room_m / 2.0
    first = None
    give_up_s = time.monotonic() + _UP_S
    while time.monotonic() < give_up_s:
        code = process.poll()
        bench.require(code is None, f"the driver ended with {code} before it was to be ended: see its output")
        x_m, y_m, _ = bench.harness.observe(bench.fleet.robots[0].id)
        first = first or (x_m, y_m)
        if math.dist(first, (x_m, y_m)) > fast and math.dist((target.x_m, target.y_m), (x_m, y_m)) > 2 * fast:
            return
        time.sleep(_LOOK_S / bench.harness.speedup)
    bench.require(
        False,
        f"within {_UP_S:g} s the driver did not get the robot to move: start_driver() leads to another robot than "
        "observe() watches, or the driver does not get ready",
    )


@clause("process.killed", tier=Tier.WIRE, hooks=_HOOKS)
def killed(bench: Bench) -> None:
    """When the process that drives it is killed, the robot stops within the lease."""
    _watch(bench, lambda process: process.kill(), "was killed")


@clause("process.hung", tier=Tier.WIRE, hooks=_HOOKS)
def hung(bench: Bench) -> None:
    """When the process that drives it hangs, the robot stops within the lease."""
    _watch(bench, lambda process: process.send_signal(signal.SIGSTOP), "hung")


def _ends(process: subprocess.Popen[bytes]) -> bool:
    try:
        process.wait(_ENDS_S)
    except subprocess.TimeoutExpired:
        return False
    return True


@clause("process.ends", tier=Tier.WIRE, hooks=_HOOKS)
def ends(bench: Bench) -> None:
    """A program that ends by an error, and does not close its robots, ends, and the robot stops within the lease."""
    _watch(bench, lambda process: process.send_signal(GIVES_UP), "ended by an error", ends_by_itself=True)


@clause("process.lost", tier=Tier.WIRE)
def lost(bench: Bench) -> None:
    """A fleet whose backend has started the robots itself drives them, and says when their program has ended."""
    bench.require_hook("killable")
    fleet, kill = bench.harness.killable()
    bench.opener = lambda: fleet
    robot = bench.open_one()
    bench.get_going(robot, bench.place(robot, 0.9))
    said, truth = fleet.lost(), fleet.truth
    bench.require(not said, f"the program that simulates its robot runs, and the fleet's lost() says: {said}")
    bench.faulty = True
    kill()
    bench.require(
        bench.run(_SAYS_S, lambda: bool(fleet.lost()), renew=False),
        f"{_SAYS_S:g} s after the program that simulates its robot was killed the fleet's lost() says nothing: a run "
        "waits for robots that are gone and is told nothing; ask the process itself, and take no error for an answer",
    )
    bench.require(
        truth is None or bench.run(_SILENT_S, lambda: truth.report().ended_s is not None, renew=False),
        f"{_SILENT_S:g} s after the simulated world has ended its truth does not say since when nothing is known: "
        "silence is taken for a run in which no rule was broken; set ended_s in report()",
    )
    if truth is not None:
        said_s = [truth.report().ended_s for _ in range(_ASKS)]
        bench.require(
            None not in said_s and len({*said_s}) == 1,
            f"its truth said once since when nothing is known, and asked again it says {said_s}: whoever asks at the "
            "end of a run is not told; set ended_s in every report() from then on",
        )
