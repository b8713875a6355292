"""Sessions without encryption: what may be said about them, who meets whom, and what is said when it does not work."""

from __future__ import annotations

import logging
import re
import socket
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh
from pydantic import ValidationError

from soter.adapters.zenoh.session import SessionOptions, endpoints, open_session
from soter.adapters.zenoh.session_options import DEFAULT_PORT
from soter.errors import BackendUnavailable, ConfigError, RobotUnavailable
from soter.hints import install_command
from soter.problems import config_error, pydantic_problems
from tests.adapters.zenoh.sessions import SILENCE_S, Heard, client, opened, router
from tests.waiting import eventually, wait_until


def refusal(**options: Any) -> str:
    """What a user is told who asks for such a session."""
    with pytest.raises(ValidationError) as found:
        SessionOptions(**options)
    return str(config_error(pydantic_problems(found.value, SessionOptions), None))


def by(variable: str) -> dict[str, Any]:
    return {"password_env": variable}


# --- what may be said --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"mode": "clinet"}, "mode: it is 'clinet', allowed: 'peer', 'client' or 'router', did you mean 'client'?"),
        ({"mode": "client"}, "connect: it is (), allowed: at least one with mode = 'client'"),
        ({"mode": "client", "listen": ["tcp/127.0.0.1:0"]}, "allowed: none with mode = 'client'; only peers and"),
        ({"listen": ["udp/127.0.0.1:0"]}, "allowed: tcp/HOST:PORT or tls/HOST:PORT; 'udp/127.0.0.1:0' is none"),
        ({"listen": "tcp/127.0.0.1:0"}, "listen: it is 'tcp/127.0.0.1:0', allowed: a list"),
        ({"connect": ["tcp/127.0.0.1:0"]}, "allowed: HOST:PORT where somebody listens; 'tcp/127.0.0.1:0' is not"),
        ({"connect": ["tcp/0.0.0.0:7447"], "unencrypted": True}, "allowed: HOST:PORT where somebody listens"),
        ({"connect": ["tcp/10.0.0.7:7447"]}, "connect: it is ['tcp/10.0.0.7:7447'], allowed: 127.0.0.1, or tls/… with"),
        ({"connect": ["tcp/robot1:7447"]}, "or unencrypted = true where the network itself is closed"),
        ({"connect": ["tls/127.0.0.1:7447"]}, "allowed: tls/… with a table 'tls' that names root_ca"),
        ({"listen": ["tcp/10.0.0.7:7447"]}, "allowed: 127.0.0.1, or tls/… with a table 'tls', or unencrypted = true"),
        ({"lease_s": 0.1}, "lease_s: it is 0.1, allowed: at least 0.5"),
        ({"open_timeout_s": float("nan")}, "open_timeout_s: it is nan, allowed: "),
        ({"endpoint": "tcp/127.0.0.1:7447"}, "endpoint: unknown key; allowed: mode, tls, "),
        ({"username": "two words", "password_env": "P"}, "allowed: 1 to 64 characters without spaces and colons"),
        ({"username": "alpha"}, "allowed: with a username one of password_file and password_env"),
        ({"password_env": "P"}, "password_env: it is 'P', allowed: a password only with a username"),
        (
            {"users_file": "/no/such/file"},
            "users_file: it is '/no/such/file', allowed: a file that can be read (No such",
        ),
    ],
)
def test_what_is_not_allowed_says_what_is(options: dict[str, Any], said: str) -> None:
    assert said in refusal(**options)


@pytest.mark.parametrize("everywhere", ["0.0.0.0", "[::]", "[::ffff:0.0.0.0]"])  # noqa: S104 - that is what is refused
def test_nobody_listens_on_all_interfaces_by_accident(everywhere: str) -> None:
    listen = (f"tcp/{everywhere}:0",)
    assert "unencrypted = true" in refusal(listen=listen)
    said = refusal(listen=listen, unencrypted=True)
    assert "allowed: an address of this host, such as 127.0.0.1, or allow_all_interfaces = true" in said
    assert "unencrypted = true" in refusal(listen=listen, allow_all_interfaces=True)
    assert SessionOptions(listen=listen, unencrypted=True, allow_all_interfaces=True).listens_at == listen


@pytest.mark.parametrize("name", ["0", "robot1", "224.0.0.224"])
def test_only_an_address_of_this_host_can_be_listened_on(name: str) -> None:
    assert "allowed: an address of this host" in refusal(listen=[f"tcp/{name}:0"], unencrypted=True)


def test_options_survive_being_handed_to_another_program(tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.write_text("alpha:secret1")
    for options in (
        SessionOptions(),
        client(["tcp/127.0.0.1:7447"], username="alpha", **by("ALPHA")),
        SessionOptions(mode="router", listen=("tcp/127.0.0.1:0",), users_file=users, lease_s=1.5),
    ):
        assert SessionOptions.model_validate_json(options.model_dump_json()) == options


def test_nobody_who_says_nothing_listens_beyond_loopback() -> None:
    assert SessionOptions().listens_at == ("tcp/127.0.0.1:0",)
    assert SessionOptions(mode="router").listens_at == (f"tcp/127.0.0.1:{DEFAULT_PORT}",)
    assert client(["tcp/127.0.0.1:7447"]).listens_at == ()


def test_a_password_never_shows(tmp_path: Path) -> None:
    (tmp_path / "users").write_text("alpha:secret1\nbeta secret2\n")
    said = refusal(users_file=tmp_path / "users")
    assert "allowed: NAME:PASSWORD a line; line 2 is none" in said
    assert "secret" not in said
    (tmp_path / "users").write_text("")
    assert "a line; there is none" in refusal(users_file=tmp_path / "users")


@pytest.mark.parametrize(
    ("written", "said"), [(None, "cannot be read"), ("", "there is no password"), ("two words", "there is no password")]
)
def test_a_password_that_is_not_there_is_missed(tmp_path: Path, written: str | None, said: str) -> None:
    file = tmp_path / "password"
    if written is not None:
        file.write_text(written)
    with pytest.raises(ConfigError, match=f"password_file: .*{said}"):
        open_session(SessionOptions(username="alpha", password_file=file))


def test_a_variable_that_is_not_there_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ALPHA", raising=False)
    with pytest.raises(ConfigError, match="password_env: there is no password in the environment variable 'ALPHA'"):
        open_session(SessionOptions(username="alpha", **by("ALPHA")))


# --- who meets whom ----------------------------------------------------------------------------------------


def test_peers_meet_where_one_listens() -> None:
    with opened(SessionOptions()) as (alpha,):
        (where,) = endpoints(alpha)
        assert where.startswith("tcp/127.0.0.1:")
        assert not where.endswith(":0")
        with opened(SessionOptions(connect=(where,))) as (beta,):
            assert Heard(alpha, "a").hears(beta, "a")
            assert Heard(beta, "b").hears(alpha, "b")


def test_peers_of_one_peer_meet_by_it() -> None:
    with opened(SessionOptions()) as (ground,):
        to_ground = SessionOptions(connect=tuple(endpoints(ground)))
        with opened(to_ground, to_ground) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")


def test_sessions_do_not_meet_by_chance() -> None:
    with opened(SessionOptions(), SessionOptions()) as (alpha, beta):
        heard = Heard(alpha, "a")
        until_s = time.monotonic() + 2 * SILENCE_S
        while time.monotonic() < until_s:
            beta.put("a", b"heard?")
            time.sleep(0.01)
        assert heard == []
        assert alpha.info.peers_zid() == beta.info.peers_zid() == []


def test_clients_meet_through_a_router_on_either_protocol() -> None:
    with router(listen=["tcp/127.0.0.1:0", "tcp/[::1]:0"]) as where:
        assert len(where) == 2
        with opened(client(where[:1]), client(where[1:])) as (alpha, beta):
            assert endpoints(alpha) == []
            assert Heard(alpha, "a").hears(beta, "a")


def test_a_peer_that_goes_to_a_router_is_told_of_clients(caplog: pytest.LogCaptureFixture) -> None:
    with router() as where, opened(SessionOptions(connect=tuple(where))) as (alpha,):
        assert eventually(lambda: bool(alpha.info.routers_zid()))
    assert "set mode = 'client'" in caplog.text


def test_a_peer_need_not_wait_for_others_and_finds_them_later() -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        where = f"tcp/127.0.0.1:{reserved.getsockname()[1]}"
    with opened(SessionOptions(connect=(where,))) as (alpha,):
        heard = Heard(alpha, "a")
        with opened(SessionOptions(listen=(where,))) as (beta,):
            assert heard.hears(beta, "a")


def test_what_is_far_too_long_is_dropped_and_nothing_else() -> None:
    with router() as where, opened(client(where), client(where)) as (alpha, beta):
        heard = Heard(alpha, "a")
        assert heard.hears(beta, "a")
        heard.clear()
        for length in (500_000, 2_000_000, 1000):
            beta.put("a", bytes(length), congestion_control=zenoh.CongestionControl.BLOCK)
        wait_until(lambda: bytes(1000) in heard)
        # Questions of before may still come.
        assert [len(each) for each in heard if each != b"heard?"] == [500_000, 1000]


def test_clients_find_a_router_again_that_was_away() -> None:
    with ExitStack() as stack:
        with router() as where:
            alpha, beta = stack.enter_context(opened(client(where), client(where)))
            heard = Heard(alpha, "a")
            assert heard.hears(beta, "a")
        assert eventually(lambda: not alpha.info.links() and not beta.info.links())
        heard.clear()
        with router(listen=where):
            assert heard.hears(beta, "a")


# --- what does not work ------------------------------------------------------------------------------------


def test_a_client_without_a_router_says_so_in_time() -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    begun_s = time.monotonic()
    with pytest.raises(RobotUnavailable) as found:
        open_session(client([f"tcp/127.0.0.1:{port}"], open_timeout_s=0.3))
    assert str(found.value) == (
        f"no Zenoh router is reached within 0.3 s at tcp/127.0.0.1:{port}: no program listens there; start it, or "
        "correct host and port"
    )
    assert time.monotonic() - begun_s < 3.0


def test_a_name_that_is_unknown_is_named() -> None:
    with pytest.raises(RobotUnavailable, match="its host is not known"):
        open_session(client(["tcp/robot1.invalid:7447"], unencrypted=True, open_timeout_s=0.3))


def test_what_is_no_zenoh_is_told_of() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        where = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(RobotUnavailable, match="a program listens there and refuses the session"):
            open_session(client([where], open_timeout_s=0.3))


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        where = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(RobotUnavailable) as found:
            open_session(SessionOptions(listen=(where,)))
    assert f"that listens at {where}: " in str(found.value)
    assert "Address already in use" in str(found.value)
    assert "listen at another port" in str(found.value)
    assert ".rs" not in str(found.value)


def test_without_the_library_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(BackendUnavailable, match=re.escape(install_command("zenoh"))):
        open_session(SessionOptions())


# --- passwords ---------------------------------------------------------------------------------------------


def test_only_users_with_their_password_get_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    users, password = tmp_path / "users", tmp_path / "password"
    users.write_text("alpha:secret1\nbeta:secret2\n")
    password.write_text("secret1\n")
    monkeypatch.setenv("BETA", "secret2")
    caplog.set_level(logging.DEBUG)
    with router(users_file=users) as where:
        known = (
            client(where, username="alpha", password_file=password),
            client(where, username="beta", **by("BETA")),
        )
        with opened(*known) as (alpha, beta):
            assert Heard(alpha, "a").hears(beta, "a")
            heard = Heard(alpha, "robot1/**")
            for stranger in (
                client(where, open_timeout_s=0.3),
                client(where, username="alpha", **by("BETA"), open_timeout_s=0.3),
                client(where, username="gamma", **by("BETA"), open_timeout_s=0.3),
            ):
                with pytest.raises(RobotUnavailable, match="refuses the session") as found:
                    open_session(stranger)
                assert "secret" not in str(found.value)
            with opened(SessionOptions(connect=tuple(where))) as (peer,):
                for _ in range(20):
                    peer.put("robot1/cmd_vel", b"let me in")
                    time.sleep(0.01)
                time.sleep(SILENCE_S)
            assert heard == []
    assert "secret" not in caplog.text
