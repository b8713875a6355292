"""Processes of simulators: how they have ended is said, also of one that was stopped, and none holds the end up."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

from soter.sdk import program
from tests.waiting import wait_until


def test_a_process_that_was_stopped_is_lost_and_ends_at_once() -> None:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) as process:
        assert not program.ended("the world", process)
        process.send_signal(signal.SIGSTOP)
        wait_until(lambda: bool(program.ended("the world", process)))
        said = program.ended("the world", process)
        assert said == f"the world, process {process.pid}, was stopped by signal SIGSTOP"
        began_s = time.perf_counter()
        program.end([process])
        assert time.perf_counter() - began_s < program._END_TIMEOUT_S
        assert program.ended("the world", process).endswith("has ended with signal SIGTERM")
