"""What an adapter leaves behind at every open is found, and named."""

from __future__ import annotations

import mmap
import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest

from soter.adapters.pybullet.backend import SimulatedRobot
from soter.conformance import CLAUSES, Verdict, try_clause
from soter.conformance.figure import Figure
from soter.sdk import Capabilities
from tests.conformance.simulated import SimulatedHarness

LEFT: list[object] = []
RELEASED = threading.Event()


class Leaky(SimulatedRobot):
    """Takes something whenever it is connected, and gives nothing back."""

    connected: ClassVar[int] = 0

    def _connect(self, timeout_s: float) -> Capabilities:
        Leaky.connected += 1
        LEFT.append(self.take())
        return super()._connect(timeout_s)

    def take(self) -> object:
        return None


class LeakyThreads(Leaky):
    def take(self) -> object:
        thread = threading.Thread(target=RELEASED.wait, name="link-reader", daemon=True)
        thread.start()
        return thread


class LeakySockets(Leaky):
    def take(self) -> object:
        return socket.socketpair()


class LeakyProcesses(Leaky):
    def take(self) -> object:
        return subprocess.Popen([sys.executable, "-S", "-c", "import sys; sys.stdin.read()"], stdin=subprocess.PIPE)


class LeakyMemory(Leaky):
    def take(self) -> object:
        # Pages of its own: what other tests have freed could be used again.
        pages = mmap.mmap(-1, 2 << 20)
        pages.write(b"x" * len(pages))
        return pages


class Pool(LeakyThreads):
    """Fills a pool of five, and no more: no leak."""

    def take(self) -> object:
        return super().take() if Leaky.connected <= 5 else None


@pytest.fixture(autouse=True)
def _given_back() -> Iterator[None]:
    Leaky.connected = 0
    RELEASED.clear()
    yield
    RELEASED.set()
    for each in LEFT:
        if isinstance(each, subprocess.Popen):
            each.communicate()
        elif isinstance(each, threading.Thread):
            each.join()
        elif isinstance(each, tuple):
            for end in each:
                end.close()
    LEFT.clear()


def tried(kind: type[SimulatedRobot]) -> tuple[Verdict, str, dict[str, Figure]]:
    outcome, _ = try_clause(CLAUSES["resources.given_back"], SimulatedHarness(kind))
    return outcome.verdict, outcome.reason, {figure.name: figure for figure in outcome.figures}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (LeakyThreads, "every open adds 1 to threads (link-reader, link-reader, link-reader), 12 in a row; "),
        (LeakySockets, "every open adds 2 to file descriptors (socket:["),
        (LeakyProcesses, " and 1 to processes ("),
        (LeakyMemory, " to MiB of memory, 12 in a row; "),
    ],
)
def test_what_every_open_leaves_behind_is_named(kind: type[SimulatedRobot], message: str) -> None:
    verdict, reason, _ = tried(kind)
    assert verdict is Verdict.FAIL
    assert message in reason


@pytest.mark.parametrize("kind", [SimulatedRobot, Pool])
def test_an_adapter_that_gives_all_back_passes_though_it_fills_a_pool_first(kind: type[SimulatedRobot]) -> None:
    verdict, reason, figures = tried(kind)
    assert verdict is Verdict.PASS, reason
    assert set(figures) == {
        f"{each}_per_open" for each in ("threads", "descriptors", "processes", "files", "memory_mib")
    }


class WorksElsewhere(Leaky):
    """Changes the working directory whenever it is connected."""

    def take(self) -> object:
        os.chdir(tempfile.gettempdir())
        return None


def test_what_was_set_for_the_process_when_robots_were_opened_before_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tempfile.gettempdir())
    outcome, _ = try_clause(CLAUSES["host.shared"], SimulatedHarness(WorksElsewhere))
    assert outcome.verdict is Verdict.FAIL
    assert "os.chdir()" in outcome.reason
    assert Path.cwd() == Path(tempfile.gettempdir()).resolve(), "the kit gives back what it has set"
