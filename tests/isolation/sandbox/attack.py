"""Boxes itself in and then tries what a box is against; says in JSON what is in force and what came of each try.

Arguments: a secret file, the address of a TCP and of a UDP socket, an abstract Unix socket, and two bound ones, of a
stream and of packets, the id of a process of the same user, a folder for scratch; then `user` to be an ordinary one,
and `no-namespaces` for a kernel that allows none, as in most containers.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from soter.isolation import sandbox
from soter.isolation.sandbox import SandboxRules, kernel

SECRET, TCP, UDP, ABSTRACT, BOUND, LETTERBOX, VICTIM, SCRATCH, *HOW = sys.argv[1:]
NOBODY = 65534
PTRACE_ATTACH = 16

libc = ctypes.CDLL(None, use_errno=True)


def call(result: int) -> int:
    """Raise what the kernel said."""
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def connects(family: int, kind: int, address: Any) -> None:
    with socket.socket(family, kind) as attacker:
        attacker.connect(address)
        attacker.send(b"cmd_vel")


def reads(path: str) -> Callable[[], object]:
    return lambda: Path(path).read_bytes()


def makes_rings() -> None:
    call(libc.syscall(425, 4, ctypes.create_string_buffer(120)))


def traces() -> None:
    call(libc.ptrace(PTRACE_ATTACH, int(VICTIM), None, None))


def reads_memory() -> None:
    with Path(f"/proc/{VICTIM}/mem").open("rb", 0) as memory:
        memory.read(1)


def takes_namespaces_anew() -> None:
    """By the call that starts processes, which makes them on the way."""
    pid = call(libc.syscall({"x86_64": 56, "aarch64": 220}[os.uname().machine], kernel.NEW_USER | signal.SIGCHLD, 0))
    if pid == 0:
        os._exit(0)
    os.waitpid(pid, 0)


def says_on_a_pair() -> None:
    """One of a pair of packet sockets may talk to others, unlike a stream."""
    mine, _other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    mine.sendto(b"cmd_vel", LETTERBOX)


def slows() -> None:
    os.sched_setscheduler(int(VICTIM), os.SCHED_IDLE, os.sched_param(0))


def slows_all() -> None:
    os.setpriority(os.PRIO_USER, os.getuid(), 19)


def forks() -> None:
    """More than a box may hold; all are gone again afterwards."""
    started: list[int] = []
    try:
        for _ in range(sandbox.MAX_PROCESSES):
            pid = os.fork()
            if pid == 0:
                signal.pause()
            started.append(pid)
    finally:
        for pid in started:
            os.kill(pid, signal.SIGKILL)
        for pid in started:
            os.waitpid(pid, 0)


ATTACKS: dict[str, tuple[str, Callable[[], object]]] = {
    "tcp": (sandbox.NETWORK, lambda: connects(socket.AF_INET, socket.SOCK_STREAM, ("127.0.0.1", int(TCP)))),
    "udp": (sandbox.NETWORK, lambda: connects(socket.AF_INET, socket.SOCK_DGRAM, ("127.0.0.1", int(UDP)))),
    "abstract": (sandbox.NETWORK, lambda: connects(socket.AF_UNIX, socket.SOCK_STREAM, f"\0{ABSTRACT}")),
    "bound": (sandbox.NETWORK, lambda: connects(socket.AF_UNIX, socket.SOCK_STREAM, BOUND)),
    "letterbox": (sandbox.NETWORK, says_on_a_pair),
    "rings": (sandbox.NETWORK, makes_rings),
    "reads another's file": (sandbox.FILES, reads(SECRET)),
    "reads /etc/passwd": (sandbox.FILES, reads("/etc/passwd")),
    "lists /tmp": (sandbox.FILES, lambda: list(Path(SECRET).parent.iterdir())),
    "writes beside it": (sandbox.FILES, lambda: Path(SECRET).with_suffix(".new").write_text("mine")),
    "removes it": (sandbox.FILES, lambda: Path(SECRET).unlink()),
    "writes home": (sandbox.FILES, lambda: (Path.home() / ".soter-attack").write_text("mine")),
    "signals": (sandbox.PROCESSES, lambda: os.kill(int(VICTIM), signal.SIGTERM)),
    "signals all": (sandbox.PROCESSES, lambda: os.kill(int(VICTIM), 0)),
    "traces": (sandbox.PROCESSES, traces),
    "reads memory": (sandbox.PROCESSES, reads_memory),
    "reads environment": (sandbox.PROCESSES, reads(f"/proc/{VICTIM}/environ")),
    "slows": (sandbox.PROCESSES, slows),
    "slows all": (sandbox.PROCESSES, slows_all),
    "pins": (sandbox.PROCESSES, lambda: os.sched_setaffinity(int(VICTIM), {0})),
    "limits": (sandbox.PROCESSES, lambda: resource.prlimit(int(VICTIM), resource.RLIMIT_CPU, (1, 1))),
    "becomes root": (sandbox.RIGHTS, lambda: os.setuid(0 if os.getuid() else 1)),
    "takes namespaces": (sandbox.RIGHTS, lambda: call(libc.unshare(kernel.NEW_USER))),
    "takes namespaces anew": (sandbox.RIGHTS, takes_namespaces_anew),
    "sets the host's name": (sandbox.RIGHTS, lambda: call(libc.sethostname(b"mine", 4))),
    "fork bomb": (sandbox.NUMBER, forks),
}

NEEDED: dict[str, Callable[[], object]] = {
    "writes scratch": lambda: (Path(SCRATCH) / "file").write_text("mine"),
    "runs programs": lambda: subprocess.run(["/bin/true"], check=True),
    "pairs of sockets": socket.socketpair,
    "pairs of links": lambda: socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET),
    "is nicer": lambda: os.nice(1),
    "threads": lambda: threading.Thread(target=sum, args=([1, 2],)).start(),
    "random numbers": lambda: os.close(os.open("/dev/urandom", os.O_RDONLY)),
    "discards": lambda: Path(os.devnull).write_text("nothing"),
}


def imports() -> None:
    try:
        __import__("fractions")
    except ImportError as refusal:
        raise OSError(refusal) from refusal


def outcome(attempt: Callable[[], object]) -> str:
    """Why it was refused; empty if it was not."""
    try:
        attempt()
    except (OSError, subprocess.SubprocessError) as refusal:
        return str(refusal) or repr(refusal)
    return ""


def main() -> None:
    lifeline, _held = os.pipe()
    said = os.dup(1)
    if "user" in HOW and os.geteuid() == 0:
        os.chown(SCRATCH, NOBODY, NOBODY)
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)
        # A program of that user's could be looked into by it from the start.
        call(libc.prctl(4, 1, 0, 0, 0))
    if "no-namespaces" in HOW:
        kernel.drop_rights()
        kernel.refuse_calls(sockets=False)
    if os.access(os.__file__, os.R_OK):
        # Root's own Python may be out of reach of those whom it becomes here.
        NEEDED["imports"] = imports
    found = sandbox.enter(SandboxRules(), SCRATCH, {}, (said,), lifeline)
    told = {
        "by": found.by,
        "lacks": found.lacks,
        "attacks": {name: [what, outcome(attempt)] for name, (what, attempt) in ATTACKS.items()},
        "needed": {name: outcome(attempt) for name, attempt in NEEDED.items()},
    }
    os.write(said, json.dumps(told).encode())
    os._exit(7)


if __name__ == "__main__":
    main()
