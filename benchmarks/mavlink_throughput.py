"""How many messages a second the MAVLink adapter hears, against pymavlink's bare parser; and how old its samples are.

The stream is that of ten vehicles: positions, attitudes, reports of who is in charge and states of the battery, a
datagram each. The adapter decodes them with the same library, keeps the latest of each kind, follows every vehicle's
clock and makes a sample of every vehicle at each tick. Ages are those of ten simulated vehicles in a process of their
own, commanded over one UDP port as a supervisor does it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mav

from benchmarks.common import Row, arguments, in_turns, show
from soter.adapters.mavlink import MavlinkBackend, MavlinkConfig
from soter.adapters.mavlink.authority import COMPONENTS
from soter.adapters.mavlink.frames import Frame
from soter.adapters.mavlink.link import Inbox
from soter.adapters.mavlink.pymavlink_link import PymavlinkLink
from soter.adapters.mavlink.sampling import ChargeFilter, Sampler, TimeSync
from soter.adapters.mavlink.transport import Address
from soter.clock import VehicleClock
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.sdk import Controller, RobotSpec, Waypoint

VEHICLES = 10
STREAM_HZ = 50
TICK_S = 0.05
PEER = ("127.0.0.1", 14550)


def stream(seconds: float) -> list[bytes]:
    """Return what ten vehicles say in so many seconds."""
    codecs = {system: mav.MAVLink(None, system, 1) for system in range(1, VEHICLES + 1)}
    datagrams = []
    for step in range(round(seconds * STREAM_HZ)):
        stamp_ms = 1000 + step * 1000 // STREAM_HZ
        said = [
            mav.MAVLink_local_position_ned_message(stamp_ms, 1.0, 2.0, 0.0, 0.1, 0.1, 0.0),
            mav.MAVLink_attitude_message(stamp_ms, 0.0, 0.0, 0.5, 0.0, 0.0, 0.1),
        ]
        if step % 3 == 0:
            said.append(mav.MAVLink_named_value_int_message(stamp_ms, b"GMASTER", 256 * 255 + 191))
        if step % 12 == 0:
            said.append(mav.MAVLink_sys_status_message(0, 0, 0, 0, 12000, -1, 80, 0, 0, 0, 0, 0, 0))
        for codec in codecs.values():
            for message in said:
                datagrams.append(bytes(message.pack(codec)))
                codec.seq = (codec.seq + 1) % 256
    return datagrams


def bare_s(datagrams: Sequence[bytes]) -> float:
    """Return how long pymavlink takes to parse them."""
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    start_s, count = time.perf_counter(), 0
    for datagram in datagrams:
        count += len(parser.parse_buffer(datagram) or ())
    passed_s = time.perf_counter() - start_s
    assert count == len(datagrams)
    return passed_s


def adapter_s(datagrams: Sequence[bytes], seconds: float) -> float:
    """Return how long the adapter takes to hear what is said in so many seconds, with every vehicle's sample a tick."""
    clock = VehicleClock()
    link = PymavlinkLink(clock, Address("udpin", *PEER), 255, COMPONENTS)
    samplers = []
    for system in range(1, VEHICLES + 1):
        inbox = link.inboxes[system] = Inbox()
        time_sync = TimeSync(system, clock, inbox)
        clock.observe(system, 1.0, clock.steady_s())
        sampler = Sampler(system, inbox, time_sync, ChargeFilter(1800.0), lambda: Controller.SC)
        sampler.frame = Frame()
        samplers.append(sampler)
    tick = max(1, round(len(datagrams) * TICK_S / seconds))
    start_s = time.perf_counter()
    for number, datagram in enumerate(datagrams, start=1):
        link._take(datagram, PEER)
        if number % tick == 0:
            for sampler in samplers:
                sampler.sample()
    passed_s = time.perf_counter() - start_s
    assert all(sampler.sample() is not None for sampler in samplers)
    return passed_s


def ages_s(vehicles: int, seconds: float) -> list[float]:
    """Return how old the samples of some driving vehicles on one link are when they are read at each tick."""
    places = tuple(
        RobotPlace(number, 2.0 * number, 2.0, Box(2.0 * number - 0.1, 1.9, 2.0 * number + 0.1, 2.1))
        for number in range(1, vehicles + 1)
    )
    room = Workspace(2.0 * vehicles + 2.0, 6.0, (), places)
    specs = [RobotSpec(place.id, place.x_m, place.y_m, 1.0) for place in places]
    ages = []
    with MavlinkBackend().open(MavlinkConfig(workspace=room), specs) as fleet:
        for robot in fleet.robots:
            robot.init(30.0)
        for robot in fleet.robots:
            robot.goto(Waypoint(robot.spec.x_m, 5.0), Controller.SC)
        due_s = fleet.clock.now()
        end_s = due_s + seconds
        while due_s < end_s:
            due_s = max(due_s + TICK_S, fleet.clock.now())
            fleet.clock.sleep_until(due_s)
            for robot in fleet.robots:
                ages.append(robot.read_state().age_s(fleet.clock.now()))
                robot.renew_lease()
    return ages


def main(argv: Sequence[str] | None = None) -> float:
    """Measure and print; return the ratio."""
    quick = arguments(__doc__ or "", argv).quick
    seconds, rounds = (0.1, 1) if quick else (10.0, 7)
    datagrams = stream(seconds)
    times = in_turns({"bare": partial(bare_s, datagrams), "adapter": partial(adapter_s, datagrams, seconds)}, rounds)
    bare_hz, adapter_hz = (len(datagrams) / min(times[side]) for side in ("bare", "adapter"))
    vehicles, driven_s = (2, 1.0) if quick else (VEHICLES, 20.0)
    ages = sorted(ages_s(vehicles, driven_s))
    worst_s = ages[min(len(ages) - 1, math.ceil(0.99 * len(ages)) - 1)]
    ratio = adapter_hz / bare_hz
    rows = [
        Row("pymavlink's parser", f"{bare_hz:,.0f} messages/s"),
        Row("the adapter", f"{adapter_hz:,.0f} messages/s", ratio, ">= 0.8", ratio >= 0.8),
        Row(
            f"age of {vehicles} vehicles' samples, p99",
            f"{worst_s * 1e3:.0f} ms",
            worst_s / 0.05,
            "<= 1",
            worst_s <= 0.05,
        ),
    ]
    show(
        "MAVLink", rows, f"{len(datagrams)} datagrams, least of {rounds} rounds; {len(ages)} samples in {driven_s:g} s."
    )
    return ratio


if __name__ == "__main__":
    main()
