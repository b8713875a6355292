"""What is started without being told otherwise can be reached from this host only."""

from __future__ import annotations

import ast
import ipaddress
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.project.source import ROOT, python_files

EVERYWHERE = re.compile(r"(?:[a-z-]+[:/]/*)?(?:0\.0\.0\.0|\[?::\]?)(?::(?:\d+|\*))?|(?:[a-z-]+:/+)?\*:(?:\d+|\*)")
"""A text that is an address, or an endpoint of some library, on all interfaces."""


def addresses(path: Path) -> Iterator[tuple[int, str]]:
    """The texts of a file that may be addresses, by line: a host that is empty as `*:0`."""
    if path.suffix == ".toml":
        for line, text in enumerate(path.read_text().splitlines(), 1):
            yield from ((line, each) for each in re.findall(r'"([^"]*)"', text.partition("#")[0]))
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        match node:
            case ast.Constant(value=str(text)):
                yield node.lineno, text
            case ast.Call(func=ast.Attribute(attr="bind" | "create_server"), args=[ast.Tuple(elts=[host, *_]), *_]):
                if isinstance(host, ast.Constant) and host.value == "":
                    yield node.lineno, "*:0"


def reaching_out(*paths: Path) -> list[str]:
    """Where the files name all interfaces."""
    return [
        f"{path.relative_to(ROOT) if path.is_relative_to(ROOT) else path.name}:{line}: {text}"
        for path in paths
        for line, text in addresses(path)
        if EVERYWHERE.fullmatch(text)
    ]


def test_no_source_names_all_interfaces() -> None:
    files = [*python_files(ROOT / "soter", ROOT / "sim", ROOT / "examples"), *(ROOT / "examples").rglob("*.toml")]
    assert reaching_out(*(path for path in files if "tests" not in path.parts)) == []


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ('listen = ["tcp/[::]:7447"]', True),
        ('host = "0.0.0.0"', True),
        ('host = "::"', True),
        ('socket.bind("tcp://*:5555")', True),
        ('socket.bind(("", 5555))', True),
        ('listen = ["tcp/127.0.0.1:7447"]', False),
        ('key = "*"', False),
        ('text = "listening on 0.0.0.0 is refused"', False),
    ],
)
def test_what_names_all_interfaces_is_found(tmp_path: Path, line: str, found: bool) -> None:
    file = tmp_path / "file.py"
    file.write_text(line)
    assert bool(reaching_out(file)) == found


# --- what really listens -----------------------------------------------------------------------------------


def listening(root: int) -> set[str]:
    """The sockets at which a process and all below it can be reached, as `protocol address:port`; on Linux."""
    sockets = {
        target.removeprefix("socket:[").removesuffix("]")
        for process in tree(root)
        for link in Path(f"/proc/{process}/fd").glob("*")
        if (target := _target(link)).startswith("socket:[")
    }
    found = set()
    for table, state in (("tcp", "0A"), ("tcp6", "0A"), ("udp", "07"), ("udp6", "07")):
        for row in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = row.split()
            if fields[9] in sockets and fields[3] == state:
                host, port = fields[1].split(":")
                words = [bytes.fromhex(host[at : at + 8])[::-1] for at in range(0, len(host), 8)]
                found.add(f"{table} {ipaddress.ip_address(b''.join(words))}:{int(port, 16)}")
    return found


def tree(root: int) -> set[int]:
    """A process and all below it."""
    parents = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parents[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError):  # gone meanwhile
            continue
    found, before = {root}, 0
    while before != len(found):
        before = len(found)
        found |= {child for child, parent in parents.items() if parent in found}
    return found


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:
        return ""


def beyond_loopback(found: set[str]) -> set[str]:
    return {each for each in found if not ipaddress.ip_address(each.split()[1].rpartition(":")[0]).is_loopback}


PROGRAMS = {
    "zenoh-router": ["zenoh-router", "--listen", "tcp/127.0.0.1:0"],
    "sim zenoh": ["sim", "zenoh", "examples/surveillance.xml", "--robots", "1"],
    "sim mavlink": ["sim", "mavlink", "examples/surveillance.xml", "--robots", "1", "--tcp", "--port", "0"],
}


@pytest.mark.skipif(sys.platform != "linux", reason="reads what listens from /proc")
@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_listens_on_loopback_only(name: str) -> None:
    command = [sys.executable, "-m", "soter.cli", *PROGRAMS[name]]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert any("Ctrl-C" in line for line in process.stdout), "it has not begun to listen"
            time.sleep(0.5)
            found = listening(process.pid)
        finally:
            process.terminate()
    assert found
    assert beyond_loopback(found) == set()


@pytest.mark.skipif(sys.platform != "linux", reason="reads what listens from /proc")
def test_what_listens_everywhere_is_seen() -> None:
    program = "import socket, sys; s = socket.create_server(('', 0)); print(s.getsockname()[1], flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        port = process.stdout.readline().strip()
        found = listening(process.pid)
        process.communicate("\n")
    assert found == beyond_loopback(found) == {f"tcp 0.0.0.0:{port}"}
