"""Restricts a process for good, by system calls that Python has no names for. Linux only."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import platform
import stat
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

NEW_USER: Final = 0x10000000
_NEW_MOUNTS: Final = 0x00020000
_NEW_IPC: Final = 0x08000000
NEW_PIDS: Final = 0x20000000
NEW_NETWORK: Final = 0x40000000
NAMESPACES: Final = _NEW_MOUNTS | _NEW_IPC | NEW_PIDS

_MS_RDONLY, _MS_NOSUID, _MS_NODEV, _MS_NOEXEC = 1, 2, 4, 8
_MS_REC, _MS_PRIVATE = 1 << 14, 1 << 18
_AT_RECURSIVE: Final = 0x8000
_MOUNT_SETATTR: Final = 442

_PR_SET_PDEATHSIG, _PR_SET_DUMPABLE, _PR_SET_SECCOMP, _PR_CAPBSET_DROP, _PR_SET_NO_NEW_PRIVS = 1, 4, 22, 24, 38
_SECCOMP_MODE_FILTER: Final = 2
_CAPABILITIES: Final = 64
_CAPABILITY_VERSION: Final = 0x20080522
_CAP_DAC_READ_SEARCH: Final = 2

_libc: Final = ctypes.CDLL(None, use_errno=True)
_libc.syscall.restype = ctypes.c_long


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


def _prctl(option: int, *values: int) -> None:
    padded = (*values, 0, 0, 0, 0)[:4]
    _checked(_libc.prctl(option, *(ctypes.c_ulong(each) for each in padded)))


def unshare(flags: int) -> None:
    """Move this process into new namespaces; a new namespace of process ids is for children only.

    Raises:
        OSError: the kernel refuses.
    """
    uid, gid = os.geteuid(), os.getegid()
    _checked(_libc.unshare(flags))
    if flags & NEW_USER:
        with contextlib.suppress(FileNotFoundError):
            _write("/proc/self/setgroups", "deny")
        _write("/proc/self/uid_map", f"{uid} {uid} 1")
        _write("/proc/self/gid_map", f"{gid} {gid} 1")


def may_unshare(flags: int) -> int:
    """Return 0 if `unshare` works, else the error number. Tried in another process, because it may fail half-way."""
    pid = os.fork()
    if pid == 0:
        try:
            unshare(flags)
        except OSError as failure:
            os._exit(failure.errno or 1)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


def _write(path: str, text: str) -> None:
    Path(path).write_text(text, encoding="ascii")


def mount_read_only(scratch: str, scratch_bytes: int) -> None:
    """Make all mounts of this namespace read-only, except for a scratch folder in memory.

    Raises:
        OSError: the kernel refuses, or is too old.
    """
    _mount("none", "/", "", _MS_REC | _MS_PRIVATE)
    options = f"size={scratch_bytes},mode=0700,nr_inodes=4096"
    _mount("tmpfs", scratch, "tmpfs", _MS_NOSUID | _MS_NODEV | _MS_NOEXEC, options)
    attributes = struct.pack("=4Q", _MS_RDONLY, 0, 0, 0)
    _checked(_libc.syscall(_MOUNT_SETATTR, -100, b"/", _AT_RECURSIVE, attributes, len(attributes)))
    attributes = struct.pack("=4Q", 0, _MS_RDONLY, 0, 0)
    _checked(_libc.syscall(_MOUNT_SETATTR, -100, scratch.encode(), 0, attributes, len(attributes)))


def mount_own_proc() -> None:
    """Have /proc show only the processes of this namespace.

    Raises:
        OSError: the kernel refuses, as in most containers.
    """
    _mount("proc", "/proc", "proc", _MS_NOSUID | _MS_NODEV | _MS_NOEXEC)


def _mount(source: str, target: str, kind: str, flags: int, options: str = "") -> None:
    arguments = (each.encode() for each in (source, target, kind))
    _checked(_libc.mount(*arguments, ctypes.c_ulong(flags), options.encode()))


def die_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends."""
    _prctl(_PR_SET_PDEATHSIG, 9)


def hide_memory() -> None:
    """Prevent processes of the same user from reading this one's memory, and from tracing it."""
    _prctl(_PR_SET_DUMPABLE, 0)


def drop_rights() -> None:
    """Give up all capabilities, and every way to get some: programs that change the user no longer do so.

    A process that may read every file keeps that right, which `restrict` limits: a mission that root runs may be in a
    user's folder.
    """
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    for capability in range(_CAPABILITIES):
        with contextlib.suppress(OSError):
            _prctl(_PR_CAPBSET_DROP, capability)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    data = (ctypes.c_uint32 * 6)()
    _checked(_libc.capget(header, data))
    kept = data[1] & 1 << _CAP_DAC_READ_SEARCH
    _checked(_libc.capset(header, (ctypes.c_uint32 * 6)(kept, kept, 0, 0, 0, 0)))


# --- Landlock ----------------------------------------------------------------------------------------------

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_FILE_RIGHTS_BY_ABI: Final = ((1, (1 << 13) - 1), (2, 1 << 13), (3, 1 << 14), (5, 1 << 15))
_OF_FILES: Final = _EXECUTE | _WRITE_FILE | _READ_FILE | 1 << 14 | 1 << 15
READ: Final = _EXECUTE | _READ_FILE | _READ_DIR
WRITE: Final = (1 << 15) - 1
"""All rights, except calls to devices."""

TCP_ABI: Final = 4
SCOPE_ABI: Final = 6


def landlock_abi() -> int:
    """Return the version of Landlock that the kernel offers; 0 for none."""
    return max(0, int(_libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), 1)))


def restrict(allowed: Iterable[tuple[str, int]], *, tcp: bool) -> None:
    """Deny this process all files except some, and, if the kernel can, TCP and access to other processes.

    Args:
        allowed: paths, with the rights to files below them; missing paths are left out.
        tcp: whether to deny TCP.

    Raises:
        OSError: the kernel does not offer this.
    """
    abi = landlock_abi()
    rights = sum(bits for since, bits in _FILE_RIGHTS_BY_ABI if abi >= since)
    size = 24 if abi >= SCOPE_ABI else 16 if abi >= TCP_ABI else 8
    attributes = struct.pack("=3Q", rights, 3 if tcp else 0, 3)[:size]
    rules = _checked(_libc.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(size), 0))
    try:
        for path, wanted in allowed:
            _allow(rules, path, wanted & rights)
        _checked(_libc.syscall(_RESTRICT_SELF, rules, 0))
    finally:
        os.close(rules)


def _allow(rules: int, path: str, rights: int) -> None:
    try:
        fd = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not stat.S_ISDIR(os.fstat(fd).st_mode):
            rights &= _OF_FILES
        _checked(_libc.syscall(_ADD_RULE, rules, 1, struct.pack("=Qi", rights, fd), 0))
    finally:
        os.close(fd)


_SOCKET: Final = "socket"
_CALLS: Final[Mapping[str, tuple[int, Mapping[str, int]]]] = {
    # By machine: its number in filters, and the numbers of its system calls.
    "x86_64": (0xC000003E, {
        _SOCKET: 41, "ptrace": 101, "pivot_root": 155, "mount": 165, "umount2": 166, "add_key": 248,
        "request_key": 249, "keyctl": 250, "unshare": 272, "perf_event_open": 298, "open_by_handle_at": 304,
        "setns": 308, "process_vm_readv": 310, "process_vm_writev": 311, "bpf": 321, "userfaultfd": 323,
        "socketpair": 53, "clone": 56, "setpriority": 141, "sched_setparam": 142, "sched_setscheduler": 144,
        "sched_setaffinity": 203, "ioprio_set": 251, "prlimit64": 302, "sched_setattr": 314,
    }),
    "aarch64": (0xC00000B7, {
        _SOCKET: 198, "ptrace": 117, "pivot_root": 41, "mount": 40, "umount2": 39, "add_key": 217,
        "request_key": 218, "keyctl": 219, "unshare": 97, "perf_event_open": 241, "open_by_handle_at": 265,
        "setns": 268, "process_vm_readv": 270, "process_vm_writev": 271, "bpf": 280, "userfaultfd": 282,
        "socketpair": 199, "clone": 220, "setpriority": 140, "sched_setparam": 118, "sched_setscheduler": 119,
        "sched_setaffinity": 122, "ioprio_set": 30, "prlimit64": 261, "sched_setattr": 274,
    }),
}  # fmt: skip
_NEW_CALLS: Final = (425, 428, 429, 430, 442)
"""On every machine: io_uring_setup, whose rings can make sockets, open_tree, move_mount, fsopen, mount_setattr."""

_CLONE3: Final = 435
"""Filters cannot see its arguments; libraries use `clone` if this call seems to be unknown."""

_ONESELF: Final = ((0, -1, (0,)),)
_ALLOWED_IF: Final[Mapping[str, Sequence[tuple[int, int, Sequence[int]]]]] = {
    # Paired datagram sockets, unlike SOCK_STREAM and SOCK_SEQPACKET, may also send to any Unix socket.
    "socketpair": ((0, -1, (1,)), (1, 0xF, (1, 5))),
    "clone": ((0, 0x7E020000, (0,)),),
    **dict.fromkeys(
        ("prlimit64", "sched_setparam", "sched_setscheduler", "sched_setaffinity", "sched_setattr"), _ONESELF
    ),
    "setpriority": ((0, -1, (0,)), (1, -1, (0,))),
    "ioprio_set": ((0, -1, (1,)), (1, -1, (0,))),
}
"""Calls that are allowed if each of these arguments (number, mask) has one of these values: no new namespaces, and no
changes of other processes' limits and priorities, which without a namespace of process ids could end the supervisor, or
starve it."""

_LOAD, _AND, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x54, 0x15, 0x35, 0x06
_ALLOW, _REFUSE, _UNKNOWN = 0x7FFF0000, 0x00050000 | errno.EPERM, 0x00050000 | errno.ENOSYS
_NUMBER, _MACHINE, _ARGUMENTS = 0, 4, 16
_OTHER_ABI: Final = 0x40000000

_Step = tuple[int, int, int, int]


def refuse_calls(*, sockets: bool) -> None:
    """Have the kernel refuse calls that no mission needs: new sockets, tracing, mounting, keys and others.

    Pairs of connected sockets can still be made.

    Raises:
        OSError: the kernel does not offer this, or the machine is not known here.
    """
    known = _CALLS.get(platform.machine())
    if known is None or struct.calcsize("P") != 8:
        raise OSError(f"the system calls of {platform.machine()} are not known")
    machine, calls = known
    # Calls with another machine's numbers are all refused.
    program: list[_Step] = [(_LOAD, 0, 0, _MACHINE), (_EQUAL, 1, 0, machine), (_RETURN, 0, 0, _REFUSE)]
    program += [(_LOAD, 0, 0, _NUMBER), (_AT_LEAST, 0, 1, _OTHER_ABI), (_RETURN, 0, 0, _REFUSE)]
    program += _if_called(_CLONE3, [(_RETURN, 0, 0, _UNKNOWN)])
    for name, number in (*calls.items(), *(("", number) for number in _NEW_CALLS)):
        if sockets or name not in {_SOCKET, "socketpair"}:
            program += _if_called(number, _judged(_ALLOWED_IF.get(name)))
    program += [(_RETURN, 0, 0, _ALLOW)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *each) for each in program))
    head = ctypes.create_string_buffer(struct.pack("@HP", len(program), ctypes.addressof(code)))
    _prctl(_PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, ctypes.addressof(head))


def _if_called(number: int, steps: Sequence[_Step]) -> list[_Step]:
    """Return the steps for one call; the given steps end with a verdict."""
    return [(_EQUAL, 0, len(steps), number), *steps]


def _judged(conditions: Sequence[tuple[int, int, Sequence[int]]] | None) -> list[_Step]:
    """Return the steps that allow a call if its arguments fulfil all conditions; without any, it is refused."""
    steps: list[_Step] = []
    for argument, mask, values in conditions or ():
        # The lower half of an argument, first on both machines; none of these arguments uses the upper half.
        steps += [(_LOAD, 0, 0, _ARGUMENTS + 8 * argument), (_AND, 0, 0, mask & 0xFFFFFFFF)]
        steps += [(_EQUAL, len(values) - index, 0, value) for index, value in enumerate(values)]
        steps += [(_RETURN, 0, 0, _REFUSE)]
    return [*steps, (_RETURN, 0, 0, _ALLOW if conditions else _REFUSE)]
