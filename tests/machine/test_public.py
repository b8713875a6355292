from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import soter.machine
from examples import pingpong
from soter.machine import Halt

ROOT = Path(__file__).parents[2]


def test_every_public_name_is_there_and_documented() -> None:
    names = soter.machine.__all__
    assert names == sorted(names)
    for name in names:
        assert getattr(getattr(soter.machine, name), "__doc__", None)


def test_the_ping_pong_of_the_thesis() -> None:
    steps = [(t.machine.name, t.source, t.target) for t in pingpong.run()]
    assert steps == [
        ("Driver-1", None, "Init"),
        ("Server-2", None, "Init"),
        ("Server-3", None, "Init"),
        ("Client-4", None, "Init"),
        ("Client-4", "Init", "SendPing"),
        ("Client-4", "SendPing", "WaitPong1"),
        ("Server-2", "Init", "SendPong"),
        ("Server-2", "SendPong", "End"),
        ("Server-2", "End", None),
        ("Server-3", "Init", "SendPong"),
        ("Server-3", "SendPong", "End"),
        ("Server-3", "End", None),
        ("Client-4", "WaitPong1", "WaitPong2"),
        ("Client-4", "WaitPong2", "Done"),
    ]
    assert [t.event for t in pingpong.run() if t.target is None] == [Halt(), Halt()]


def test_it_runs_as_a_script() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "pingpong.py")], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.count("\n") == 14
    assert "Client-4    WaitPong2 -> Done  (Pong)" in done.stdout
