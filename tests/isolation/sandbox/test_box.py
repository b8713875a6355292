"""What a box keeps from untrusted code, by trying it: the kernel of the host has the last word."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import URLError

import pytest

from soter.isolation import sandbox
from soter.isolation.child import Child, ChildDied, NotBoxed
from soter.isolation.sandbox import InForce, SandboxRules, kernel
from tests.waiting import gone, wait_until

ROOT = Path(__file__).parents[2]
ATTACK = Path(__file__).with_name("attack.py")
WAYS = [(), ("user",), ("no-namespaces",), ("no-namespaces", "user")]


@pytest.fixture
def targets() -> Iterator[list[str]]:
    """What an attacker wants: a file, sockets that listen, and another process of the same user."""
    with (
        tempfile.TemporaryDirectory() as folder,
        socket.create_server(("127.0.0.1", 0)) as tcp,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
        socket.socket(socket.AF_UNIX) as abstract,
        socket.socket(socket.AF_UNIX) as bound,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as letterbox,
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) as victim,
    ):
        Path(folder).chmod(0o711)
        secret = Path(folder, "secret")
        secret.write_text("endpoint")
        secret.chmod(0o666)
        scratch = Path(folder, "scratch")
        scratch.mkdir()
        udp.bind(("127.0.0.1", 0))
        abstract.bind(f"\0soter-test-{os.getpid()}")
        bound.bind(str(Path(folder, "bound")))
        letterbox.bind(str(Path(folder, "letterbox")))
        for name in ("bound", "letterbox"):
            Path(folder, name).chmod(0o666)
        for listener in (abstract, bound):
            listener.listen()
        ports = [str(each.getsockname()[1]) for each in (tcp, udp)]
        yield [
            str(secret),
            *ports,
            f"soter-test-{os.getpid()}",
            str(Path(folder, "bound")),
            str(Path(folder, "letterbox")),
            str(victim.pid),
            str(scratch),
        ]
        alive = victim.poll() is None
        victim.kill()
    assert alive, "the attacker has ended another process"


def attacked(targets: list[str], *how: str) -> dict[str, Any]:
    """What came of an attack."""
    command = [sys.executable, str(ATTACK), *targets, *how]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, env=env, capture_output=True, timeout=60.0)
    assert done.returncode == 7, done.stderr.decode()
    told: dict[str, Any] = json.loads(done.stdout)
    return told


@pytest.mark.parametrize("how", WAYS, ids="-".join)
def test_what_is_in_force_is_refused_and_what_is_not_is_said(targets: list[str], how: tuple[str, ...]) -> None:
    told = attacked(targets, *how)
    known = {sandbox.NETWORK, sandbox.FILES, sandbox.PROCESSES, sandbox.RIGHTS, sandbox.NUMBER}
    assert told["by"].keys() | told["lacks"].keys() == known
    assert not told["by"].keys() & told["lacks"].keys()
    assert all(told["lacks"].values()), "a reason for each"
    succeeded = {name: what for name, (what, refused) in told["attacks"].items() if not refused}
    assert not {name for name, what in succeeded.items() if what in told["by"]}
    assert not any(told["needed"].values()), told["needed"]
    if "no-namespaces" in how:
        assert "namespace" not in json.dumps(told["by"])
    # Where this kernel offers them, these mechanisms are what is relied on.
    if kernel.landlock_abi() >= kernel.SCOPE_ABI:
        assert {sandbox.FILES, sandbox.PROCESSES, sandbox.RIGHTS} <= told["by"].keys()
    if os.uname().machine in {"x86_64", "aarch64"}:
        assert sandbox.NETWORK in told["by"]


def test_nothing_of_a_box_is_left_when_its_first_process_ends() -> None:
    child = Child("tests.isolation.sandbox.stays", None, box=SandboxRules())
    assert child.receive(30.0) == b"started"
    left = processes_below(child.pid)
    assert left
    child.kill()
    wait_until(lambda: all(map(gone, left)))


def test_a_box_ends_with_the_lifeline_and_as_the_process_in_it() -> None:
    for payload, words in ((7, "exit code 7"), ("SIGSEGV", "signal SIGSEGV"), ("SIGKILL", "signal SIGKILL")):
        child = Child("tests.isolation.sandbox.stays", payload, box=SandboxRules(), patience_s=10.0)
        with pytest.raises(ChildDied, match=words):
            child.receive(30.0)
        child.kill()


def test_what_is_required_and_not_there_is_named_and_nothing_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    child = Child("tests.isolation.sandbox.stays", None, box=SandboxRules(required=True, network=True))
    with pytest.raises(NotBoxed, match=r"network \(the bus of a distributed mission needs it\)"):
        child.receive(30.0)
    child.kill()


def test_without_a_filter_of_calls_nothing_counts_that_rests_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(**_: object) -> None:
        raise OSError("the system calls of this machine are not known")

    for name, value in {"drop_rights": None, "landlock_abi": kernel.SCOPE_ABI, "restrict": None}.items():
        monkeypatch.setattr(kernel, name, lambda *_, value=value, **__: value)
    monkeypatch.setattr(kernel, "refuse_calls", unknown)
    monkeypatch.setattr(sandbox, "_into_namespaces", lambda *_: None)
    monkeypatch.setattr("resource.setrlimit", lambda *_: None)
    monkeypatch.setattr(sandbox, "_own", None)
    found = sandbox.enter(SandboxRules(), "/nowhere", {}, (), 0)
    assert found.by == {sandbox.FILES: f"Landlock {kernel.SCOPE_ABI}"}
    assert {sandbox.NETWORK, sandbox.PROCESSES, sandbox.RIGHTS} <= found.lacks.keys()


def test_what_lacks_is_in_words() -> None:
    found = InForce()
    found.miss(sandbox.NETWORK, "namespaces: no")
    found.miss(sandbox.NETWORK, "Landlock takes TCP only")
    assert found.missing == "network (namespaces: no; Landlock takes TCP only)"
    found.note(sandbox.NETWORK, "seccomp")
    assert not found.missing
    assert found.in_words() == {sandbox.NETWORK: "seccomp"}
    assert InForce.decoded(found.encoded()) == found


def processes_below(pid: int) -> list[int]:
    """All that a process has started, and what that has started."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    found = [int(each) for each in path.read_text().split()]
    return found + [below for each in found for below in processes_below(each)]


@pytest.mark.parametrize(
    "failure", [OSError(errno.EROFS, "x"), URLError(OSError(errno.EPERM, "x")), PermissionError(13, "x")]
)
def test_what_a_box_denies_is_said_to_be_denied_by_it(failure: OSError, monkeypatch: pytest.MonkeyPatch) -> None:
    assert sandbox.denied(failure) == ""
    monkeypatch.setattr(sandbox, "_own", InForce())
    assert "isolation.sandbox" in sandbox.denied(failure)
    assert sandbox.denied(FileNotFoundError(errno.ENOENT, "x")) == ""
