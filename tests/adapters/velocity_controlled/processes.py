"""Starting SOTER as a user does, and looking at processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from tests.waiting import gone, wait_until

EXAMPLES: Final = Path(__file__).parents[3] / "examples"


def soter(*arguments: str) -> subprocess.Popen[str]:
    """Start a command."""
    return subprocess.Popen(
        [sys.executable, "-m", "soter.cli", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def end_with_their_parent(simulator: str, environment: Mapping[str, str]) -> None:
    """The processes of simulated robots end when the one that started them is killed.

    Args:
        simulator: the class, with its module.
        environment: of the process that starts them.
    """
    program = (
        "import os\n"
        f"from {simulator.rpartition('.')[0]} import {simulator.rpartition('.')[2]} as Simulator\n"
        "from tests.adapters.velocity_controlled.driving import ROOM, SPECS\n"
        "simulator = Simulator(ROOM, SPECS)\n"
        "print(simulator.world.pid, *(each.pid for each in simulator.muxes.values()), flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    env = {**environment, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), *sys.path])}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60, env=env, check=False)
    assert done.returncode == -signal.SIGKILL
    left = [int(number) for number in done.stdout.split()]
    assert len(left) == 3, "a world and two muxes"
    wait_until(lambda: all(map(gone, left)))


def ctrl_c_ends_a_run(backend: str) -> None:
    """Ctrl-C ends a run on a wall clock, and every process that it has started."""
    with soter(
        "run", str(EXAMPLES / "surveillance.toml"), "--backend", backend, "--planner", "straight-line",
        "--duration", "600", "--json", "-", "--no-record",
    ) as process:  # fmt: skip
        assert process.stderr is not None
        while "of 600 s" not in process.stderr.readline():
            assert process.poll() is None
        left = children(process.pid)
        assert left
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(out)["status"] == "interrupted"
    assert [pid for pid in left if Path(f"/proc/{pid}").exists()] == []
