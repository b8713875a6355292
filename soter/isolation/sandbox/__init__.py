"""A sandbox for untrusted code, which the kernel enforces before the first line of it. Standard library only.

Kernels offer different restrictions: `enter` returns those in force, and what enforces each.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import resource
import select
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Self

from soter.isolation.sandbox import kernel
from soter.isolation.sandbox.paths import readable

NETWORK: Final = "network"
FILES: Final = "files"
PROCESSES: Final = "other processes"
RIGHTS: Final = "rights"
NUMBER: Final = "number of processes"

REQUIRED: Final = (NETWORK, FILES, PROCESSES, RIGHTS)
"""The restrictions that a required sandbox must have; the number of processes is limited only if possible."""

MAX_PROCESSES: Final = 512
"""Most processes and threads of one sandbox."""

SCRATCH_BYTES: Final = 256 << 20
"""Size of a sandbox's scratch folder, if it is in memory."""

_NAMESPACE: Final = "process namespace"
_PID_MAX: Final = Path("/proc/sys/kernel/pid_max")
_PID_MAX_OF_EACH: Final = (6, 14)
"""First kernel version in which every namespace of process ids has a limit of its own."""


@dataclass(frozen=True, slots=True)
class SandboxRules:
    """The rules of a process's sandbox.

    Attributes:
        required: whether the process must not run unless the kernel enforces all of `REQUIRED`.
        read: files and folders that the process may read, besides Python and importable modules.
        network: whether the process may use the network.
    """

    required: bool = False
    read: tuple[str, ...] = ()
    network: bool = False


@dataclass(slots=True)
class InForce:
    """Which restrictions are in force: `by` says what enforces each, `lacks` why one is missing."""

    by: dict[str, str] = field(default_factory=dict)
    lacks: dict[str, str] = field(default_factory=dict)

    def note(self, what: str, by: str) -> None:
        """Note that a restriction is in force by this mechanism, too."""
        self.lacks.pop(what, None)
        self.by[what] = f"{self.by[what]}, {by}" if what in self.by else by

    def miss(self, what: str, why: str) -> None:
        """Note why a restriction is missing, unless another mechanism enforces it."""
        if what not in self.by:
            self.lacks[what] = f"{self.lacks[what]}; {why}" if what in self.lacks else why

    def lose(self, what: str, why: str) -> None:
        """Note that a restriction is not in force after all, whatever was noted before."""
        self.by.pop(what, None)
        self.lacks[what] = why

    @property
    def missing(self) -> str:
        """The missing restrictions of `REQUIRED`, in words; empty if all are in force."""
        return "; ".join(f"{what} ({self.lacks[what]})" for what in REQUIRED if what in self.lacks)

    def in_words(self) -> dict[str, str]:
        """Return by restriction what enforces it, or why it is open."""
        return {**self.by, **{what: f"open: {why}" for what, why in self.lacks.items()}}

    def encoded(self) -> bytes:
        """Return the restrictions as bytes."""
        return json.dumps([self.by, self.lacks]).encode()

    @classmethod
    def decoded(cls, data: bytes) -> Self:
        """Return the restrictions in bytes of `encoded`, which were sent before the first line of untrusted code."""
        return cls(*json.loads(data))


_own: InForce | None = None
_DENIED: Final = {errno.EROFS, errno.EPERM, errno.EACCES}


def enter(
    box: SandboxRules, scratch: str, inherited: Mapping[str, str], close: Sequence[int], lifeline_fd: int
) -> InForce:
    """Put this process, which must have one thread, into a sandbox for good; return the restrictions in force.

    If namespaces are allowed, this returns in a grandchild, which the kernel kills with this process; this process then
    ends as the grandchild does.

    Args:
        box: the rules.
        scratch: an empty folder, the only one that the process may write to.
        inherited: by restriction of the parent, which holds for this process as well, what enforces it.
        close: descriptors that only the sandboxed process is to hold.
        lifeline_fd: read end of a pipe; when the other end is closed, all these processes end.
    """
    global _own
    found = InForce(dict(inherited))
    # Looked for before files are hidden.
    files = readable(sys.path, box.read)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if not inherited:
        _into_namespaces(box, scratch, close, lifeline_fd, found)
    try:
        kernel.drop_rights()
        found.note(RIGHTS, "no new privileges, no capabilities")
    except OSError as failure:
        found.miss(RIGHTS, f"capabilities: {failure.strerror}")
    _restrict(box, scratch, files, found)
    try:
        kernel.refuse_calls(sockets=not box.network)
        for what in (RIGHTS, PROCESSES, NETWORK):
            # Seccomp does not prevent signals.
            if what != PROCESSES or what in found.by:
                found.note(what, "seccomp")
    except OSError as failure:
        why = f"seccomp: {failure.strerror or failure}"
        found.miss(NETWORK, why)
        found.lose(RIGHTS, why)
        if _NAMESPACE not in found.by.get(PROCESSES, ""):
            # Landlock does not protect other processes' limits and priorities.
            found.lose(PROCESSES, why)
    if box.network:
        found.lose(NETWORK, "the bus of a distributed mission needs it")
    _own = found
    return found


def inherited() -> Mapping[str, str]:
    """Return by restriction of this process what enforces it; empty without a sandbox."""
    return {} if _own is None else _own.by


def denied(failure: BaseException) -> str:
    """Return, as the end of a message, that the sandbox of this process forbids what failed; empty if it does not."""
    found: BaseException | None = failure
    while found is not None:
        if _own is not None and isinstance(found, OSError) and found.errno in _DENIED:
            return (
                "; code of the mission runs in a sandbox here, without a network, and writes to the folder TMPDIR only "
                "(docs/sandbox.md): write with self.log, or set isolation.sandbox"
            )
        # urllib has what went wrong as a reason.
        reason = getattr(found, "reason", None)
        found = reason if isinstance(reason, BaseException) else found.__cause__ or found.__context__
    return ""


# --- Landlock ----------------------------------------------------------------------------------------------


def _restrict(box: SandboxRules, scratch: str, files: Sequence[str], found: InForce) -> None:
    abi = kernel.landlock_abi()
    name = f"Landlock {abi}"
    if not abi:
        for what in (FILES, PROCESSES, NETWORK):
            found.miss(what, "Landlock: not offered by this kernel")
        return
    # /proc shows other processes, but only what every user may read.
    allowed = [(path, kernel.READ) for path in (*files, "/proc")]
    allowed += [(path, kernel.WRITE) for path in (scratch, os.devnull)]
    try:
        kernel.restrict(allowed, tcp=not box.network)
    except OSError as failure:
        for what in (FILES, PROCESSES, NETWORK):
            found.miss(what, f"Landlock: {failure.strerror}")
        return
    found.note(FILES, name)
    if abi >= kernel.SCOPE_ABI:
        found.note(PROCESSES, name)
    else:
        found.miss(PROCESSES, f"Landlock: version {abi}, signals are restricted from {kernel.SCOPE_ABI} on")
    if abi < kernel.TCP_ABI:
        found.miss(NETWORK, f"Landlock: version {abi}, TCP is restricted from {kernel.TCP_ABI} on")
    elif NETWORK in found.by:
        found.note(NETWORK, name)
    else:
        found.miss(NETWORK, "Landlock takes TCP only")


def _into_namespaces(box: SandboxRules, scratch: str, close: Sequence[int], lifeline_fd: int, found: InForce) -> None:
    """Go on in new namespaces, as the second process there: the first process of one ignores signals."""
    wanted = kernel.NAMESPACES | (0 if box.network else kernel.NEW_NETWORK)
    # Without a namespace of users, root keeps the right to read other users' files.
    refused = 0
    for extra in (0, kernel.NEW_USER) if os.geteuid() == 0 else (kernel.NEW_USER,):
        refused = kernel.may_unshare(wanted | extra)
        if not refused:
            kernel.unshare(wanted | extra)
            break
    else:
        for what in (NETWORK, PROCESSES, NUMBER):
            found.miss(what, f"namespaces: {os.strerror(refused)}")
        return
    heard, told = os.pipe()
    started = os.fork()
    if started:
        os.close(told)
        _let_go(close)
        _follow(started, heard, lifeline_fd)
    kernel.die_with_parent()
    os.close(heard)
    if not box.network:
        found.note(NETWORK, "network namespace")
    found.note(PROCESSES, _NAMESPACE)
    _mounted(scratch, found)
    _count(found)
    inside = os.fork()
    if inside:
        os.close(lifeline_fd)
        _let_go(close)
        _be_first(inside, told)
    os.close(told)


def _mounted(scratch: str, found: InForce) -> None:
    with contextlib.suppress(OSError):
        kernel.mount_own_proc()
        found.note(PROCESSES, "own /proc")
        _limit_ids(found)
    with contextlib.suppress(OSError):
        kernel.mount_read_only(scratch, SCRATCH_BYTES)
        found.note(FILES, "read-only mounts")
        # Read-only files can still be read; only Landlock hides them.
        if not kernel.landlock_abi():
            found.lose(FILES, f"{found.by[FILES]} only")


def _limit_ids(found: InForce) -> None:
    release = os.uname().release.split(".")
    if (int(release[0]), int(release[1])) < _PID_MAX_OF_EACH:
        return
    _PID_MAX.write_text(str(MAX_PROCESSES), encoding="ascii")
    found.note(NUMBER, f"{MAX_PROCESSES} process ids")


def _count(found: InForce) -> None:
    """Limit the number of processes; the kernel counts an ordinary user's for each namespace of users."""
    if os.geteuid() == 0:
        found.miss(NUMBER, "root's processes are limited by kernels from 6.14 on")
        return
    resource.setrlimit(resource.RLIMIT_NPROC, (MAX_PROCESSES, MAX_PROCESSES))
    found.note(NUMBER, f"at most {MAX_PROCESSES}")


def _let_go(close: Sequence[int]) -> None:
    """Close the descriptors whose end another process waits for."""
    null = os.open(os.devnull, os.O_RDWR)
    for fd in (0, 1, 2):
        os.dup2(null, fd)
    for fd in close:
        os.close(fd)


def _be_first(inside: int, told: int) -> None:
    """Be the first process of a namespace: reap orphaned processes, and end with the sandboxed one."""
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)
    with contextlib.suppress(OSError):
        kernel.drop_rights()
    kernel.hide_memory()
    while True:
        pid, status = os.wait()
        if pid == inside:
            os.write(told, status.to_bytes(4, "little"))
            os._exit(0)


def _follow(started: int, heard: int, lifeline_fd: int) -> None:
    """Wait for a namespace's first process, and end as the sandboxed one did; end both when the lifeline closes."""
    kernel.hide_memory()
    poll = select.poll()
    poll.register(heard, select.POLLIN)
    poll.register(lifeline_fd, 0)
    status = b""
    for fd, _ in poll.poll():
        if fd == heard:
            status = os.read(heard, 4)
    os.kill(started, signal.SIGKILL)
    os.waitpid(started, 0)
    ended = int.from_bytes(status, "little") if len(status) == 4 else signal.SIGKILL
    if os.WIFSIGNALED(ended):
        number = os.WTERMSIG(ended)
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(os.WEXITSTATUS(ended) if os.WIFEXITED(ended) else 1)
