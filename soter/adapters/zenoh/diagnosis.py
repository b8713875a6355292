"""Why an endpoint cannot be reached. Zenoh only says that it is not; a second try by hand tells more."""

from __future__ import annotations

import socket
import ssl
from pathlib import Path
from typing import Final, Protocol

from soter.adapters.zenoh.session_options import Endpoint

_TRY_S: Final = 2.0
_ALERT_S: Final = 0.5


class _Tls(Protocol):
    @property
    def root_ca(self) -> Path: ...
    @property
    def certificate(self) -> Path | None: ...
    @property
    def private_key(self) -> Path | None: ...
    @property
    def verify_name(self) -> bool: ...


def why_not_reached(endpoint: Endpoint, tls: _Tls | None) -> str:
    """Return the likely cause, and what to do about it.

    Args:
        endpoint: where a session did not get a link to.
        tls: how it would have encrypted it.
    """
    try:
        with socket.create_connection((endpoint.host, endpoint.port), timeout=_TRY_S) as connected:
            if endpoint.protocol == "tls" and tls is not None:
                _shake_hands(connected, endpoint.host, tls)
    except ConnectionRefusedError:
        return "nobody listens there; start it, or correct host and port"
    except TimeoutError:
        return "nobody answers there; look whether the host is up, and for firewalls on the way"
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
        "somebody listens there and does not let us in; it must be a Zenoh router or peer, encrypt as we do, and "
        "ask for a username exactly if one is given here"
    )


def _shake_hands(connected: socket.socket, host: str, tls: _Tls) -> None:
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
