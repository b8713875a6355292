"""Opening Zenoh sessions, and what a session is given that nobody said anything about.

Zenoh's own defaults listen on all interfaces and look for others by multicast. Here a session listens on loopback
unless told otherwise, finds others by their endpoints and by what those know of, and by nothing else.

Zenoh only says that an endpoint is not reached; why, a second try by hand tells.
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
    """Return the likely cause why a session got no link to an endpoint, and what to do about it."""
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
    """Encrypt as the session would."""
    context = ssl.create_default_context(cafile=tls.root_ca)
    context.check_hostname = tls.verify_name
    if tls.certificate is not None:
        context.load_cert_chain(tls.certificate, tls.private_key)
    with context.wrap_socket(connected, server_hostname=host) as encrypted:
        # That a certificate is missing or not believed is told only after the handshake.
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
    """Close what is still open: threads of Zenoh that live on while the interpreter goes may take the process down."""
    for session in [*_open.values()]:
        _close(session)


def open_session(options: SessionOptions) -> zenoh.Session:
    """Open a session. A client waits for a router; others are there at once, and connect as soon as they can.

    Links that break are made anew without end, and what was declared holds on for them. It is open until
    `close_session`, or the program ends.

    Raises:
        BackendUnavailable: Zenoh is not installed.
        ConfigError: there is no password where it should be.
        RobotUnavailable: it cannot listen or, for a client, not connect; the message says why, and what to do.
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
    """Close a session, whatever has become of those that it has links to. Idempotent.

    Zenoh waits ten seconds for somebody who does not read any more, and then fails. What is left after two goes on by
    itself, in a thread of its own; nothing is heard or published any more.
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
    """Return where a session listens, with the ports that it was given; empty for a client.

    Raises:
        RobotUnavailable: it does not say.
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
        # How long opening waits for the first link, at most.
        "scouting/delay": _SCOUT_MS if options.connect else 0,
        # How peers of one peer learn of each other; they need links among themselves.
        "scouting/gossip/enabled": True,
        # Says where the session listens. Nobody may change anything by it.
        "adminspace/enabled": True,
        "adminspace/permissions": {"read": True, "write": False},
        "transport/shared_memory/enabled": False,
        "transport/unicast/open_timeout": timeout_ms,
        "transport/unicast/accept_timeout": timeout_ms,
        "transport/link/tx/lease": round(1000.0 * options.lease_s),
        # What may be dropped is dropped at once: no caller waits for a slow network.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 0,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 0,
    }
    if options.mode != "router":
        # By default a gigabyte. What a router passes on is others' business.
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
