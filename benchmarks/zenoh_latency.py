"""What the Zenoh adapter adds to a message at 50 Hz, and to a hand-over, over a bare publisher and subscriber.

A velocity goes to another process and back, 50 times a second: said and heard as the adapter does, as CDR that is
checked; and in turns with that as the same bytes, which nobody looks at. How the hand-over is measured is said in
`switching.py`. The listener is scheduled as the mux is, where the kernel allows it: what is measured with load is the
way to it, and not how long it waits for a core. All are peers on this host.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Final

from benchmarks import switching
from benchmarks.common import ROOT, Row, arguments, show
from soter.adapters.zenoh.session import SessionOptions, close_session, endpoints, open_session

if TYPE_CHECKING:
    import zenoh

PERIOD_S: Final = 0.02
TRIPS: Final = 1500
QUICK_TRIPS: Final = 10
_PATIENCE_S: Final = 10.0

OPEN = """
import json, sys, time
from benchmarks.zenoh_latency import bare_ear
from soter.adapters.zenoh.messages import Twist
from soter.adapters.zenoh.session import SessionOptions, close_session, open_session
from soter.adapters.zenoh.talk import Ear, Voice
session = open_session(SessionOptions(connect=tuple(sys.argv[1:])))
"""
CLOSE = """
print("ready", flush=True)
sys.stdin.read()
close_session(session)
"""
ECHO = f"""{OPEN}
voice, publisher = Voice(session, "soter/back"), session.declare_publisher("bare/back")
keep = Ear(session, "soter/to", Twist, voice.say), bare_ear(session, "bare/to", publisher.put)
{CLOSE}"""
LISTENER = f"""{OPEN}
from soter.onboard.program import favour

heard = []
def note(name):
    return lambda each: heard.append((name, time.monotonic(), each.linear.x, each.angular.z))
keep = Ear(session, "robot1/cmd_vel", Twist, note("base")), Ear(session, "bare", Twist, note("bare"))
favour()
while not heard:
    time.sleep(0.01)
{CLOSE}print(json.dumps(heard), flush=True)
"""


def started(program: str, where: Sequence[str]) -> subprocess.Popen[str]:
    """Start a program that is a peer of a session."""
    return subprocess.Popen(
        [sys.executable, "-c", program, *where], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def bare_ear(session: zenoh.Session, key: str, take: Callable[[zenoh.ZBytes], object]) -> zenoh.Subscriber[Any]:
    """Hear bytes in a thread that waits for them, which is the quickest way from Python."""
    import zenoh

    newest: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(1)
    subscriber = session.declare_subscriber(key, newest)
    samples = subscriber.handler

    def listen() -> None:
        while True:
            try:
                payload = samples.recv().payload
            except zenoh.ZError:  # closed
                return
            take(payload)

    threading.Thread(target=listen, daemon=True).start()
    return subscriber


def there_and_back(trips: int) -> tuple[list[float], list[float]]:
    """Return the times of so many velocities there and back, the adapter's and bare ones, in milliseconds."""
    from soter.adapters.zenoh.messages import Twist, Vector3, encode
    from soter.adapters.zenoh.talk import Ear, Voice

    with ExitStack() as stack:
        session = open_session(SessionOptions())
        stack.callback(close_session, session)
        echo = stack.enter_context(started(ECHO, endpoints(session)))
        back = threading.Event()
        ear = Ear(session, "soter/back", Twist, lambda _: back.set())
        stack.callback(ear.close)
        subscriber = bare_ear(session, "bare/back", lambda _: back.set())
        stack.callback(subscriber.undeclare)
        voice, publisher = Voice(session, "soter/to"), session.declare_publisher("bare/to")
        assert echo.stdout is not None
        assert echo.stdout.readline() == "ready\n"
        velocity = Twist(Vector3(x=0.22), Vector3(z=-0.5))
        payload = encode(velocity)

        def trip(say: Callable[[], object]) -> float:
            begun_s = time.perf_counter()
            back.clear()
            say()
            assert back.wait(_PATIENCE_S)
            return 1e3 * (time.perf_counter() - begun_s)

        sides: list[tuple[Callable[[], object], list[float]]] = [
            (lambda: voice.say(velocity), []),
            (lambda: publisher.put(payload), []),
        ]
        time.sleep(0.5)  # until both sides know of each other
        for number in range(trips):
            for say, times in sides if number % 2 else sides[::-1]:
                times.append(trip(say))
                time.sleep(PERIOD_S / 2)
        echo.communicate("", timeout=_PATIENCE_S)
        return sides[0][1], sides[1][1]


def hand_over(rounds: int) -> tuple[list[float], list[float]]:
    """Return the times of so many decisions, and of so many bare messages, in milliseconds."""
    from soter.adapters.zenoh.backend import ZenohBackend
    from soter.adapters.zenoh.messages import Twist, Vector3, encode
    from soter.adapters.zenoh.options import ZenohConfig
    from soter.adapters.zenoh.simulator import ZenohSimulator

    with ExitStack() as stack:
        simulator = ZenohSimulator(switching.ROOM, switching.SPECS)
        stack.callback(simulator.close)
        listener = stack.enter_context(started(LISTENER, simulator.session.connect))
        config = ZenohBackend.located(ZenohConfig(workspace=switching.ROOM), simulator)
        fleet = stack.enter_context(ZenohBackend().open(config, switching.SPECS))
        (robot,) = fleet.robots
        robot.init(30.0)
        session = open_session(simulator.session)
        stack.callback(close_session, session)
        bare = session.declare_publisher("bare")
        return switching.measure(robot, lambda number: bare.put(encode(Twist(Vector3(x=number)))), listener, rounds)


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    quick = arguments(__doc__ or "", argv).quick
    ours, bare = there_and_back(QUICK_TRIPS if quick else TRIPS)
    (p50, p99), (bare50, bare99) = switching.percentiles(ours), switching.percentiles(bare)
    rows = [
        Row(f"bare bytes, p50 / p99 of {len(bare)}", f"{bare50:.2f} / {bare99:.2f} ms"),
        Row(f"the adapter's velocity, p50 / p99 of {len(ours)}", f"{p50:.2f} / {p99:.2f} ms", p50 / bare50),
    ]
    show("To another process and back, 50 times a second", rows)
    show("From a decision to the first velocity at the base", switching.measured_rows(hand_over, quick=quick))


if __name__ == "__main__":
    main()
