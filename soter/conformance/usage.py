"""The system resources that this process holds: threads, file descriptors, processes that it started, memory."""

from __future__ import annotations

import os
import resource
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

from soter.scratch import Scratch

_PROC: Final = Path("/proc")
_MIB: Final = 1 << 20
_FOLDER: Final = "kit"
_LISTENS: Final = "0A"
"""The state of a TCP socket that listens, as the kernel shows it."""


class Usage(NamedTuple):
    """The resources held at one moment.

    Attributes:
        threads: names of threads, by the kernel's id.
        descriptors: targets of file descriptors, by number.
        processes: commands of this process's descendants, zombies included, by id.
        files: names of files in the folder for temporary files, by a number; none outside of `temporary_files`.
        memory_mib: resident memory.
    """

    threads: dict[int, str]
    descriptors: dict[int, str]
    processes: dict[int, str]
    files: dict[int, str]
    memory_mib: float


def usage() -> Usage | None:
    """Return what this process holds, or None on a system without /proc."""
    own = _PROC / "self"
    if not (own / "task").is_dir():
        return None
    python = {each.native_id: each.name for each in threading.enumerate()}
    threads = {int(each.name): python.get(int(each.name), _text(each / "comm")) for each in (own / "task").iterdir()}
    descriptors = {int(each.name): _target(each) for each in (own / "fd").iterdir()}
    resident = int(_text(own / "statm").split()[1])
    return Usage(threads, descriptors, _descendants(), _files(), resident * resource.getpagesize() / _MIB)


@contextmanager
def temporary_files() -> Iterator[None]:
    """Have this process and those that it starts put temporary files into a folder of their own for a while."""
    before = os.environ.get("TMPDIR")
    with closing(Scratch(_FOLDER)) as scratch:
        tempfile.tempdir = os.environ["TMPDIR"] = str(scratch.path)
        try:
            yield
        finally:
            tempfile.tempdir = None
            os.environ.pop("TMPDIR")
            if before is not None:
                os.environ["TMPDIR"] = before


def listening() -> dict[tuple[str, int], str] | None:
    """Return which commands, of this process and what it has started, listen for TCP, by address and port.

    None on a system without /proc.
    """
    own = _PROC / "self"
    if not (own / "net" / "tcp").is_file():
        return None
    commands = {os.getpid(): sys.argv[0], **_descendants()}
    holders = {}
    for process, command in commands.items():
        with suppress(OSError):
            holders.update({_target(each): command for each in (_PROC / str(process) / "fd").iterdir()})
    found = {}
    for name, family in (("tcp", socket.AF_INET), ("tcp6", socket.AF_INET6)):
        for line in _text(own / "net" / name).splitlines()[1:]:
            words = line.split()
            holder = holders.get(f"socket:[{words[9]}]")
            if words[3] == _LISTENS and holder is not None:
                address, _, port = words[1].partition(":")
                found[_address(family, address), int(port, 16)] = holder
    return found


def _address(family: int, words: str) -> str:
    """Return an address that the kernel shows as words of this machine's byte order."""
    packed = b"".join(int(words[each : each + 8], 16).to_bytes(4, sys.byteorder) for each in range(0, len(words), 8))
    return socket.inet_ntop(family, packed)


def _files() -> dict[int, str]:
    folder = Path(tempfile.gettempdir())
    if not folder.name.startswith(f"soter-{_FOLDER}-"):
        return {}
    return {hash(name): name for name in (str(each.relative_to(folder)) for each in folder.rglob("*"))}


def _descendants() -> dict[int, str]:
    commands, parents = {}, {}
    for each in _PROC.iterdir():
        if each.name.isdigit() and (stat := _text(each / "stat")):
            # The name stands in brackets and may itself contain brackets.
            name, _, rest = stat.rpartition(")")
            words = _text(each / "cmdline").replace("\0", " ") or name.partition("(")[2]
            commands[int(each.name)], parents[int(each.name)] = words, int(rest.split()[1])
    found: dict[int, str] = {}
    new = {int(_target(_PROC / "self"))}
    while new:
        new = {child for child, parent in parents.items() if parent in new}
        found.update((child, commands[child]) for child in new)
    return found


def _text(path: Path) -> str:
    """Return the text of a file in /proc; empty if its thread or process has ended."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _target(path: Path) -> str:
    try:
        return str(path.readlink())
    except OSError:
        return ""
