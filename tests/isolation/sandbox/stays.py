"""A boxed process that stays, or ends as it is told; see `soter.isolation.child`."""

from __future__ import annotations

import os
import pickle
import signal
import socket
import time
from typing import BinaryIO


def main(stdin: BinaryIO, socket_fd: int, lifeline_fd: int) -> None:
    how = pickle.load(stdin)  # noqa: S301 - from the test
    if isinstance(how, int):
        os._exit(how)
    if how is not None:
        os.kill(os.getpid(), signal.Signals[how])
    if os.fork() == 0:
        os.setsid()
        time.sleep(600.0)
    socket.socket(fileno=socket_fd).send(b"started")
    time.sleep(600.0)
