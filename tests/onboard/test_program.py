"""How programs on a robot end, whatever the libraries do that they use."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

SLEEPS = "time.sleep(60.0)"
HOLDS_THE_INTERPRETER = "ctypes.PyDLL(None).sleep(60)"


def run(program: str) -> int:
    """Run a program with two helpers of those that end; return its exit code."""
    imports = "import ctypes, signal, time\nfrom soter.onboard.program import Ending, killed_after\n"
    return subprocess.run([sys.executable, "-c", imports + program], timeout=30.0, check=False).returncode


@pytest.mark.parametrize("leave", [SLEEPS, HOLDS_THE_INTERPRETER])
def test_what_never_comes_to_its_end_is_ended(leave: str) -> None:
    assert run(f"Ending()\nwith killed_after(0.1):\n    {leave}") == -signal.SIGALRM


def test_what_ends_in_time_is_left_alone() -> None:
    assert run("with killed_after(0.1):\n    pass\ntime.sleep(0.2)") == 0
