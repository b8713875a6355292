"""`python -m soter_sim.mavlink`: the simulated vehicles for programs; people use `soter sim mavlink`.

The world comes on standard input, as `soter.sdk.wire.describe` writes it. One line of JSON is printed once
it is ready: `{"links": [ADDRESS, ...], "truth": "HOST:PORT", "robots": [ID, ...]}`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from soter.errors import SoterError
from soter_sim.mavlink.frames import Origin
from soter_sim.mavlink.signing import read_key
from soter_sim.mavlink.simulation import Settings, Simulation
from soter_sim.program import read_world

_LOOK_FOR_PARENT_STEPS = 20


def main() -> int:
    """Run the program and return its exit code."""
    arguments = _parser().parse_args()
    try:
        workspace, robots, limits = read_world()
        settings = Settings(
            vehicle=arguments.vehicle,
            engine=arguments.engine,
            udp=tuple(arguments.udp),
            tcp=tuple(arguments.tcp),
            truth=arguments.truth,
            rate_hz=arguments.rate,
            streams_hz=arguments.streams,
            plain=arguments.plain,
            like=arguments.like,
            speedup=arguments.speedup,
            boot_s=arguments.boot,
            origin=Origin() if arguments.origin is None else Origin.read(arguments.origin),
            key=None if arguments.sign is None else read_key(arguments.sign),
            limits=limits,
        )
        simulation = Simulation(workspace, robots, settings)
    except (SoterError, ValueError, OSError, ImportError) as failure:
        sys.stderr.write(f"error: {' '.join(str(failure).split())}\n")
        return 2
    with simulation:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: simulation.stop())
        ready = {
            "links": [link.address for link in simulation.links],
            "truth": simulation.truth.address,
            "robots": [autopilot.id for autopilot in simulation.autopilots],
        }
        sys.stdout.write(f"{json.dumps(ready)}\n")
        sys.stdout.flush()
        simulation.run(_parent_lives(arguments.parent))
    return 0


def _parser() -> argparse.ArgumentParser:
    says = "Simulated vehicles on MAVLink; the world comes as MessagePack on standard input."
    parser = argparse.ArgumentParser(prog="python -m soter_sim.mavlink", description=says)
    parser.add_argument("--udp", type=int, action="append", default=[], help="send to this port of this host")
    parser.add_argument("--tcp", type=int, action="append", default=[], help="listen on this port; 0 for any free one")
    parser.add_argument("--truth", type=int, default=0, help="serve ground truth on this port; 0 for any free one")
    parser.add_argument("--vehicle", default="rover", help="rover or copter")
    parser.add_argument("--engine", default="kinematic", help="kinematic or pybullet")
    parser.add_argument("--rate", type=float, help="control periods in a second")
    parser.add_argument("--streams", type=float, help="messages of a kind in a second at most; else one a period")
    parser.add_argument("--plain", action="store_true", help="without what is added to ArduPilot: master, lease, yaw")
    parser.add_argument("--like", help="like a real autopilot: ardurover, ardurover-boat, arducopter or px4")
    parser.add_argument("--speedup", type=float, default=1.0, help="simulated seconds by second, at most")
    parser.add_argument("--boot", type=float, default=2.0, help="simulated seconds until an autopilot is ready")
    parser.add_argument("--origin", metavar="LAT,LON,ALT", help="where on earth a workspace in metres has its origin")
    parser.add_argument("--sign", type=Path, help="a file with a passphrase: sign, and take what is signed only")
    parser.add_argument("--parent", type=int, help="end when this process is no longer the parent")
    return parser


def _parent_lives(parent: int | None) -> Callable[[], bool]:
    """Return a function that says whether a process is still the parent; it only checks now and then."""
    steps = itertools.count(1)
    return lambda: parent is None or next(steps) % _LOOK_FOR_PARENT_STEPS != 0 or os.getppid() == parent


if __name__ == "__main__":
    sys.exit(main())
