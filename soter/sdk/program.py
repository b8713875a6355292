"""Simulators in processes of their own, as adapters start them where no robot is given: how they begin and end."""

from __future__ import annotations

import os
import select
import subprocess
import time
from collections.abc import Sequence

_END_TIMEOUT_S = 3.0


def first_line(process: subprocess.Popen[bytes], described: bytes, timeout_s: float) -> bytes:
    """Hand a world to a simulator and return the first line that it prints, which says where its robots are.

    Args:
        process: started with pipes for standard input and output.
        described: the world; its standard input ends behind it.
        timeout_s: host time to wait for the line.

    Raises:
        OSError: it has ended, or says nothing in time.
    """
    into, out = process.stdin, process.stdout
    assert into is not None
    assert out is not None
    into.write(described)
    into.close()
    until_s = time.perf_counter() + timeout_s
    line = b""
    while not line.endswith(b"\n"):
        left_s = until_s - time.perf_counter()
        if left_s <= 0.0 or not select.select([out], [], [], left_s)[0]:
            raise OSError(f"nothing was heard of them within {timeout_s:g} s")
        part = os.read(out.fileno(), 65536)
        if not part:
            raise OSError(f"their process ended with code {process.wait()}")
        line += part
    return line


def end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End processes and wait until they are gone; those that do not go in time are killed. Idempotent."""
    for process in processes:
        process.terminate()
    for process in processes:
        try:
            process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None and not pipe.closed:
                pipe.close()
