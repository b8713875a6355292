"""Opens Zenoh sessions with safe defaults.

Zenoh's own defaults listen on all interfaces, and look for others by multicast. Here a session listens on loopback
unless told otherwise, and finds others only by their endpoints, and by the peers that those know.

Zenoh reports only that an endpoint is not reached; a second connection, made here, finds out why.
"""

from __future__ import annotations

import atexit
import json
import logging
import socket
import ssl
import threading
from typing import TYPE_CHECKING, Any, Final

from soter.adapters.zenoh.session_options import Endpoint, SessionOptions, TlsOptions
from soter.errors import BackendUnavailable, RobotUnavailable
from soter.hints import install_command

if TYPE_CHECKING:
    import zenoh

_TRY_S: Final = 2.0
_ALERT_S: Final = 0.5


def why_not_reached(endpoint: Endpoint, tls: TlsOptions | None) -> str:
    """Return the likely reason why a session got no link to an endpoint, and what to do about it."""
    try:
        with socket.create_connection((endpoint.host, endpoint.port), timeout=_TRY_S) as connected:
            if endpoint.protocol == "tls" and tls is not None:
                _shake_hands(connected, endpoint.host, tls)
    except ConnectionRefusedError:
        return "no program listens there; start it, or correct host and port"
    except TimeoutError:
        return "no answer from there; look whether the host is up, and for firewalls on the way"
    except socket.gaierror as failure:
        return f"its host is not known ({failure.strerror}); correct the name"
    except ssl.SSLCertVerificationError as failure:
        return (
            f"its certificate is not believed ({failure.verify_message}); tls.root_ca must be its authority's, and the "
            "host be named in it unless tls.verify_name = false"
        )
    except ssl.SSLError as failure:
        return f"it refuses to encrypt ({failure.reason}); it wants tls.certificate of an authority that it knows"
    except OSError as failure:
        return f"{failure.strerror or failure}"
    return (
        "a program listens there and refuses the session; it must be a Zenoh router or peer, encrypt as we do, and "
        "ask for a username exactly if one is given here"
    )


def _shake_hands(connected: socket.socket, host: str, tls: TlsOptions) -> None:
    """Make a TLS connection with the session's certificates."""
    context = ssl.create_default_context(cafile=tls.root_ca)
    context.check_hostname = tls.verify_name
    if tls.certificate is not None:
        context.load_cert_chain(tls.certificate, tls.private_key)
    with context.wrap_socket(connected, server_hostname=host) as encrypted:
        # The other end refuses a missing or unknown certificate only after the handshake.
        encrypted.settimeout(_ALERT_S)
        try:
            encrypted.recv(1)
        except TimeoutError:
            return


__all__ = ["SessionOptions", "TlsOptions", "close_session", "endpoints", "open_session"]

_RETRY_LEAST_MS: Final = 200
_RETRY_MOST_MS: Final = 1000
_ADMIN_S: Final = 5.0
_CLOSE_S: Final = 2.0
_SCOUT_MS: Final = 500
_FOREVER: Final = -1
_MOST_HEARD_BYTES: Final = 1_000_000

_log = logging.getLogger(__name__)

_open: Final[dict[str, zenoh.Session]] = {}


@atexit.register
def _close_all() -> None:
    """Close the open sessions: threads of Zenoh that still run while the interpreter ends may crash the process."""
    for session in [*_open.values()]:
        _close(session)


def open_session(options: SessionOptions) -> zenoh.Session:
    """Return an open session. A client waits for a router; others open at once, and connect as soon as they can.

    Broken links are tried again without end, and declarations hold for new links. The session is open until
    `close_session`, or the end of the program.

    Raises:
        BackendUnavailable: Zenoh is not installed.
        ConfigError: a password is missing.
        RobotUnavailable: the session cannot listen or, a client, not connect; the message says why, and what to do.
    """
    try:
        import zenoh
    except ImportError as failure:
        raise BackendUnavailable(
            f"Zenoh is not available: {failure}; install it with: {install_command('zenoh')}"
        ) from failure
    config = zenoh.Config()
    for key, value in _settings(options).items():
        config.insert_json5(key, json.dumps(value))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as failure:
        raise RobotUnavailable(_why_not_opened(options, failure)) from failure
    _open[str(session.zid())] = session
    if options.mode == "peer" and session.info.routers_zid():
        _log.warning(
            "this session is a peer and has connected to a router, which passes nothing on between peers; to reach "
            "others through it, set mode = 'client'"
        )
    return session


def close_session(session: zenoh.Session) -> None:
    """Close a session within two seconds, even if other ends of its links hang. Idempotent.

    Zenoh waits ten seconds for another end that no longer reads, and then fails. After two seconds the rest goes on in
    a background thread; nothing is heard or published any more.
    """
    closing = threading.Thread(target=_close, args=(session,), name="zenoh-close", daemon=True)
    closing.start()
    closing.join(_CLOSE_S)


def _close(session: zenoh.Session) -> None:
    import zenoh

    _open.pop(str(session.zid()), None)
    try:
        session.close()  # type: ignore[no-untyped-call]
    except zenoh.ZError as failure:
        _log.info("a Zenoh session was closed without a goodbye: %s", failure)


def endpoints(session: zenoh.Session) -> list[str]:
    """Return the endpoints at which a session listens, with their actual ports; empty for a client.

    Raises:
        RobotUnavailable: the session does not tell its endpoints.
    """
    for reply in session.get(f"@/{session.zid()}/*", timeout=_ADMIN_S):
        if reply.ok is not None:
            about = json.loads(reply.ok.payload.to_string())
            if isinstance(about, dict) and "locators" in about:
                return [str(each) for each in about["locators"]]
    raise RobotUnavailable("a Zenoh session does not say where it listens; open it with open_session")


def _settings(options: SessionOptions) -> dict[str, Any]:
    waits = options.mode == "client"
    timeout_ms = round(1000.0 * options.open_timeout_s)
    settings: dict[str, Any] = {
        "mode": options.mode,
        "listen/endpoints": options.listens_at,
        "listen/exit_on_failure": True,
        "connect/endpoints": options.connect,
        "connect/timeout_ms": timeout_ms if waits else _FOREVER,
        "connect/exit_on_failure": waits,
        "connect/retry": {
            "period_init_ms": _RETRY_LEAST_MS,
            "period_max_ms": _RETRY_MOST_MS,
            "period_increase_factor": 2.0,
        },
        "scouting/multicast/enabled": False,
        # Longest time that opening waits for the first link.
        "scouting/delay": _SCOUT_MS if options.connect else 0,
        # Peers of one peer learn of each other by gossip; they need links among themselves.
        "scouting/gossip/enabled": True,
        # The admin space tells where the session listens. It is read only.
        "adminspace/enabled": True,
        "adminspace/permissions": {"read": True, "write": False},
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": timeout_ms,
        "transport/unicast/accept_timeout": timeout_ms,
        "transport/link/tx/lease": round(1000.0 * options.lease_s),
        # Droppable messages are dropped at once: no caller waits for a slow network.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 0,
    }
    if options.mode != "router":
        # By default a gigabyte. A router does not limit the messages that it passes on.
        settings["transport/link/rx/max_message_size"] = _MOST_HEARD_BYTES
    if options.username is not None:
        settings["transport/auth/usrpwd/user"] = options.username
        settings["transport/auth/usrpwd/password"] = options.read_password()
    if options.users_file is not None:
        settings["transport/auth/usrpwd/dictionary_file"] = str(options.users_file)
    if (tls := options.tls) is not None:
        settings["transport/link/tls"] = {
            "root_ca_certificate": str(tls.root_ca),
            "enable_mtls": tls.mutual,
            "verify_name_on_connect": tls.verify_name,
        }
        if tls.certificate is not None:
            for end in ("listen", "connect"):
                settings[f"transport/link/tls/{end}_certificate"] = str(tls.certificate)
                settings[f"transport/link/tls/{end}_private_key"] = str(tls.private_key)
    return settings


def _why_not_opened(options: SessionOptions, failure: Exception) -> str:
    said = str(failure).split(" at /")[0].rstrip(". ")
    if "connect to any" not in said:
        where = ", ".join(options.listens_at) or "nowhere"
        return (
            f"a Zenoh session cannot be opened that listens at {where}: {said}; end the other program that listens "
            "there, or listen at another port or address of this host"
        )
    tries = [f"{text}: {why_not_reached(Endpoint.parse(text), options.tls)}" for text in options.connect]
    return f"no Zenoh router is reached within {options.open_timeout_s:g} s at " + "; ".join(tries)
