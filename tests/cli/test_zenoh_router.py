"""`soter zenoh-router`, as a user starts it."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from soter.adapters.zenoh.session import SessionOptions, open_session
from soter.cli import app
from soter.errors import RobotUnavailable
from tests.adapters.zenoh.sessions import Authority, Heard, client, opened


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "soter.cli", "zenoh-router", *arguments]


class Router:
    """A router in a process of its own, and what it has printed until it was ready."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        self.process = process
        self.said = ""
        for line in process.stdout:
            self.said += line
            if line.startswith("Ctrl-C"):
                break
        self.where = re.findall(r"(?:tcp|tls)/\S+:\d+", self.said.partition("\n")[0])

    @property
    def suggested(self) -> dict[str, Any]:
        """The session that it suggests for mission files."""
        table = re.search(r"^\[backends\.zenoh\.session\]\n(?:.+\n)+", self.said, re.MULTILINE)
        assert table is not None
        found: dict[str, Any] = tomllib.loads(table[0])["backends"]["zenoh"]["session"]
        return found

    def end(self, by: signal.Signals) -> int:
        self.process.send_signal(by)
        return self.process.wait(10.0)


@contextmanager
def started(*arguments: str) -> Iterator[Router]:
    with subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, text=True) as process:
        try:
            yield Router(process)
        finally:
            process.kill()


def test_clients_meet_at_routers_that_share_and_ctrl_c_ends_those() -> None:
    with started("--listen", "tcp/127.0.0.1:0") as first:
        assert len(first.where) == 1
        suggested = SessionOptions(**first.suggested)
        assert suggested == client(first.where)
        with (
            started("--listen", "tcp/127.0.0.1:0", "--connect", first.where[0]) as second,
            opened(suggested, client(second.where)) as (alpha, beta),
        ):
            assert Heard(alpha, "a").hears(beta, "a")
            assert Heard(beta, "b").hears(alpha, "b")
            assert second.end(signal.SIGTERM) == 0
        assert first.end(signal.SIGINT) == 0
        assert first.process.stdout is not None
        assert "connected: " in first.process.stdout.read()


def test_certificates_and_users_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours = Authority(tmp_path / "ours")
    users = tmp_path / "users"
    users.write_text("alpha:secret1\n")
    monkeypatch.setenv("ALPHA", "secret1")
    own = ours.tls("127.0.0.1")
    listening = ["--listen", "tls/127.0.0.1:0", "--root-ca", str(own.root_ca)]
    listening += ["--certificate", str(own.certificate), "--private-key", str(own.private_key), "--users", str(users)]
    with started(*listening) as router:
        suggested = router.suggested
        assert suggested["tls"]["root_ca"] == str(ours.root)
        assert suggested.keys() >= {"username", "password_file"}
        by = {"username": "alpha", "password_env": "ALPHA"}
        known = client(router.where, tls=ours.tls("alpha"), **by)
        with opened(known, known) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")
        for stranger in ({"tls": ours.tls()} | by, {"tls": ours.tls("beta")}):
            with pytest.raises(RobotUnavailable):
                open_session(client(router.where, open_timeout_s=0.3, **stranger))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--listen", "tcp/0.0.0.0:0", "--unencrypted"], "or allow_all_interfaces = true; 'tcp/0.0.0.0:0' is not"),
        (["--listen", "tcp/[::]:0", "--allow-all-interfaces"], "or unencrypted = true where the network itself is"),
        (["--listen", "127.0.0.1:7447"], "allowed: tcp/HOST:PORT or tls/HOST:PORT; '127.0.0.1:7447' is none"),
        (["--root-ca", "/no/ca", "--anonymous"], "tls.root_ca: it is '/no/ca', allowed: a file that can be read"),
        (["--session", "/no/session"], "/no/session: this session file does not exist"),
    ],
)
def test_bad_input_ends_it_before_it_listens(arguments: list[str], said: str) -> None:
    ended = CliRunner().invoke(app, ["zenoh-router", *arguments])
    assert ended.exit_code == 2
    assert said in ended.stderr
    assert ended.stdout == ""


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        where = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        ended = CliRunner().invoke(app, ["zenoh-router", "--listen", where])
    assert ended.exit_code == 2
    assert f"that listens at {where}: " in ended.stderr
    assert "Address already in use" in ended.stderr
